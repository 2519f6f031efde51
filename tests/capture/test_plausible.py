from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget.capture.actor import SEGMENT, ActorMotion, ActorShape
from physretarget.capture.plausible import doubts, knee_flexion
from physretarget.capture.recording import Source


def bending(angle: float, *, height: float = 1.75, frames: int = 20) -> ActorMotion:
    """Somebody who holds both knees bent at an angle, in degrees."""
    shape = ActorShape.reference(height)
    qpos = np.tile(shape.tree().neutral(), (frames, 1))
    for side in ("left", "right"):
        at = 3 + 4 * SEGMENT[f"{side}_shank"]
        half = np.radians(angle) / 2
        qpos[:, at : at + 4] = [np.cos(half), 0.0, np.sin(half), 0.0]
    return ActorMotion(
        shape=shape,
        time=np.arange(frames) / 30.0,
        qpos=qpos,
        fps=30.0,
        valid=np.ones(frames, dtype=bool),
        marker_error_rms=None,
        source=Source(
            path="made.bvh", sha256="0" * 64, format="bvh", unit="cm", up="z", fps=30.0, frames=20
        ),
        notes=(),
    )


@pytest.mark.parametrize("angle", [-60.0, 0.0, 45.0, 130.0])
def test_flexion_is_the_angle_that_was_bent(angle: float) -> None:
    for side in ("left", "right"):
        np.testing.assert_allclose(np.degrees(knee_flexion(bending(angle), side)), angle)


def test_people_raise_no_doubts() -> None:
    assert doubts(bending(120.0)) == ()
    assert doubts(bending(-10.0)) == ()


def test_knees_that_bend_backward_are_doubted() -> None:
    found = doubts(bending(-40.0))
    assert len(found) == 2
    assert "left knee bends backward by up to 40 degrees in 20 frames" in found[0]


def test_frames_that_are_not_valid_say_nothing() -> None:
    motion = bending(-40.0)
    assert doubts(replace(motion, valid=np.zeros(20, dtype=bool))) == ()


@pytest.mark.parametrize("height", [0.9, 2.5])
def test_statures_of_nobody_are_doubted(height: float) -> None:
    assert any("tell the unit (now cm)" in doubt for doubt in doubts(bending(0.0, height=height)))


def test_points_that_no_body_fits_are_doubted() -> None:
    assert any("by 5 cm" in doubt for doubt in doubts(replace(bending(0), marker_error_rms=0.05)))
    assert doubts(replace(bending(0), marker_error_rms=0.02)) == ()


@pytest.mark.parametrize(
    ("lift", "swing", "doubted"), [(0.0, 30.0, True), (0.05, 30.0, False), (0.0, 2.0, False)]
)
def test_hips_at_one_point_over_walking_legs_are_doubted(
    lift: float, swing: float, doubted: bool
) -> None:
    motion = bending(0.0)
    phase = np.sin(np.linspace(0, 2 * np.pi, len(motion.time)))
    for side, sign in (("left", 1), ("right", -1)):
        at = 3 + 4 * SEGMENT[f"{side}_thigh"]
        half = sign * np.radians(swing) / 2 * phase
        motion.qpos[:, at] = np.cos(half)
        motion.qpos[:, at + 2] = np.sin(half)
    motion.qpos[:, 2] += lift * phase
    assert any("rotations alone" in doubt for doubt in doubts(motion)) == doubted
