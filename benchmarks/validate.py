"""Speed and memory of the validator on the Unitree G1 (29 joints).

    python -m benchmarks.validate [DATA] [--only memory speed many] [--clips 1000]

Processor time, measured in one run beside the bare ``mj_inverse`` loop, since machines differ:
all rules (aim: 8 000 frames/s on one core), the cone fit (aim: at most 5 times the loop), the peak
memory of clips of 1, 10 and 60 minutes read from files (aim: the same), and many short clips.
"""

from __future__ import annotations

import argparse
import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from physretarget.clip import Clip, load_clip, open_clip
from physretarget.ground import support
from physretarget.ground.cones import ConeFit, fit_forces
from physretarget.mjcf import Character, derivatives, required_wrench
from physretarget.report.text import render_text
from physretarget.validation import Settings, validate

Array = NDArray[np.float64]
T = TypeVar("T")
CLIPS = ("walk", "wave", "jumpjack", "dance", "high5")
FPS = 30.0


def character_of(data: Path) -> Character:
    return Character.load(data / "robot" / "g1_no_mesh_box_feet.xml")


def clip_of(data: Path, character: Character, name: str, frames: int) -> Clip:
    """One of the generated clips, played to and fro until it has so many frames."""
    qpos = load_clip(data / "robot" / f"g1_{name}.csv", character=character, fps=FPS).qpos
    both = np.concatenate([qpos, qpos[::-1]])
    qpos = np.tile(both, (frames // len(both) + 1, 1))[:frames]
    return Clip(qpos=qpos, time=np.arange(frames) / FPS)


def best(work: Callable[[], object], repeats: int = 3) -> float:
    """Processor seconds of the fastest of some runs."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def speed(data: Path, frames: int = 4000) -> None:
    character = character_of(data)
    settings = Settings(profile="robot", lowpass_hz=6)
    fit = fit_forces
    print(f"{'clip':10s} {'mj_inverse':>12s} {'cone fit':>18s} {'all rules':>24s}")
    for name in CLIPS:
        clip = clip_of(data, character, name, frames)
        qvel, qacc = derivatives(character, clip.qpos, clip.time)
        bare = best(partial(required_wrench, character, clip.qpos, qvel, qacc)) / frames
        spent: list[float] = []

        def timed(*args: Array, spent: list[float] = spent, **options: Array) -> ConeFit:
            start = time.process_time()
            found = fit(*args, **options)  # type: ignore[arg-type]
            spent.append(time.process_time() - start)
            return found

        setattr(support, "fit_forces", timed)  # noqa: B010
        repeats = 3
        whole = best(partial(validate, clip, character, settings=settings), repeats) / frames
        setattr(support, "fit_forces", fit)  # noqa: B010
        cones = min(sum(run) for run in np.array_split(spent, repeats)) / frames
        print(
            f"{name:10s} {bare * 1e6:9.1f} us {cones * 1e6:9.1f} us x{cones / bare:4.1f} "
            f"{whole * 1e6:9.1f} us {1 / whole:7.0f} frames/s"
        )


def _peak(path: str, data: Path) -> float:
    """Peak memory (MB) of a fresh process that judges this clip, as the command line does."""
    character = character_of(data)
    clip = open_clip(path, character=character, fps=FPS, quat="wxyz")
    report = validate(clip, character, settings=Settings(profile="robot", lowpass_hz=6))
    render_text(report)
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _write(path: str, data: Path, minutes: int) -> None:
    clip = clip_of(data, character_of(data), "walk", int(minutes * 60 * FPS))
    if path.endswith(".npz"):
        clip.save(path)
    else:
        np.savetxt(path, clip.qpos, delimiter=",", fmt="%.6f")


def memory(data: Path) -> None:
    with TemporaryDirectory() as folder:
        for suffix in ("npz", "csv"):
            first = 0.0
            for minutes in (1, 10, 60):
                path = f"{folder}/{minutes}.{suffix}"
                # Both in fresh processes: a child's peak begins with its parent's size.
                _afresh(_write, path, data, minutes)
                peak = _afresh(_peak, path, data)
                first = first or peak
                print(f"{suffix}, {minutes:3d} min: peak {peak:4.0f} MB, x{peak / first:.2f}")


def _afresh(work: Callable[..., T], *given: object) -> T:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(work, *given).result()


def _judge(data: Path, names: tuple[str, ...]) -> int:
    character = character_of(data)
    settings = Settings(profile="robot", lowpass_hz=6)
    clips = {name: clip_of(data, character, name, 150) for name in set(names)}
    return sum(validate(clips[name], character, settings=settings).errors for name in names)


def many(data: Path, clips: int = 1000, workers: int = 2) -> None:
    names = tuple(CLIPS[i % len(CLIPS)] for i in range(clips))
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    with ProcessPoolExecutor(workers) as pool:
        list(pool.map(partial(_judge, data), [names[i::workers] for i in range(workers)]))
    spent = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    print(
        f"{clips} clips of 5 s on {workers} processes: {time.perf_counter() - start:.1f} s, "
        f"{spent:.1f} s of processor time"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    beside = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
    told = os.environ.get("PHYSRETARGET_DATA", str(beside))
    parser.add_argument("data", nargs="?", type=Path, default=Path(told))
    parts = ("memory", "speed", "many")  # memory first, while this process is small
    parser.add_argument("--only", nargs="+", choices=parts, default=parts, help="some of the parts")
    parser.add_argument("--clips", type=int, default=1000, help="how many short clips")
    options = parser.parse_args()
    data = options.data
    if not (data / "robot").is_dir():
        print(f"no robot clips in {data}: set PHYSRETARGET_DATA")
        return
    print(f"load average at the start: {os.getloadavg()[0]:.1f}")
    works = (partial(memory, data), partial(speed, data), partial(many, data, options.clips))
    for part, work in zip(parts, works, strict=True):
        if part in options.only:
            work()


if __name__ == "__main__":
    main()
