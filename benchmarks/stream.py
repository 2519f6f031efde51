"""The stream: latency per frame, and how far its poses are from the batch path's.

    python -m benchmarks.stream [--characters penguin squirrel lamp] [--data FOLDER]
                                [--delays 0 0.25 0.5 1] [--passes 12] [--only latency|travel]

Prints all tables of docs/measured/stream.md. Captures: those of the pybullet wheel, and of FOLDER
($PHYSRETARGET_DATA) where it is present. The stream is fed the batch path's own filtered
frames at 60 per second, with one BLAS thread.
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
TIMED = {"walk": None, "jump": None, "walk_normal": 150}
"""Captures that are timed, and how many of their frames."""


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


def streamed(
    mapper: TrainedMapper, batch: Retargeted, delay: float, frames: int | None = None
) -> tuple[list[Posed], Array]:
    """The poses of all frames (or the first ones), and how many ms each call took."""
    streamer = Streamer(mapper, delay=delay)
    found: list[Posed] = []
    spent: list[float] = []
    gc.collect()
    gc.freeze()
    motion = batch.motion
    for time, qpos in zip(motion.time[:frames].tolist(), motion.qpos[:frames], strict=True):
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


def _print(head: list[str], rows: list[list[str]]) -> None:
    print("\n| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print(flush=True)


def timed(mapper: TrainedMapper, batches: dict[str, Retargeted], passes: int) -> tuple[Array, ...]:
    """ms of every frame in the first pass, and in its fastest of all ``passes``."""
    first, fastest = [], []
    for name, frames in TIMED.items():
        if name in batches:
            spent = [streamed(mapper, batches[name], 0.0, frames)[1] for _ in range(passes)]
            first.append(spent[0])
            fastest.append(np.min(spent, axis=0))
    return np.concatenate(first), np.concatenate(fastest)


def _latency(found: dict[str, tuple[Array, ...]], passes: int) -> None:
    rows = [
        [f"{which}: {kind}", *(f"{np.percentile(ms[k], share):.2f}" for ms in found.values())]
        for k, which in enumerate(("first pass", f"fastest of {passes} passes"))
        for kind, share in (("median", 50), ("99th percentile", 99))
    ]
    _print(["ms per frame", *found], rows)


def _captures(apart: dict[str, Apart]) -> None:
    head = ["capture", "frames", "mapped", "placed", "shape", "drift"]
    rows = []
    for name, a in apart.items():
        cells = [name, str(len(a.shape)), _two(a.mapped), _two(a.placed), _two(a.shape)]
        rows.append([*cells, _two(a.drift), "{:.1f} : {:.1f}".format(*a.step), f"{a.slid:.1f}"])
    _print([*head, "largest step, stream : batch", "held points slide, mm"], rows)


def _over_all(found: list[Apart]) -> list[str]:
    """Shape and drift over all frames and of the worst capture, drift of halves."""
    cells: list[str] = []
    for values in ([a.shape for a in found], [a.drift for a in found]):
        worst = max(float(np.median(v)) for v in values)
        cells += [_two(np.concatenate(values)), f"{worst:.1f}"]
    halves = [np.array_split(a.drift, 2) for a in found if len(a.drift) >= 360]
    medians = [np.median(np.concatenate(half)) for half in zip(*halves, strict=True)]
    return [*cells, " : ".join(f"{median:.1f}" for median in medians)]


def _delays(apart: dict[str, dict[float, list[Apart]]]) -> None:
    head = ["character", "delay, s", "shape, all frames", "worst capture's median"]
    head += ["drift, all frames", "worst capture's median"]
    rows = [
        [name, f"{delay:g}", *_over_all(found)]
        for name, each in apart.items()
        for delay, found in each.items()
    ]
    _print([*head, "drift, first : second half of clips over 6 s"], rows)


def _delays_in_short(apart: dict[str, dict[float, list[Apart]]], delays: list[float]) -> None:
    def cell(found: list[Apart]) -> str:
        both = (np.concatenate([a.shape for a in found]), np.concatenate([a.drift for a in found]))
        return ", ".join(f"{np.median(each):.1f}" for each in both)

    rows = [[name, *(cell(found) for found in each.values())] for name, each in apart.items()]
    _print(
        ["shape, drift (median of all frames) at a delay of", *(f"{d:g} s" for d in delays)], rows
    )


def walks(data: Path | None) -> Iterator[tuple[str, ActorMotion]]:
    """Walks of three sources, their first seven seconds."""
    files = [motions_folder() / "humanoid3d_walk.txt"]
    if data is not None:
        files += [data / "bvh/bandai/dataset-1_walk_normal_001.bvh"]
        files += [data / f"bvh/cmu/131_0{k}.bvh" for k in (1, 2)]
    for path in files:
        if path.is_file():
            motion = capture.load(path).resampled(60.0).on(ActorShape.reference())
            yield path.stem, motion.cut(0, min(len(motion.time), 421) - 1)


def _travel(characters: list[str], data: Path | None) -> None:
    """How far walks come, from the first frame to the last: stream, batch path and its placing."""
    rows = []
    for name in characters:
        mapper = learned(name)
        at = mapper.character.root_qpos
        for walk, motion in walks(data):
            batch = retarget(motion, mapper, settings=RetargetSettings(until="contacted"))
            assert batch.placed is not None
            posed, _ = streamed(mapper, batch, 0.0)
            ways = [
                float(np.linalg.norm(qpos[-1, at : at + 2] - qpos[0, at : at + 2]))
                for qpos in (np.array([p.qpos for p in posed]), batch.clip.qpos, batch.placed.qpos)
            ]
            shape = float(np.median(compared(posed, batch).shape))
            rows.append(
                [name, walk, *(f"{way:.2f}" for way in ways),
                 f"{100 * ways[0] / ways[1] - 100:+.0f}", f"{shape:.1f}"]
            )  # fmt: skip
    _print(["character", "walk", "stream, m", "batch, m", "placed, m", "stream : batch, %",
            "shape, %"], rows)  # fmt: skip


def main() -> None:
    """All tables."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--characters", nargs="+", default=["penguin", "squirrel", "lamp"])
    options.add_argument("--data", type=Path, default=os.environ.get("PHYSRETARGET_DATA"))
    options.add_argument("--delays", nargs="+", type=float, default=[0.0, 0.25, 0.5, 1.0])
    options.add_argument("--passes", type=int, default=12)
    options.add_argument("--only", choices=["latency", "travel"])
    told = options.parse_args()
    if told.only == "travel":
        _travel(told.characters, Path(told.data) if told.data else None)
        return
    motions = dict(captures(Path(told.data) if told.data else None))
    if told.only:
        motions = {name: motion for name, motion in motions.items() if name in TIMED}
    settings = RetargetSettings(until="contacted")
    latency: dict[str, tuple[Array, ...]] = {}
    apart: dict[str, dict[float, list[Apart]]] = {}
    for name in told.characters:
        mapper = learned(name)
        batches = {n: retarget(m, mapper, settings=settings) for n, m in motions.items()}
        print(f"{name}: {len(mapper.names)} key poses", flush=True)
        latency[name] = timed(mapper, batches, told.passes)
        if not told.only:
            apart[name] = {
                delay: [compared(streamed(mapper, b, delay)[0], b) for b in batches.values()]
                for delay in told.delays
            }
    if apart:
        _delays_in_short(apart, told.delays)
    _latency(latency, told.passes)
    for name, each in apart.items():
        print(f"{name}:")
        _captures(dict(zip(motions, each[told.delays[0]], strict=True)))
    if apart:
        _delays(apart)


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        main()
