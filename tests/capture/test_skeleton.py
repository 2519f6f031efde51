from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget.capture.actor import PARENTS, SEGMENTS, ActorShape
from physretarget.capture.joints import fit_joints
from physretarget.capture.skeleton import Raw, finish, nice_rate, to_world
from physretarget.errors import InputError, UsageError
from physretarget.kinematics import forward
from physretarget.options.motion import CAPTURE_UNITS as UNITS


def standing(height: float, scale: float, up: str, frames: int = 5) -> Raw:
    """A standing human of ``height`` metres in a file whose unit is ``scale`` metres."""
    shape = ActorShape.reference(height)
    qpos = np.zeros((frames, 75))
    qpos[:, 2] = shape.offset[0, 2]
    qpos[:, 3::4] = 1.0
    turn = to_world(up).T
    return Raw(
        path="made.bvh",
        sha256="0" * 64,
        format="bvh",
        fps=30.0,
        names=tuple({"pelvis": "hips", "head": "neck"}.get(name, name) for name in SEGMENTS),
        parents=PARENTS,
        position=forward(shape.tree(), qpos).position[:, 1:] @ turn.T / scale,
        rotation=np.tile(np.eye(3), (frames, len(SEGMENTS), 1, 1)),
    )


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("height", [1.0, 1.45, 1.75, 2.0])
@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_unit_and_up_axis_are_found_and_stated(unit: str, height: float, up: str) -> None:
    got = finish(standing(height, UNITS[unit], up), unit=None, up=None)
    assert got.source.unit == unit
    assert got.source.up == up
    assert any(f"unit guessed as {unit}" in note for note in got.notes)
    assert any(f"up axis found as {up}" in note for note in got.notes)
    motion = fit_joints(got)
    np.testing.assert_allclose(motion.shape.leg_length, 0.53 * height, rtol=0.03)
    np.testing.assert_allclose(np.abs(motion.qpos[:, 7::4]), 1.0, atol=1e-6)


@pytest.mark.parametrize(("stated", "found"), [("inch", "inch"), ("0.05", "0.05"), ("m", "cm")])
def test_the_file_s_own_word_holds_unless_it_makes_a_giant(stated: str, found: str) -> None:
    scale = 0.01 if found == "cm" else 0.03
    got = finish(replace(standing(1.75, scale, "y"), unit=stated), unit=None, up=None)
    assert got.source.unit == found


def test_an_unknown_unit_is_scaled_and_said() -> None:
    got = finish(standing(1.75, 20.0, "y"), unit=None, up=None)
    assert any("no known unit fits" in note for note in got.notes)
    np.testing.assert_allclose(float(got.source.unit), 20.0, rtol=0.01)


def test_what_is_told_is_obeyed_and_not_called_a_guess() -> None:
    got = finish(standing(1.75, 0.01, "y"), unit="mm", up="z")
    assert (got.source.unit, got.source.up) == ("mm", "z")
    assert got.notes == ()


def test_a_wrong_unit_is_refused_by_the_fit() -> None:
    with pytest.raises(InputError, match="tell the right unit"):
        fit_joints(finish(standing(1.75, 0.01, "y"), unit="mm", up="y"))


@pytest.mark.parametrize("unit", ["furlong", "", "0", "-1", "nan", "inf"])
def test_unknown_units_are_usage_errors(unit: str) -> None:
    with pytest.raises(UsageError):
        finish(standing(1.75, 0.01, "y"), unit=unit, up="y")


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_turns_to_the_world_are_rotations(up: str) -> None:
    turn = to_world(up)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3))
    np.testing.assert_allclose(np.linalg.det(turn), 1.0)
    np.testing.assert_allclose(turn @ np.eye(3)["xyz".index(up)], [0, 0, 1])


@pytest.mark.parametrize(
    ("printed", "fps"),
    [
        (0.0333333, 30.0),
        (0.0083333, 120.0),
        (0.041667, 24.0),
        (0.016667, 60.0),
        (0.0333667, 30000 / 1001),
        (0.0123, 1 / 0.0123),
    ],
)
def test_printed_frame_times_become_the_rates_that_were_meant(printed: float, fps: float) -> None:
    np.testing.assert_allclose(nice_rate(printed), fps, rtol=1e-9)
