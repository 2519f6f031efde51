"""Clips that say which points stand: what was meant, beside what geometry does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.validation import Report, Settings, validate

FOOT = """<body name="{side}_foot" pos="0 {y} -.5">
<joint name="{side}_x" type="slide" axis="1 0 0"/><joint name="{side}_z" type="slide" axis="0 0 1"/>
<geom type="box" size=".1 .05 .02" mass=".5"/>
{sites}</body>"""
CORNERS = [(x, y) for x in (-0.1, 0.1) for y in (-0.05, 0.05)]


def foot(side: str, y: float) -> str:
    sites = "".join(
        f'<site name="contact_{side}_{i}" pos="{a} {b} -.02"/>' for i, (a, b) in enumerate(CORNERS)
    )
    return FOOT.format(side=side, y=y, sites=sites)


@pytest.fixture(scope="module")
def strider() -> Character:
    """A block on two feet that slide under it; its CoM is between them."""
    return Character.from_xml(
        f"""<mujoco><worldbody><geom type="plane" size="9 9 .1" friction="1 .1 .1"/>
        <body name="block" pos="0 0 .52"><freejoint/><geom type="box" size=".1 .1 .2" mass="10"/>
        {foot("left", 0.1)}{foot("right", -0.1)}</body></worldbody></mujoco>""",
        name="strider",
    )


def gliding(strider: Character, height: float = 0.005, frames: int = 60) -> Clip:
    """All glides by at 0.5 m/s, the right foot so low that it counts as touching."""
    qpos = np.tile(strider.reference_qpos, (frames, 1))
    time = np.arange(frames) / 60
    names = list(strider.joint_names)
    place = {n: strider.tree.joints[names.index(n)].qpos for n in ("right_z",)}
    qpos[:, 0] = 0.5 * (time - time.mean())
    qpos[:, place["right_z"]] = height
    return Clip(qpos=qpos, time=time, joint_names=strider.joint_names)


def saying(clip: Clip, strider: Character, *sides: str) -> Clip:
    """The clip, saying that these feet stand throughout."""
    names = strider.contacts.names[::-1]  # any order: they go by name
    stands = np.array([any(s in n for s in sides) for n in names])
    return replace(
        clip, contact_points=names, contact_active=np.tile(stands, (clip.frames, 1))
    )  # fmt: skip


def codes(report: Report) -> set[str]:
    return {f.code for f in report.findings}


def test_without_a_word_geometry_decides(strider: Character) -> None:
    report = validate(gliding(strider), strider)
    assert "CON002" in codes(report)
    assert report.measures["skate_speed_max_m_s"].value == pytest.approx(0.5, rel=1e-3)
    reasons = {c.code: c.reason for c in report.coverage if c.status == "not-covered"}
    assert "does not say" in reasons["CON005"]


@pytest.mark.parametrize("hz", [None, 6.0])
def test_what_a_clip_says_changes_no_physics(strider: Character, hz: float | None) -> None:
    clip, settings = gliding(strider), Settings(lowpass_hz=hz)
    silent = validate(clip, strider, settings=settings)
    for sides in ((), ("left",), ("left", "right")):
        told = validate(saying(clip, strider, *sides), strider, settings=settings)
        assert codes(told) - {"CON005"} == codes(silent)
        assert told.measures == silent.measures


def test_a_foot_said_to_stand_must_not_slide(strider: Character) -> None:
    report = validate(saying(gliding(strider), strider, "left", "right"), strider)
    assert "CON002" in codes(report)


def test_what_rests_and_is_not_said_to_stand_is_named(strider: Character) -> None:
    clip = gliding(strider, 0.0)
    still = replace(clip, qpos=np.tile(strider.reference_qpos, (clip.frames, 1)))
    report = validate(saying(still, strider), strider)
    found = {f.code: f for f in report.findings}
    assert "CON003" not in found
    assert found["CON005"].body == "left_foot"
    assert "not said to stand" in found["CON005"].message


def test_standing_in_the_air_is_an_error(strider: Character) -> None:
    clip = gliding(strider)
    lifted = replace(clip, qpos=clip.qpos + 0.04 * np.eye(strider.tree.nq)[2])
    report = validate(saying(lifted, strider, "left"), strider)
    (finding,) = [f for f in report.findings if f.code == "CON005"]
    assert (finding.severity, finding.body) == ("error", "left_foot")
    assert finding.value == pytest.approx(0.04, abs=1e-3)


def test_an_uneven_clip_keeps_its_word_at_its_time(strider: Character) -> None:
    clip = gliding(strider)
    rng = np.random.default_rng(0)
    qpos = clip.qpos.copy()
    qpos[30:, 2] += 0.04
    time = clip.time + rng.uniform(-0.002, 0.002, clip.frames)
    stands = saying(replace(clip, qpos=qpos, time=time), strider, "left")
    assert stands.contact_active is not None
    active = stands.contact_active.copy()
    active[30:] = False
    for clip, wrong in ((stands, True), (replace(stands, contact_active=active), False)):
        report = validate(clip, strider)
        assert "DAT001" in codes(report)
        high = [f for f in report.findings if f.code == "CON005" and f.severity == "error"]
        assert bool(high) is wrong


def test_other_points_than_the_models_are_not_compared(strider: Character) -> None:
    clip = saying(gliding(strider), strider, "left")
    other = replace(clip, contact_points=tuple(f"x_{n}" for n in clip.contact_points))
    report = validate(other, strider)
    reasons = {c.code: c.reason for c in report.coverage if c.status == "not-covered"}
    assert "not the model's" in reasons["CON005"]
    assert "CON002" in codes(report)
