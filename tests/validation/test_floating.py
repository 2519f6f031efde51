"""Roots in pieces are judged as free ones, fixed bases as standing ones where that is told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.validation import Report, Settings, validate

SLIDES = "".join(
    f'<joint name="t{a}" type="slide" axis="{v}"/>'
    for a, v in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
)
HINGES = "".join(
    f'<joint name="r{a}" axis="{v}"/>' for a, v in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
)
LAMP = """<mujoco><worldbody><geom type="plane" size="2 2 .1"/><body name="base" pos="0 0 .02">
<geom type="cylinder" size=".06 .02" mass=".4"/><body pos="0 0 .02">
<joint name="pitch" axis="0 1 0" range="-120 120"/>
<geom type="capsule" fromto="0 0 0 0 0 .3" size=".01" mass=".2"/>
<geom type="sphere" pos="0 0 .3" size=".05" mass=".3"/></body></body></worldbody></mujoco>"""


def pieces(biped: Character, joints: str, home: str) -> Character:
    assert biped.source is not None
    text = biped.source.text.replace('<freejoint name="root"/>', joints)
    text = text.replace('qpos="0 0 .64 1 0 0 0', f'qpos="{home}')
    return Character.from_xml(text, name="pieces")


def in_pieces(hop: Clip, *, ball: bool) -> np.ndarray:
    shift = hop.qpos[:, :3] - [0, 0, 0.64]
    turn = hop.qpos[:, 3:7]
    if not ball:
        turn = Rotation.from_quat(turn, scalar_first=True).as_euler("XYZ")
    return np.hstack([shift, turn, hop.qpos[:, 7:]])


@pytest.mark.parametrize("ball", [True, False])
def test_a_root_in_pieces_is_judged_in_full(biped: Character, hop: Clip, ball: bool) -> None:
    if ball:
        character = pieces(biped, SLIDES + '<joint name="turn" type="ball"/>', "0 0 0 1 0 0 0")
    else:
        character = pieces(biped, SLIDES + HINGES, "0 0 0 0 0 0")
    qpos = in_pieces(hop, ball=ball)
    free, broken = validate(hop, biped), validate(Clip(qpos=qpos, time=hop.time), character)
    assert broken.verdict == "passed"
    for name, measure in free.measures.items():
        if measure.value is not None:
            assert broken.measures[name].value == pytest.approx(measure.value, rel=1e-3, abs=1e-6)
    qpos[:, 0] += hop.time
    qpos[:, 2] += 1
    high = validate(Clip(qpos=qpos, time=hop.time), character)
    assert "CON003" in {f.code for f in high.findings if f.severity == "error"}


def leaning(angle: float, *, stands: bool, shape: str = LAMP) -> Report:
    lamp = Character.from_xml(shape, name="lamp")
    qpos = np.full((60, 1), np.deg2rad(angle))
    return validate(
        Clip(qpos=qpos, time=np.arange(60) / 30), lamp, settings=Settings(stands=stands)
    )


# 0.4 kg at the axis, 0.2 kg at 0.15 m and 0.3 kg at 0.3 m from it along the arm.
LEVER = (0.2 * 0.15 + 0.3 * 0.3) / 0.9


@pytest.mark.parametrize("angle", [0.0, 15.0, -30.0, 45.0])
def test_a_lamp_tips_where_its_weight_lies_outside_its_base(angle: float) -> None:
    out = LEVER * np.sin(np.deg2rad(abs(angle)))
    report = leaning(angle, stands=True)
    margin, moment = (report.measures[f"tip_margin_min_{unit}"].value for unit in ("m", "bwh"))
    assert margin == pytest.approx(0.06 - out, abs=5e-4)
    assert moment == pytest.approx((0.06 - out) / report.model.com_height_m, abs=5e-3)
    tips = out > 0.06
    assert report.verdict == ("failed" if tips else "passed")
    assert ("DYN010" in {f.code for f in report.findings}) == tips


@pytest.mark.parametrize("angle", [0.0, 45.0])
def test_without_being_told_it_is_not_judged(angle: float) -> None:
    report = leaning(angle, stands=False)
    assert report.verdict == "not judged"
    assert "--stands" in (report.not_judged or "")
    assert report.measures["tip_margin_min_m"].value is None


def test_a_lamp_that_jerks_slips(hop: Clip) -> None:
    lamp = Character.from_xml(LAMP.replace('mass=".4"', 'mass=".4" friction=".1"'), name="lamp")
    t = np.arange(90) / 30
    swing = Clip(qpos=0.2 * np.sin(2 * np.pi * 1.5 * t)[:, None], time=t)
    report = validate(swing, lamp, settings=Settings(stands=True, friction=0.1))
    assert report.measures["friction_demand_max"].value == pytest.approx(
        LEVER * 0.2 * (3 * np.pi) ** 2 / 9.81, rel=0.15
    )
    assert "DYN004" in {f.code for f in report.findings}
