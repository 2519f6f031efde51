"""The stream: latency per frame, and how far its poses are from the batch path's.

    python -m benchmarks.stream [--characters lamp penguin squirrel] [--data FOLDER]
                                [--delays 0 0.25 0.5 1] [--passes 3]

Captures: those of the pybullet wheel, and of FOLDER ($PHYSRETARGET_DATA) where it is present. The
stream is fed the batch path's own filtered frames at 60 per second, with one BLAS thread.
"""

from __future__ import annotations

import argparse
import gc
import os
import time as clock
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from physretarget import capture, kinematics
from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.demo import models_folder, motions_folder
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.stream import Posed, Streamer
from physretarget.trained import TrainedMapper, learn

Array = NDArray[np.float64]

WHEEL = ("walk", "jump", "dance_a", "dance_b", "run", "kick", "backflip")
BANDAI = ("walk_normal", "walk_happy", "walk_sad", "run_normal", "run_angry", "bow_happy")
C3D = ("85_02", "cmu_02_05", "135_02")


@dataclass(frozen=True, kw_only=True, eq=False)
class Apart:
    """Stream against batch path, in percent of the character's height, per frame (T,).

    ``mapped`` and ``placed``: RMS over the virtual markers after those stages; ``shape`` the same
    after contact with the two moved over each other horizontally, ``drift`` by how much that was.
    ``step`` the largest RMS way of the markers from frame to frame, of stream and batch path;
    ``slid`` the farthest that a held point moved from one frame to the next, mm.
    """

    mapped: Array
    placed: Array
    shape: Array
    drift: Array
    step: tuple[float, float]
    slid: float


def markers(character: Character, qpos: Array) -> Array:
    """Virtual markers (T, K, 3), m."""
    pose = kinematics.forward(character.tree, qpos)
    return kinematics.points(pose, character.markers.body, character.markers.local)


def compared(posed: list[Posed], batch: Retargeted) -> Apart:
    """How far a stream's poses are from those of the batch path."""
    character = batch.character
    assert batch.placed is not None
    assert batch.contacted is not None

    def rms(away: Array) -> Array:
        result: Array = np.sqrt(np.mean(np.sum(away**2, axis=2), axis=1))
        return 100.0 * result / character.height

    qpos = np.array([p.qpos for p in posed])
    ours, theirs = markers(character, qpos), markers(character, batch.contacted.qpos)
    drift = (ours - theirs).mean(axis=1, keepdims=True) * (1.0, 1.0, 0.0)
    pose = kinematics.forward(character.tree, qpos)
    contacts = character.contacts
    points = kinematics.points(pose, contacts.body, contacts.local)
    held = np.array([p.active for p in posed])
    still = held[1:] & held[:-1]
    moved = np.linalg.norm(np.diff(points, axis=0), axis=2)[still]
    mapped = markers(character, np.array([p.mapped for p in posed]))
    placed = markers(character, np.array([p.placed for p in posed]))
    return Apart(
        mapped=rms(mapped - markers(character, batch.pose.qpos)),
        placed=rms(placed - markers(character, batch.placed.qpos)),
        shape=rms(ours - theirs - drift),
        drift=100.0 * np.linalg.norm(drift[:, 0], axis=1) / character.height,
        step=(float(rms(np.diff(ours, axis=0)).max()), float(rms(np.diff(theirs, axis=0)).max())),
        slid=1e3 * float(moved.max(initial=0.0)),
    )


def streamed(mapper: TrainedMapper, batch: Retargeted, delay: float) -> tuple[list[Posed], Array]:
    """The poses of all frames, and how many ms each call took."""
    streamer = Streamer(mapper, delay=delay)
    found: list[Posed] = []
    spent: list[float] = []
    gc.collect()
    gc.freeze()
    for time, qpos in zip(batch.motion.time.tolist(), batch.motion.qpos, strict=True):
        began = clock.perf_counter()
        posed = streamer.next(time, qpos)
        spent.append(clock.perf_counter() - began)
        found += [] if posed is None else [posed]
    return [*found, *streamer.rest()], 1e3 * np.array(spent)


def captures(data: Path | None) -> Iterator[tuple[str, ActorMotion]]:
    """Names and motions, of the reference actor at 60 frames per second."""
    files = [motions_folder() / f"humanoid3d_{name}.txt" for name in WHEEL]
    if data is not None:
        files += [data / f"bvh/bandai/dataset-1_{name}_001.bvh" for name in BANDAI]
        files += [data / f"c3d/{name}.c3d" for name in C3D]
    for path in files:
        if path.is_file():
            name = path.stem.removeprefix("humanoid3d_").removeprefix("dataset-1_")
            motion = capture.load(path).resampled(60.0).on(ActorShape.reference())
            yield name.removesuffix("_001"), motion


def learned(name: str) -> TrainedMapper:
    """A character with all its key poses."""
    character = Character.load(models_folder() / f"{name}.xml")
    files = sorted(models_folder().glob(f"{name}*.keyposes.toml"))
    return learn(character, load_keyposes(files, character))


def _two(values: Array) -> str:
    return "{:.1f} / {:.1f}".format(*np.percentile(values, [50, 99]))


def _table(mapper: TrainedMapper, batches: dict[str, Retargeted], passes: int) -> None:
    print(
        "| capture | frames | ms, first pass | best | mapped | placed | shape | drift "
        "| largest step, stream : batch | held points slide, mm |\n" + "|---" * 10 + "|"
    )
    every: list[Array] = []
    for name, batch in batches.items():
        times = []
        for _ in range(passes):
            posed, spent = streamed(mapper, batch, 0.0)
            times.append(spent)
        every.append(np.stack([times[0], np.min(times, axis=0)]))
        a = compared(posed, batch)
        cells = [name, str(len(posed))]
        cells += ["{:.2f} / {:.2f}".format(*np.percentile(t, [50, 99])) for t in every[-1]]
        cells += [_two(a.mapped), _two(a.placed), _two(a.shape), _two(a.drift)]
        cells += [f"{a.step[0]:.1f} : {a.step[1]:.1f}", f"{a.slid:.1f}"]
        print("| " + " | ".join(cells) + " |", flush=True)
    whole = np.concatenate(every, axis=1)
    cells = ["{:.2f} / {:.2f}".format(*np.percentile(t, [50, 99])) for t in whole]
    print(f"| all | {whole.shape[1]} | {cells[0]} | {cells[1]} | | | | | | |")


def _delays(mapper: TrainedMapper, batches: dict[str, Retargeted], delays: list[float]) -> None:
    print(
        "\n| delay, s | shape, all frames | shape, worst capture | drift, all frames "
        "| drift, worst capture | drift, first : second half of long clips |\n" + "|---" * 6 + "|"
    )
    for delay in delays:
        found = [compared(streamed(mapper, b, delay)[0], b) for b in batches.values()]
        cells = [f"{delay:g}"]
        for values in ([a.shape for a in found], [a.drift for a in found]):
            worst = max(values, key=lambda v: float(np.median(v)))
            cells += [_two(np.concatenate(values)), f"{np.median(worst):.1f}"]
        halves = [np.array_split(a.drift, 2) for a in found if len(a.drift) >= 360]
        medians = [np.median(np.concatenate(half)) for half in zip(*halves, strict=True)]
        cells.append(" : ".join(f"{median:.1f}" for median in medians))
        print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    """Two tables per character."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--characters", nargs="+", default=["lamp", "penguin", "squirrel"])
    options.add_argument("--data", type=Path, default=os.environ.get("PHYSRETARGET_DATA"))
    options.add_argument("--delays", nargs="+", type=float, default=[0.0, 0.25, 0.5, 1.0])
    options.add_argument("--passes", type=int, default=3)
    told = options.parse_args()
    motions = dict(captures(Path(told.data) if told.data else None))
    for name in told.characters:
        mapper = learned(name)
        settings = RetargetSettings(until="contacted")
        batches = {n: retarget(m, mapper, settings=settings) for n, m in motions.items()}
        print(f"\n{name}: {len(mapper.names)} key poses\n")
        _table(mapper, batches, told.passes)
        _delays(mapper, batches, told.delays)


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        main()
