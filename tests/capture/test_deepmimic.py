from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.capture import load
from physretarget.capture.actor import SEGMENT
from physretarget.capture.deepmimic import read_deepmimic
from physretarget.errors import InputError
from physretarget.kinematics import forward

ONE = [1.0, 0.0, 0.0, 0.0]
#        duration, root at, root turned, chest, neck, right leg, right arm, left leg, left arm
STILL = [0.05, 0.0, 0.9, 0.0, *ONE, *ONE, *ONE, *ONE, 0.0, *ONE, *ONE, 0.0, *ONE, 0.0, *ONE, *ONE, 0.0]  # fmt: skip  # noqa: E501


@pytest.fixture
def write(tmp_path: Path):
    def put(frames: Any) -> Path:
        path = tmp_path / "humanoid3d_made.txt"
        path.write_text(json.dumps({"Loop": "none", "Frames": frames}))
        return path

    return put


def test_values_by_hand(write) -> None:
    bent = list(STILL)
    bent[20] = -np.pi / 2  # right knee
    got = read_deepmimic(write([STILL, bent]))
    assert got.source.fps == 20.0
    at = {name: i for i, name in enumerate(got.names)}
    # the file's x (forward), y (up), z (right) are the world's y, z, x
    np.testing.assert_allclose(got.position[0, at["left_hip"]], [-0.084887, 0, 0.9], atol=1e-9)
    np.testing.assert_allclose(
        got.position[0, at["left_ankle"]], [-0.084887, 0, 0.9 - 0.421546 - 0.40987], atol=1e-9
    )
    np.testing.assert_allclose(
        got.position[1, at["right_ankle"]], [0.084887, -0.40987, 0.9 - 0.421546], atol=1e-9
    )


@pytest.mark.parametrize(
    ("change", "words", "frame"),
    [
        (lambda f: f[1].pop(), "44 numbers", 1),
        (lambda f: f[1].__setitem__(3, "x"), "not a number", 1),
        (lambda f: f[1].__setitem__(3, 1e300), "too large", 1),
        (lambda f: f[1].__setitem__(4, 0.0), "root is far from unit", 1),
        (lambda f: f[0].__setitem__(0, 0.0), "last", None),
        (lambda f: f.clear(), "non-empty", None),
    ],
)
def test_what_is_wrong_is_said(write, change: Any, words: str, frame: int | None) -> None:
    frames = [list(STILL), list(STILL)]
    change(frames)
    with pytest.raises(InputError, match=words) as caught:
        read_deepmimic(write(frames))
    assert caught.value.frame == frame


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", '{"Frames": 3}', "[" * 100_000, "\x00"])
def test_no_motion_at_all(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.txt"
    path.write_text(text)
    with pytest.raises(InputError):
        read_deepmimic(path)


def test_nan_frames_are_kept_for_the_caller_to_judge(write) -> None:
    gap = list(STILL)
    gap[4:8] = [float("nan")] * 4
    gap[20] = float("nan")
    got = read_deepmimic(write([STILL, gap, STILL]))
    assert np.isnan(got.rotation[1]).any()
    assert np.isfinite(got.rotation[[0, 2]]).all()


def test_a_quadruped_is_refused(motions: Path) -> None:
    with pytest.raises(InputError, match="not a humanoid3d"):
        load(motions / "laikago_walk.txt")


def test_every_published_motion_loads_as_a_human(motions: Path) -> None:
    files = sorted(motions.glob("humanoid3d_*.txt"))
    assert len(files) >= 15
    for path in files:
        motion = load(path)
        assert motion.marker_error_rms is not None
        assert motion.marker_error_rms < 1e-4, path.name
        quats = motion.qpos[:, 3:].reshape(len(motion.qpos), 18, 4)
        if len(quats) > 1:
            assert np.sum(quats[1:] * quats[:-1], axis=2).min() > 0.5, path.name
        for side in ("left", "right"):
            at = 3 + 4 * SEGMENT[f"{side}_shank"]
            turn = Rotation.from_quat(motion.qpos[:, at : at + 4], scalar_first=True)
            assert np.degrees(turn.as_rotvec()[:, 1]).min() > -15, path.name


def test_the_backflip_turns_over_backward(motions: Path) -> None:
    motion = load(motions / "humanoid3d_backflip.txt")
    up = forward(motion.shape.tree(), motion.qpos).rotation[:, 1, 2, 2]
    assert up.min() < -0.8
    assert min(up[0], up[-1]) > 0.8
    pelvis = Rotation.from_quat(motion.qpos[:, 3:7], scalar_first=True)
    steps = (pelvis[:-1].inv() * pelvis[1:]).as_rotvec()[:, 1]
    np.testing.assert_allclose(np.degrees(steps.sum()), -360, atol=60)


def test_the_cartwheel_stands_on_its_fists(motions: Path) -> None:
    motion = load(motions / "humanoid3d_cartwheel.txt")
    pose = forward(motion.shape.tree(), motion.qpos)
    lowest = []
    for side in ("left", "right"):
        i = SEGMENT[f"{side}_hand"]
        tip = pose.position[:, i + 1] + pose.rotation[:, i + 1] @ motion.shape.tip[i]
        lowest.append(tip[:, 2].min())
    assert all(abs(height) < 0.08 for height in lowest), lowest
