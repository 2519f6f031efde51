"""How fast inverse kinematics and contact adjustment are, in frames per second of CPU time.

Run: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python benchmarks/ik_contact.py [MODEL.xml]
"""

from __future__ import annotations

import sys
import time as clock
from pathlib import Path
from typing import Any

import numpy as np

from physretarget import ik, kinematics
from physretarget.contact import Phases, adjust
from physretarget.features import features
from physretarget.mjcf import Character

NAMES = ("left_heel", "left_toe", "right_heel", "right_toe")


def best_of(repeats: int, work, *args, **more) -> tuple[float, Any]:
    seconds, result = float("inf"), None
    for _ in range(repeats):
        start = clock.process_time()
        result = work(*args, **more)
        seconds = min(seconds, clock.process_time() - start)
    return seconds, result


def walk(time: np.ndarray) -> np.ndarray:
    def foot(phase: np.ndarray) -> list[np.ndarray]:
        return [phase < 0.4, (phase > 0.06) & (phase < 0.6)]

    return np.stack([*foot(time % 1.0), *foot((time + 0.5) % 1.0)], axis=1)


def main() -> None:
    default = Path(__file__).parents[1] / "models" / "lamp.xml"
    character = Character.load(sys.argv[1] if len(sys.argv) > 1 else default)
    time = np.arange(900) / 30.0
    speed = 1.0 + np.arange(character.tree.nv) % 5
    step = 0.25 * np.sin(np.outer(time, speed))
    step[:, :3], step[:, 5] = 0.0, 0.0
    step[:, 3:5] *= 0.2
    still = np.tile(character.reference_qpos, (len(time), 1))
    poses = np.clip(
        kinematics.integrate(character.tree, still, step), character.lower, character.upper
    )
    asked = features(character, ik.facing_forward(character, poses))
    noisy = asked + 0.004 * np.random.default_rng(0).standard_normal(asked.shape)
    for label, wanted in (("exact", asked), ("4 mm noise", noisy)):
        seconds, found = best_of(3, ik.follow, character, wanted, 30.0)
        rms = 1000 * float(found.residual_rms.mean())
        print(f"ik, {label}: {len(time) / seconds:8.0f} frames/s, residual {rms:.3f} mm")
    walked, turned = poses.copy(), poses.copy()
    walked[:, 0] += 0.2 * time
    spin = kinematics.rotvec_to_quat(np.outer(1.5 * time, [0.0, 0.0, 1.0]))
    turned[:, 3:7] = kinematics.quat_multiply(spin, poses[:, 3:7])
    always = np.ones((len(time), len(NAMES)), dtype=bool)
    for label, placed, active in (("walk", walked, walk(time)), ("turn", turned, always)):
        phases = Phases(NAMES, active, time)
        seconds, done = best_of(3, adjust, character, placed, time, phases)
        print(
            f"contact, {label}:  {len(time) / seconds:8.0f} frames/s, {len(done.stances)} stances, "
            f"slide {1000 * done.slide_max_m:.3f} mm, sink {1000 * done.sink_max_m:.3f} mm"
        )


if __name__ == "__main__":
    main()
