"""How far a character turns by the actor's momentum, and by the actor's heading.

    python -m benchmarks.heading

The lamp, held in its reference pose, is placed on the demo package's captures. Prints degrees
turned over the clip, left positive.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pybullet_data

from physretarget import capture, momentum
from physretarget.demo import models_folder
from physretarget.mjcf import Character, actor_character
from physretarget.mjcf.dynamics import lowpass
from physretarget.options.retargeting import Heading

MOTIONS = Path(pybullet_data.getDataPath()) / "data" / "motions"
NAMES = ("walk", "run", "jump", "dance_a", "spin", "kick", "spinkick", "cartwheel")


def turned(lamp: Character, name: str) -> tuple[float, float]:
    """Degrees turned with heading "momentum" and with "actor"."""
    motion = capture.load(MOTIONS / f"humanoid3d_{name}.txt")
    actor = actor_character(motion.shape)
    moved = lowpass(actor, motion.qpos, motion.fps, 6.0)
    pose = np.tile(lamp.reference_qpos, (len(moved), 1))
    headings: tuple[Heading, ...] = ("momentum", "actor")
    yaws = [
        momentum.place(lamp, pose, actor, moved, motion.time, heading=heading).yaw
        for heading in headings
    ]
    first, second = (float(np.degrees(np.unwrap(yaw)[-1] - yaw[0])) for yaw in yaws)
    return first, second


if __name__ == "__main__":
    character = Character.load(models_folder() / "lamp.xml")
    for clip in NAMES:
        by_momentum, by_actor = turned(character, clip)
        print(f"{clip}: {by_momentum:.0f} by momentum, {by_actor:.0f} as the actor")
