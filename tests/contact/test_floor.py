"""On real captures: no part of any character sinks, planted points do not skate."""

from __future__ import annotations

from pathlib import Path

import pytest

from physretarget import capture, kinematics
from physretarget.demo import models_folder
from physretarget.ground.undersides import lowest_heights, solids
from physretarget.pipeline import retarget
from physretarget.reproduce.takes import PENETRATION_LIMIT, SKATE_LIMIT, learned, planted

CASES = {
    "lamp": ("run_angry", "walk_happy"),
    "penguin": ("walk_angry", "walk_normal", "run_sad"),
    "squirrel": ("walk_tired", "run_angry"),
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_no_part_of_a_body_sinks_and_no_planted_point_skates(data: Path, name: str) -> None:
    mapper = learned(models_folder(), name)
    character = mapper.character
    every = solids(character)
    for action in CASES[name]:
        path = data / "bvh" / "bandai" / f"dataset-1_{action}_001.bvh"
        result = retarget(capture.load(path), mapper)
        assert result.contacted is not None
        assert result.physical is not None
        for qpos in (result.contacted.qpos, result.physical.qpos):
            low = lowest_heights(every, kinematics.forward(character.tree, qpos)).min()
            assert low - character.floor_height > -PENETRATION_LIMIT, action
        _, skate = planted(
            character, result.physical.qpos, result.contacted.active, result.motion.time
        )
        assert skate < SKATE_LIMIT
        assert result.contacted.slide_max_m < 0.002
        assert result.contacted.sink_max_m < 0.005
