"""What the root's lower limit costs: the dances of the demo with it and without.

    python -m benchmarks.floor_limit

Prints by how much the mismatch of vertical forces falls in the root-height stage.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pybullet_data

from physretarget import capture, ocp
from physretarget.demo import models_folder
from physretarget.features import features
from physretarget.pipeline import RetargetSettings, retarget
from physretarget.reproduce.takes import learned

MOTIONS = Path(pybullet_data.getDataPath()) / "data" / "motions"
LIMITED = ocp.RootHeightSettings.preset("default")


def fall(character: str, dance: str) -> tuple[float, float]:
    """The relative fall of the mismatch with the lower limit, and without."""
    mapper = learned(models_folder(), character)
    motion = capture.load(MOTIONS / f"humanoid3d_{dance}.txt")
    made = retarget(motion, mapper, settings=RetargetSettings(until="contacted"))
    assert made.contacted is not None
    qpos, active = made.contacted.qpos, made.contacted.active

    def with_limit(floor: float) -> float:
        return ocp.optimise(
            made.character,
            qpos,
            made.motion.time,
            active,
            pose_error=features(made.character, qpos) - made.mapped.mean,
            pose_variance=made.mapped.variance,
            settings=replace(LIMITED, floor=floor),
        ).improvement

    return with_limit(LIMITED.floor), with_limit(math.inf)


if __name__ == "__main__":
    for character in ("penguin", "squirrel", "lamp"):
        for dance in ("dance_a", "dance_b"):
            limited, free = fall(character, dance)
            print(f"{character} {dance}: falls by {limited:.0%}, without the limit by {free:.0%}")
