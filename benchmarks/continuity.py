"""Do the mapped poses follow each other? Every capture on every character, three ways.

    python -m benchmarks.continuity [--data FOLDER] [--every N]

Joint steps are those of hinges from one frame to the next; the markers' miss is their RMS
distance from the mapped features, in percent of the height. A frame jumps after a hold where
its step is above 240 °/s and more than three times the smaller one beside it.
"""

from __future__ import annotations

import argparse
import os
import time as clock
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.quality import MODELS
from physretarget import capture, ik, kinematics
from physretarget.capture.actor import ActorShape
from physretarget.demo import motions_folder
from physretarget.errors import PhysretargetError
from physretarget.features import features
from physretarget.mjcf import Character
from physretarget.pipeline import RetargetSettings, retarget
from physretarget.reproduce.takes import learned
from physretarget.stream.pose import Follower

Array = NDArray[np.float64]
Answer = Callable[[Character, Array, Array, float], Array]
CHARACTERS = ("lamp", "penguin", "squirrel")
FASTEST_HOLD = 240.0


def each_alone(character: Character, mean: Array, start: Array, fps: float) -> Array:
    return ik.solve(character, mean, start=start).qpos


def together(character: Character, mean: Array, start: Array, fps: float) -> Array:
    return ik.follow(character, mean, fps, start=start).qpos


def as_they_come(character: Character, mean: Array, start: Array, fps: float) -> Array:
    follower = Follower(character)
    poses = []
    for target, near in zip(mean.reshape(len(mean), -1, 3), start, strict=True):
        follower.before = follower.next(target, 1.0 / fps, near)
        poses.append(follower.before)
    return np.array(poses)


WAYS: dict[str, Answer] = {
    "each frame alone": each_alone,
    "the clip as one motion": together,
    "stream": as_they_come,
}


def judged(character: Character, mean: Array, qpos: Array, fps: float) -> tuple[float, ...]:
    """Largest step and its 99th percentile (°), frames that jump after a hold, miss (%)."""
    hinges = [joint.dof for joint in character.tree.joints if joint.kind == "hinge"]
    change = np.degrees(kinematics.difference(character.tree, qpos[:-1], qpos[1:])[:, hinges])
    step = np.abs(change).max(axis=1)
    beside = np.minimum(step[:-2], step[2:])
    jumps = (step[1:-1] * fps > FASTEST_HOLD) & (step[1:-1] > 3.0 * beside)
    miss = features(character, qpos) - mean
    rms = np.sqrt(3.0 * np.mean(miss**2)) / character.height
    return step.max(), float(np.percentile(step, 99)), float(jumps.sum()), 100.0 * rms


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=os.environ.get("PHYSRETARGET_DATA"))
    parser.add_argument("--every", type=int, default=1, help="only every n-th capture")
    told = parser.parse_args()
    paths = sorted(motions_folder().glob("humanoid3d_*.txt"))
    for kind in ("bvh", "c3d", "trc") if told.data else ():
        paths += sorted(Path(told.data).rglob(f"*.{kind}"))
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    for path in paths[:: told.every]:
        try:
            motion = capture.load(path)
        except PhysretargetError as error:
            print(f"{path.name} left out: {error}")
            continue
        for name in CHARACTERS:
            mapper = learned(MODELS, name)
            mapped = retarget(motion, mapper, settings=RetargetSettings(until="mapped"))
            reference = mapped.motion.on(ActorShape.reference())
            start = mapper.nearest_pose(features(mapper.actor, reference.qpos))
            fps, mean = mapped.motion.fps, mapped.mapped.mean
            for way, answer in WAYS.items():
                began = clock.process_time()
                qpos = answer(mapper.character, mean, start, fps)
                spent = (clock.process_time() - began) / mapped.clip.duration
                figures = (*judged(mapper.character, mean, qpos, fps), 1000.0 * spent)
                rows.setdefault((name, way), []).append(figures)
    print(
        "| character | way | clips | largest step, ° (mean, worst) | 99th percentile, ° |", end=""
    )
    print(" jumps after holds | markers' miss, % | ms per s |\n|---|---|---|---|---|---|---|---|")
    for (name, way), found in rows.items():
        table = np.array(found)
        step, high, _, miss, cost = table.mean(axis=0)
        print(
            f"| {name} | {way} | {len(table)} | {step:.0f}, {table[:, 0].max():.0f} | {high:.0f} | "
            f"{int(table[:, 2].sum())} | {miss:.2f} | {cost:.0f} |"
        )


if __name__ == "__main__":
    main()
