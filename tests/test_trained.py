from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physretarget.demo import models_folder
from physretarget.errors import InputError
from physretarget.features import features
from physretarget.ik import solve
from physretarget.keyposes import load_keyposes
from physretarget.mapping import NAMES
from physretarget.mjcf import Character
from physretarget.trained import TrainedMapper, learn

MODELS = models_folder()


@pytest.fixture(scope="module")
def lamp() -> Character:
    return Character.load(MODELS / "lamp.xml")


@pytest.fixture(scope="module")
def trained(lamp: Character) -> TrainedMapper:
    return learn(lamp, load_keyposes([MODELS / "lamp.keyposes.toml"], lamp))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_key_poses_come_back_within_two_percent_of_the_height(
    lamp: Character, trained: TrainedMapper
) -> None:
    mapped = trained.mapper.predict(trained.y).mean
    assert rms(mapped - trained.z) < 0.02 * lamp.height
    # One by one: as frames of a clip they would be 62 leaps.
    posed = [
        solve(lamp, one[None], start=pose[None]).qpos[0]
        for one, pose in zip(mapped, trained.nearest_pose(trained.y), strict=True)
    ]
    assert rms(features(lamp, np.array(posed)) - trained.z) < 0.02 * lamp.height


def test_a_key_pose_is_nearest_to_itself(trained: TrainedMapper) -> None:
    assert np.array_equal(trained.nearest_pose(trained.y), trained.qpos)


@pytest.mark.parametrize("name", NAMES)
def test_saved_and_loaded_it_maps_the_same(lamp: Character, tmp_path: Path, name: str) -> None:
    keyposes = load_keyposes([MODELS / "lamp.keyposes.toml"], lamp)
    before = learn(lamp, keyposes, mapper=name)
    before.save(tmp_path / "a.npz")
    after = TrainedMapper.load(tmp_path / "a.npz", lamp)
    y = 0.5 * (before.y[1:] + before.y[:-1])
    assert np.array_equal(before.mapper.predict(y).mean, after.mapper.predict(y).mean)
    assert (after.names, after.sources, after.sha256) == (
        before.names, before.sources, before.sha256,
    )  # fmt: skip
    after.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_files_of_other_kinds_are_refused(lamp: Character, tmp_path: Path) -> None:
    np.savez(tmp_path / "clip.npz", qpos=np.zeros((3, 12)))
    with pytest.raises(InputError, match="not a mapper file"):
        TrainedMapper.load(tmp_path / "clip.npz", lamp)
    with pytest.raises(InputError, match="cannot be read"):
        TrainedMapper.load(tmp_path / "no.npz", lamp)


def test_a_character_that_stands_fixed_is_refused(trained: TrainedMapper, lamp: Character) -> None:
    text = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    fixed = Character.from_xml(text, name="fixed")
    keyposes = load_keyposes([MODELS / "lamp.keyposes.toml"], lamp)
    with pytest.raises(InputError, match="no free joint"):
        learn(fixed, keyposes)
