"""The stream: latency per frame, and how far its poses are from the batch path's.

    python benchmarks/stream.py [--characters lamp penguin squirrel]

One BLAS thread. Every capture is streamed five times: "first pass" is wall time as it was, with
whatever else the machine was busy with; "best of five" is each frame's fastest pass.
"""

from __future__ import annotations

import argparse
import gc
import time as clock
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from physretarget import capture, kinematics
from physretarget.capture.actor import ActorShape
from physretarget.demo import motions_folder
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.pipeline import RetargetSettings, retarget
from physretarget.stream import Streamer
from physretarget.trained import learn

MODELS = Path(__file__).resolve().parents[1] / "models"
CAPTURES = ("walk", "jump", "dance_a", "dance_b", "run", "kick", "backflip")


def apart(character: Character, a: NDArray[np.float64], b: NDArray[np.float64]) -> str:
    """Median and 99th percentile over frames of the RMS marker distance, % of the height."""
    at = [
        kinematics.points(
            kinematics.forward(character.tree, q), character.markers.body, character.markers.local
        )
        for q in (a, b)
    ]
    rms = np.sqrt(np.mean(np.sum((at[0] - at[1]) ** 2, axis=2), axis=1)) / character.height
    return "{:.2f} / {:.1f}".format(*(100 * np.percentile(rms, [50, 99])))


def main() -> None:
    """A table per character."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--characters", nargs="+", default=["lamp", "penguin", "squirrel"])
    for name in options.parse_args().characters:
        character = Character.load(MODELS / f"{name}.xml")
        files = [MODELS / f"{name}{kind}.keyposes.toml" for kind in ("", ".bandai-nc")]
        mapper = learn(character, load_keyposes(files, character))
        print(f"\n{name}: {len(mapper.names)} key poses\n")
        print(
            "| capture | frames | first pass, ms: median / p99 | best of five "
            "| mapped apart, % | placed apart, % | contacted apart, % | phases agree |"
        )
        print("|---|---|---|---|---|---|---|---|")
        every: list[NDArray[np.float64]] = []
        for take in CAPTURES:
            motion = capture.load(motions_folder() / f"humanoid3d_{take}.txt").resampled(60.0)
            motion = motion.on(ActorShape.reference())
            batch = retarget(motion, mapper, settings=RetargetSettings(until="contacted"))
            passes = []
            for _ in range(5):
                streamer, posed, spent = Streamer(mapper), [], []
                gc.collect()
                gc.freeze()
                for time, qpos in zip(batch.motion.time, batch.motion.qpos, strict=True):
                    began = clock.perf_counter()
                    posed.append(streamer.next(float(time), qpos))
                    spent.append(clock.perf_counter() - began)
                passes.append(spent)
            times = 1e3 * np.array(passes)
            every.append(np.stack([times[0], times.min(axis=0)], axis=1))
            assert batch.placed is not None
            assert batch.contacted is not None
            assert batch.phases is not None
            agree = np.mean([p.touch.active for p in posed] == batch.phases.active)
            cells = [
                f"{take} | {len(posed)}",
                _times(every[-1][:, 0]),
                _times(every[-1][:, 1]),
                apart(character, np.array([p.mapped for p in posed]), batch.pose.qpos),
                apart(character, np.array([p.placed for p in posed]), batch.placed.qpos),
                apart(character, np.array([p.qpos for p in posed]), batch.contacted.qpos),
                f"{agree:.1%}",
            ]
            print("| " + " | ".join(cells) + " |")
        whole = np.concatenate(every)
        print(f"| all | {len(whole)} | {_times(whole[:, 0])} | {_times(whole[:, 1])} | | | | |")


def _times(spent: NDArray[np.float64]) -> str:
    return "{:.2f} / {:.2f}".format(*np.percentile(spent, [50, 99]))


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        main()
