"""Every rule: has documentation, a clip that fires it, a clip that stays clean."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.clip import Clip
from physretarget.kinematics import quat_multiply
from physretarget.kinematics.order import breadth_first
from physretarget.mjcf import Character
from physretarget.report.rules import rules_page
from physretarget.validation import BY_CODE, RULES, Report, Settings, validate
from physretarget.validation.codes import RETIRED

Case = tuple[Clip, Character]
FIRING: dict[str, Callable[[Character, Clip, Clip], Case]] = {}


def fires(code: str):  # type: ignore[no-untyped-def]
    def register(function):  # type: ignore[no-untyped-def]
        FIRING[code] = function
        return function

    return register


def posed(clip: Clip, **columns: object) -> Clip:
    """A copy with columns of qpos (q0, q1, …) replaced or shifted by what a function returns."""
    qpos = clip.qpos.copy()
    for name, how in columns.items():
        column = int(name[1:])
        qpos[:, column] = how(qpos[:, column], clip.time)  # type: ignore[operator]
    return replace(clip, qpos=qpos)


def pitched(clip: Clip, angle: np.ndarray) -> Clip:
    qpos = clip.qpos.copy()
    qpos[:, 3], qpos[:, 5] = np.cos(angle / 2), np.sin(angle / 2)
    return replace(clip, qpos=qpos)


def model(text: str) -> Character:
    return Character.from_xml(text, name="case")


def still(character: Character) -> Clip:
    qpos = np.tile(character.reference_qpos, (30, 1))
    return Clip(qpos=qpos, time=np.arange(30) / 30.0, model_sha256=character.sha256)


BODY = """<mujoco>{option}<asset>{asset}</asset><worldbody>
<geom type="plane" size="2 2 .1"/>
<body name="a" pos="0 0 .1"><freejoint/>{first}
<body name="b" pos=".3 0 0"><joint name="j" axis="0 1 0" {joint}/>
<geom type="box" size=".1 .05 .05" density="500"/></body></body></worldbody></mujoco>"""
BOX = '<geom type="box" size=".1 .1 .1" density="500"/>'


def odd(first: str = BOX, joint: str = 'range="-1 1" limited="true"', **parts: str) -> Case:
    filled = {"option": "", "asset": "", **parts}
    character = model(BODY.format(first=first, joint=joint, **filled))
    return still(character), character


@fires("DAT001")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    kept = np.r_[0:50, 51 : hop.frames]
    return replace(hop, qpos=hop.qpos[kept], time=hop.time[kept]), biped


@fires("DAT002")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return replace(standing, time=np.arange(standing.frames) / 12), biped


@fires("DAT003")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    qpos = hop.qpos.copy()
    qpos[181:186] = qpos[180]
    return replace(hop, qpos=qpos), biped


@fires("DAT004")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return replace(standing, qpos=standing.qpos[:2], time=standing.time[:2]), biped


@fires("DAT005")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return replace(standing, model_sha256="0" * 64), biped


@fires("DAT006")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, **{f"q{i}": lambda q, t: 100 * q for i in range(3)}), biped


@fires("DAT007")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(hop, **{f"q{i}": lambda q, t: np.degrees(q) for i in range(7, 13)}), biped


@fires("DAT008")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    kept = np.r_[0:195, 197 : hop.frames]  # on the way up
    return replace(hop, qpos=hop.qpos[kept], time=hop.time[: len(kept)]), biped


@fires("DAT009")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(hop, q2=lambda q, t: q + 0.02 * (np.arange(len(q)) == 100)), biped


@fires("MDL001")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return odd(first=f'<inertial pos="0 0 0" mass="1" diaginertia="5 5 5"/>{BOX}')


@fires("MDL002")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return odd(first='<geom type="box" size=".1 .1 .1" density="40000"/>')


@fires("MDL003")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    corners = " ".join(f"{x} {y} {z}" for x in (0, 0.2) for y in (0, 0.2) for z in (0, 0.2))
    faces = "0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6"  # one triangle missing
    return odd(
        first='<geom type="mesh" mesh="m" mass="3"/>',
        asset=f'<mesh name="m" vertex="{corners}" face="{faces}" inertia="convex"/>',
    )


@fires("MDL004")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return odd(joint="")


@fires("MDL005")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return odd(joint='range="-1 1" limited="true" stiffness="500" damping="50"')


@fires("MDL006")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    clip, _ = odd()
    text = BODY.format(first=BOX, joint='range="-1 1" limited="true"', option="", asset="")
    bare = model(text.replace('<geom type="box"', '<geom contype="0" conaffinity="0" type="box"'))
    return replace(clip, model_sha256=bare.sha256), bare


@fires("MDL007")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return odd(option='<option gravity="0 -9.81 0"/>')


@fires("KIN001")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q8=lambda q, t: q - 0.2), biped


@fires("KIN002")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q7=lambda q, t: np.where(t > 0.5, 1.5, 0.0)), biped


@fires("KIN003")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    noise = 2e-3 * np.random.default_rng(0).normal(size=standing.frames)
    return posed(standing, q0=lambda q, t: q + noise), biped


@fires("KIN004")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q1=lambda q, t: q + np.where(t > 0.5, 0.5, 0.0)), biped


@fires("KIN005")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    folded = posed(standing, q2=lambda q, t: q + 0.5, q7=lambda q, t: q - 2.6)
    return posed(folded, q8=lambda q, t: q + 3.5, q9=lambda q, t: q - 0.9), biped


@fires("CON001")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q2=lambda q, t: q - 0.03), biped


@fires("CON002")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q0=lambda q, t: q + 0.2 * t), biped


@fires("CON003")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q2=lambda q, t: q + 0.03), biped


@fires("CON004")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    flicker = 0.002 * (-1.0) ** np.arange(standing.frames)
    return posed(standing, q2=lambda q, t: q + 0.018 + flicker), biped


@fires("DYN001")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q0=lambda q, t: q + 8.0 * t**2), biped


@fires("DYN002")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    # Leaning rigidly about the ankles by 25 degrees, the feet flat: nothing holds that.
    lean = np.deg2rad(25) * np.ones(standing.frames)
    leaning = pitched(standing, lean)
    moved = posed(
        leaning,
        q0=lambda q, t: q + 0.6 * np.sin(lean),
        q2=lambda q, t: q - 0.6 * (1 - np.cos(lean)),
    )
    return posed(moved, q9=lambda q, t: q - lean, q12=lambda q, t: q - lean), biped


@fires("DYN003")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return replace(hop, time=hop.time / 1.5), biped


@fires("DYN004")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q0=lambda q, t: q + 8.0 * t**2), biped


@fires("DYN005")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return FIRING["DYN002"](biped, hop, standing)


@fires("DYN006")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return replace(hop, time=hop.time / 1.5), biped


@fires("CON005")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    site = '<site name="contact_sole" pos="0 0 -.1"/>'
    block = model(BODY.format(first=BOX + site, joint="", option="", asset=""))
    lifted = still(block).qpos + 0.03 * np.eye(block.tree.nq)[2]
    stands = np.ones((30, 1), dtype=bool)
    return replace(
        still(block), qpos=lifted, contact_points=("contact_sole",), contact_active=stands
    ), block


@fires("DYN007")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    falling = posed(standing, q2=lambda q, t: q + 8 - 9.81 / 2 * t**2)
    return pitched(falling, 4.0 * standing.time**2), biped


@fires("DYN008")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    text = BODY.format(
        first=BOX,
        joint='range="-60 60" limited="true" actuatorfrcrange="-.1 .1"',
        option="",
        asset="",
    )
    weak = model(text)
    qpos = np.tile(weak.reference_qpos, (30, 1))
    qpos[:, 2] += 4 - 9.81 / 2 * (np.arange(30) / 30.0) ** 2
    qpos[:, 7] = 0.5 * np.sin(15 * np.arange(30) / 30.0)
    return Clip(qpos=qpos, time=np.arange(30) / 30.0), weak


@fires("DYN009")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return replace(hop, time=hop.time / 1.5), biped


def gait(steps: int = 8, per_step: int = 15, yaw: float = 0.4) -> Clip:
    """The biped walks at 30 frames/s by its kinematics: a foot stays where it stands."""
    reach, high = 0.12, 0.58
    rows = []
    for step in range(steps):
        for part in np.arange(per_step) / per_step:
            back = reach * (0.5 - part)  # of the standing foot before the hip
            swing = -reach * (0.5 - part)
            lift = 0.05 * np.sin(np.pi * part)
            legs = [_leg(back, high), _leg(swing, high - lift)]
            if step % 2:
                legs.reverse()
            way = reach * (step + part)
            root = [way * np.cos(yaw), way * np.sin(yaw), high + 0.04]
            turn = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
            rows.append([*root, *turn, *legs[0], *legs[1]])
    return Clip(qpos=np.array(rows), time=np.arange(len(rows)) / 30.0)


def _leg(ahead: float, down: float) -> list[float]:
    """Hip, knee and ankle that put a level foot so far ahead of and below the hip."""
    length = np.hypot(ahead, down)
    bend = np.arccos(length / 0.6)
    hip = -np.arctan2(ahead, down) - bend
    return [hip, 2 * bend, -hip - 2 * bend]


@fires("DAT010")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    clip = gait()
    qpos = clip.qpos.copy()
    qpos[:, 3:7] = np.roll(qpos[:, 3:7], -1, axis=1)
    return replace(clip, qpos=qpos), biped


@fires("DAT011")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    clip = gait()
    order = breadth_first(biped.tree)
    return replace(clip, qpos=clip.qpos[:, np.argsort(order)]), biped


@fires("DAT012")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    falling = posed(standing, q2=lambda q, t: q + 8 - 9.81 / 2 * t**2)
    return replace(falling, time=4 * falling.time), biped


@fires("DAT013")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    clip = gait()
    turn = Rotation.from_euler("x", -90, degrees=True)
    qpos = clip.qpos.copy()
    qpos[:, :3] = turn.apply(qpos[:, :3])
    qpos[:, 3:7] = quat_multiply(turn.as_quat(scalar_first=True), qpos[:, 3:7])
    return replace(clip, qpos=qpos), biped


@fires("DAT014")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(gait(), q0=lambda q, t: 1.3 * q), biped


@fires("DAT015")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    qpos = standing.qpos.copy()
    qpos[50:, 7:] = [-0.4, 0.8, -0.4] * 2
    qpos[50:, 2] = 0.04 + 0.6 * np.cos(0.4)
    return replace(standing, qpos=qpos), biped


@fires("CON006")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(gait(), q9=lambda q, t: q + 0.16, q12=lambda q, t: q + 0.16), biped


@fires("CON007")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return posed(standing, q2=lambda q, t: q + 0.05), biped


@fires("DYN010")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    arm = model(
        """<mujoco><worldbody><geom type="plane" size="2 2 .1"/><body pos="0 0 .02">
        <geom type="cylinder" size=".06 .02" mass=".3"/><body><joint axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 .1 0 0 .4" size=".02" mass=".5"/></body></body>
        </worldbody></mujoco>"""
    )
    return Clip(qpos=np.full((30, 1), 0.8), time=np.arange(30) / 30.0), arm


def _leaning(biped: Character, standing: Clip) -> Clip:
    """A statue, 40 degrees over."""
    qpos = standing.qpos[:40].copy()
    qpos[:, 3:7] = [np.cos(np.deg2rad(20)), 0.0, np.sin(np.deg2rad(20)), 0.0]
    return replace(standing, qpos=qpos, time=standing.time[:40], contact_active=None)


@fires("SIM001")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return _leaning(biped, standing), biped


@fires("SIM002")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    return _leaning(biped, standing), biped


@fires("SIM003")
def _(biped, hop, standing):  # type: ignore[no-untyped-def]
    clip = replace(standing, qpos=standing.qpos[:20], time=standing.time[:20], contact_active=None)
    return posed(clip, q2=lambda q, t: q + 0.3), biped


def codes(report: Report) -> set[str]:
    return {finding.code for finding in report.findings}


def test_every_rule_has_a_firing_clip() -> None:
    assert set(FIRING) == set(BY_CODE)


@pytest.mark.parametrize("code", sorted(FIRING))
def test_rule_fires(code: str, biped: Character, hop: Clip, standing: Clip) -> None:
    clip, character = FIRING[code](biped, hop, standing)
    settings = Settings(stands=code == "DYN010", simulate=code.startswith("SIM"))
    report = validate(clip, character, settings=settings)
    assert code in codes(report), [c for c in report.coverage if c.code == code]
    finding = next(f for f in report.findings if f.code == code)
    assert finding.rule == BY_CODE[code].name
    if finding.frame_first is not None:
        assert finding.frame_last is not None
        assert finding.frame is not None
        assert 0 <= finding.frame_first <= finding.frame <= finding.frame_last < clip.frames


@pytest.mark.parametrize("profile", ["animation", "robot"])
def test_clean_clips_stay_clean(biped: Character, hop: Clip, standing: Clip, profile) -> None:  # type: ignore[no-untyped-def]
    for clip in (hop, standing):
        report = validate(clip, biped, settings=Settings(profile=profile))
        assert codes(report) == set(), [f.message for f in report.findings]
        # These clips do not say which points stand, and no base is fixed.
        assert {c.code for c in report.coverage if c.status != "checked"} == {"CON005", "DYN010"}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.code)
def test_rule_is_documented(rule) -> None:  # type: ignore[no-untyped-def]
    assert re.fullmatch(r"(DAT|MDL|KIN|CON|DYN|SIM)\d{3}", rule.code)
    assert rule.code not in RETIRED
    assert set(rule.sections) == {"What it does", "Why it matters", "Threshold", "Example"}
    assert all(len(text) > 4 for text in rule.sections.values())
    assert rule.summary.endswith(".")
    assert all(limit.source for limit in rule.limits.values())


@pytest.mark.parametrize(
    ("scale", "severity", "unit"),
    [(1, None, ""), (15, None, ""), (100, "error", "centimetres"), (1000, "error", "millimetres")],
)
def test_the_unit_is_named(biped, standing, scale, severity, unit) -> None:  # type: ignore[no-untyped-def]
    scaled = posed(standing, **{f"q{i}": lambda q, t: scale * q for i in range(3)})
    found = [f for f in validate(scaled, biped).findings if f.code == "DAT006"]
    assert [f.severity for f in found] == ([] if severity is None else [severity])
    assert all(unit in f.message for f in found)


def test_what_is_wrong_with_the_data_comes_first(biped: Character, hop: Clip) -> None:
    centimetres = posed(hop, **{f"q{i}": lambda q, t: 100 * q for i in range(3)})
    found = [f.code for f in validate(centimetres, biped).findings]
    assert len(set(found)) > 2
    assert found[0] == "DAT006"


def test_someone_lying_in_centimetres_is_suspected(biped, standing) -> None:  # type: ignore[no-untyped-def]
    lying = posed(standing, q2=lambda q, t: np.full_like(q, 100 * 0.12 * biped.height))
    (found,) = [f for f in validate(lying, biped).findings if f.code == "DAT006"]
    assert found.severity == "warning"


def test_codes_and_names_are_unique() -> None:
    assert len(BY_CODE) == len(RULES) == len({rule.name for rule in RULES})


def test_the_page_of_rules_is_up_to_date() -> None:
    page = Path(__file__).parents[2] / "docs" / "rules.md"
    assert page.read_text(encoding="utf-8") == rules_page()


@pytest.mark.parametrize("scale", [1.0, 57.29578, 1.7, 30.0])
def test_only_degrees_are_called_degrees(biped, hop, scale) -> None:  # type: ignore[no-untyped-def]
    turned = posed(hop, **{f"q{i}": lambda q, t: scale * q for i in range(7, 13)})
    found = {f.code for f in validate(turned, biped).findings}
    assert ("DAT007" in found) == (scale > 20)
