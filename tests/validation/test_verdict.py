"""Passed, failed, not judged: in the report and in every format of it."""

from __future__ import annotations

import json
from dataclasses import replace
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.report.html import render_html
from physretarget.report.json import render_json
from physretarget.report.junit import render_junit
from physretarget.report.markdown import render_markdown
from physretarget.report.sarif import render_sarif
from physretarget.report.text import one_line, render_text
from physretarget.validation import Report, Settings, validate
from physretarget.validation.report import Cause, Coverage, Finding

HELD = """<mujoco model="arm"><worldbody><geom type="plane" size="2 2 .1"/><body pos="0 0 .1">
<geom size=".1"/><body pos="0 0 .1"><joint name="j" axis="0 1 0" range="-1 1" limited="true"/>
<geom type="capsule" fromto="0 0 0 .2 0 0" size=".03"/></body></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def held() -> tuple[Character, Report]:
    arm = Character.from_xml(HELD, name="arm")
    still = Clip(qpos=np.zeros((30, 1)), time=np.arange(30) / 30)
    return arm, validate(still, arm)


def test_what_the_world_holds_is_not_judged(held: tuple[Character, Report]) -> None:
    _, report = held
    assert (report.verdict, report.passed, report.errors) == ("not judged", False, 0)
    assert "held by the world" in (report.not_judged or "")
    assert not report.fails()
    assert report.fails(require=("dynamics",))
    assert not report.fails(require=("contact",))
    assert "torques" in report.unmet(("torques", "contact"))


def test_standing_passes_and_a_shifted_one_fails(biped: Character, standing: Clip) -> None:
    assert validate(standing, biped).verdict == "passed"
    lifted = replace(standing, qpos=standing.qpos + 0.1 * np.eye(13)[2])
    failed = validate(lifted, biped)
    assert (failed.verdict, failed.not_judged) == ("failed", None)


def test_rules_left_out_are_not_missed_unless_required(biped: Character, standing: Clip) -> None:
    report = validate(standing, biped, settings=Settings(select=("KIN",)))
    assert report.verdict == "passed"
    assert "not selected" in report.unmet(("dynamics",))["dynamics"]


def test_errors_outweigh_what_was_not_judged(held: tuple[Character, Report]) -> None:
    error = Finding(code="KIN001", rule="joint-limit", severity="error", message="too far")
    assert replace(held[1], findings=(error,)).verdict == "failed"


CAUSE = Cause(code="DAT010", message="the order is xyzw", remedy="Read it with --quat xyzw")


@pytest.mark.parametrize("verdict", ["passed", "failed", "not judged"])
def test_every_format_tells_verdict_and_cause(held: tuple[Character, Report], verdict: str) -> None:
    arm, report = held
    report = replace(report, causes=(CAUSE,))
    if verdict != "not judged":
        report = replace(report, coverage=(Coverage(code="DYN001", status="checked"),))
    if verdict == "failed":
        error = Finding(code="KIN001", rule="joint-limit", severity="error", message="too far")
        report = replace(report, findings=(error,))
    assert report.verdict == verdict
    document = json.loads(render_json(report))
    assert document["summary"]["verdict"] == verdict
    assert document["causes"] == [
        {"code": "DAT010", "message": CAUSE.message, "remedy": CAUSE.remedy, "value": None}
    ]
    run = json.loads(render_sarif(report))["runs"][0]
    assert run["artifacts"][0]["properties"]["verdict"] == verdict
    said = Xml.fromstring(render_junit(report)).findtext("testsuite/system-out") or ""
    assert f"verdict: {verdict}" in said
    page = render_html(report, Clip(qpos=np.zeros((30, 1)), time=np.arange(30) / 30), arm)
    badge = {"passed": "✓ passed", "failed": "✗ failed", "not judged": "? not judged"}[verdict]
    assert badge in page
    plausible = {"passed": "plausible,", "failed": "not plausible,", "not judged": "not judged,"}
    assert one_line(report).startswith(plausible[verdict])
    told = (render_markdown(report), render_text(report), said, page)
    for text in told:
        assert verdict in text
        assert CAUSE.message in text
        assert ("held by the world" in text) == (verdict == "not judged")
