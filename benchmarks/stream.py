"""The stream: latency per frame, and how far its poses are from the batch path's.

    python benchmarks/stream.py [--characters lamp penguin squirrel]

One BLAS thread. The last columns stream it again, told what only the
future shows: the batch's contact phases, then also where it plants each point. Every capture is
streamed five times: "first pass" is wall time as it was, with
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
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.stream import Streamer
from physretarget.trained import TrainedMapper, learn

MODELS = Path(__file__).resolve().parents[1] / "models"
CAPTURES = ("walk", "jump", "dance_a", "dance_b", "run", "kick", "backflip")


def apart(character: Character, a: NDArray[np.float64], b: NDArray[np.float64]) -> str:
    """Median and 99th percentile over frames of the RMS marker distance, % of the height."""
    return _percent(difference(character, a, b), character.height)


def drift_apart(character: Character, a: NDArray[np.float64], b: NDArray[np.float64]) -> str:
    """As :func:`apart`, then with the two moved over each other horizontally in every frame."""
    away = difference(character, a, b)
    drift = away.mean(axis=1, keepdims=True)
    drift[..., 2] = 0.0
    return f"{_percent(away, character.height)} → {_percent(away - drift, character.height)}"


def difference(
    character: Character, a: NDArray[np.float64], b: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Of the virtual markers (T, K, 3), m."""
    at = [
        kinematics.points(
            kinematics.forward(character.tree, q), character.markers.body, character.markers.local
        )
        for q in (a, b)
    ]
    return at[0] - at[1]


def _percent(away: NDArray[np.float64], height: float) -> str:
    rms = np.sqrt(np.mean(np.sum(away**2, axis=2), axis=1)) / height
    return "{:.2f} / {:.1f}".format(*(100 * np.percentile(rms, [50, 99])))


def told(
    mapper: TrainedMapper, batch: Retargeted, *, phases: bool, places: bool
) -> NDArray[np.float64]:
    """Poses (T, nq) of a stream that is told the batch's contact phases, or its places too."""
    assert batch.phases is not None
    assert batch.contacted is not None
    streamer = Streamer(mapper)
    return np.array(
        [
            streamer.next(
                float(time),
                qpos,
                planted=batch.phases.active[k] if phases else None,
                places=batch.contacted.target[k] if places else None,
            ).qpos
            for k, (time, qpos) in enumerate(zip(batch.motion.time, batch.motion.qpos, strict=True))
        ]
    )


def main() -> None:
    """A table per character."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--characters", nargs="+", default=["lamp", "penguin", "squirrel"])
    for name in options.parse_args().characters:
        character = Character.load(MODELS / f"{name}.xml")
        files = sorted(MODELS.glob(f"{name}*.keyposes.toml"))
        mapper = learn(character, load_keyposes(files, character))
        print(f"\n{name}: {len(mapper.names)} key poses\n")
        print(
            "| capture | frames | first pass, ms: median / p99 | best of five "
            "| mapped apart, % | placed apart, % | phases agree | contacted apart → moved over "
            "each other: own phases | batch's phases | and places |"
        )
        print("|---|---|---|---|---|---|---|---|---|---|")
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
                f"{agree:.1%}",
                *(
                    drift_apart(
                        character,
                        told(mapper, batch, phases=phases, places=places),
                        batch.contacted.qpos,
                    )
                    for phases, places in ((False, False), (True, False), (True, True))
                ),
            ]
            print("| " + " | ".join(cells) + " |")
        whole = np.concatenate(every)
        print(f"| all | {len(whole)} | {_times(whole[:, 0])} | {_times(whole[:, 1])} | | | | | | |")


def _times(spent: NDArray[np.float64]) -> str:
    return "{:.2f} / {:.2f}".format(*np.percentile(spent, [50, 99]))


if __name__ == "__main__":
    with threadpool_limits(limits=1):
        main()
