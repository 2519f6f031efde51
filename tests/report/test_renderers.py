"""Each renderer shows what the report says, in the format that its readers expect."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as Xml

import jsonschema
import numpy as np
import pytest
from jsonschema import Draft4Validator, ValidationError

from physretarget.report.json import render_json, schema
from physretarget.report.junit import render_junit
from physretarget.report.markdown import render_markdown
from physretarget.report.sarif import render_sarif
from physretarget.report.text import render_text
from physretarget.validation.codes import RULES
from physretarget.validation.report import (
    ClipFacts,
    Coverage,
    Finding,
    Measure,
    ModelFacts,
    Report,
    UsedSettings,
)

REQUIRED_MEASURES = [
    "required_force_vertical_max_bw",
    "required_force_vertical_min_bw",
    "required_force_vertical_mean_bw",
    "unexplained_force_rms_bw",
    "unexplained_force_max_bw",
    "unexplained_moment_rms_bwh",
    "pull_frames_fraction",
    "friction_exceeded_fraction",
    "cop_outside_fraction",
    "flight_frames_fraction",
    "flight_com_acceleration_error_rms",
    "penetration_max_m",
    "penetration_frames_fraction",
    "skate_speed_max_m_s",
    "skate_distance_m",
    "float_time_s",
    "joint_limit_excess_max_rad",
    "joint_speed_max_rad_s",
    "joint_torque_ratio_max",
    "self_penetration_max_m",
    "root_acceleration_max_m_s2",
    "jerk_dimensionless_max",
]


@pytest.fixture
def report() -> Report:
    findings = (
        Finding(
            code="DYN003", rule="pulling-floor", severity="error", message="the floor | pulls",
            frame_first=10, frame_last=14, frame=12, time_s=0.4, value=-0.3, limit=-0.1, unit="BW",
        ),
        Finding(
            code="CON002", rule="skate", severity="warning", message="foot slides",
            frame_first=3, frame_last=3, frame=3, time_s=0.1, body="left [foot]", value=0.012,
            limit=0.01, unit="m",
        ),
        Finding(code="MDL004", rule="missing-limits", severity="warning", message="no range"),
    )  # fmt: skip
    return Report(
        tool={"name": "physretarget", "version": "0"},
        clip=ClipFacts(
            path="clips/a b.csv", sha256="ab", frames=30, duration_s=1.0, fps=29.0,
            notes=("Quaternion order wxyz was inferred.",), first_line=2,
        ),
        model=ModelFacts(path="m.xml", sha256="cd", mass_kg=30.0, com_height_m=0.7),
        settings=UsedSettings(
            profile="robot", lowpass_hz=6.0, derivative="central", contact_tolerance_m=0.02,
            friction=1.0, floor_height_m=0.0, contact="2 declared contact points",
        ),
        measures={
            "pull_frames_fraction": Measure(value=0.1, unit="1", frame=12),
            "float_time_s": Measure(value=None, unit="s"),
        },
        findings=findings,
        coverage=tuple(
            Coverage(code=r.code, status="not-covered", reason="no limits")
            if r.code == "DYN008"
            else Coverage(code=r.code, status="checked")
            for r in RULES
        ),
        series={"x": np.zeros(30)},
        accepted=2,
    )  # fmt: skip


def test_json_keeps_its_schema(report: Report) -> None:
    document = json.loads(render_json(report))
    jsonschema.Draft202012Validator.check_schema(schema())
    jsonschema.validate(document, schema())
    assert document["summary"] == {
        "errors": 1, "warnings": 2, "passed": False, "verdict": "failed", "reason": "",
        "accepted": 2,
    }  # fmt: skip
    assert document["measures"]["float_time_s"]["value"] is None
    assert document["findings"][0]["frame_first"] == 10
    assert "series" not in document
    assert json.loads(render_json([report])) == [document]
    assert json.loads(render_json([])) == []


@pytest.mark.parametrize(
    "damage",
    [
        lambda d: d.pop("coverage"),
        lambda d: d["findings"][0].update(severity="fatal"),
        lambda d: d["findings"][0].update(code="ABC1"),
        lambda d: d["measures"]["float_time_s"].pop("unit"),
        lambda d: d.update(extra=1),
        lambda d: next(c for c in d["coverage"] if c["status"] != "checked").update(reason=""),
    ],
)
def test_schema_catches(report: Report, damage) -> None:  # type: ignore[no-untyped-def]
    document = json.loads(render_json(report))
    damage(document)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(document, schema())


def test_a_real_report_has_every_measure_and_keeps_the_schema(data) -> None:  # type: ignore[no-untyped-def]
    from physretarget.clip import load_clip
    from physretarget.mjcf import Character
    from physretarget.validation import Settings, validate

    model = Character.load(data / "robot" / "g1_no_mesh_box_feet.xml")
    clip = load_clip(data / "robot" / "g1_jumpjack.csv", character=model, fps=30)
    settings = Settings(profile="robot", lowpass_hz=6, also_literature=True)
    real = validate(clip, model, settings=settings)
    document = json.loads(render_json(real))
    jsonschema.validate(document, schema())
    assert set(REQUIRED_MEASURES) <= set(document["measures"])
    assert render_json(real) == render_json(validate(clip, model, settings=settings))
    for render in (render_text, render_markdown, render_sarif, render_junit):
        assert render(real)


def test_text_shows_the_worst_first_and_what_is_missing(report: Report) -> None:
    text = render_text(report)
    assert text.index("DYN003") < text.index("CON002")
    verdict = "failed: 1 error, 2 warnings, 2 accepted"
    verdict = "failed: 1 error, 2 warnings, 2 accepted"
    for word in ("10-14", "12 (0.40 s)", "low-pass 6 Hz", "not taken", "was inferred", verdict):
        assert word in text
    assert "not covered: DYN008, no limits" in text
    lines = text.splitlines()
    assert lines[0] == lines[-1]  # seen whether one reads from the top or where it stopped
    assert verdict in lines[0]
    assert "\x1b" not in text
    assert "\x1b" in render_text(report, color=True)
    assert max(map(len, render_text(report, width=80).splitlines())) <= 80


def test_text_counts_what_it_does_not_list(report: Report) -> None:
    many = replace(report, findings=report.findings[:1] * 9)
    text = render_text(many, most=3)
    assert "and 6 more of these" in text
    assert text.count("the floor | pulls") == 3


def test_sarif_points_to_lines_and_rules(report: Report) -> None:
    document = json.loads(render_sarif([report, report]))
    assert document["version"] == "2.1.0"
    run = document["runs"][0]
    rules = run["tool"]["driver"]["rules"]
    assert [r["id"] for r in rules] == [r.code for r in RULES]
    assert len(run["results"]) == 6
    for result in run["results"]:
        assert rules[result["ruleIndex"]]["id"] == result["ruleId"]
        assert result["level"] in ("error", "warning")
    first = run["results"][0]["locations"][0]["physicalLocation"]
    assert first["artifactLocation"]["uri"] == "clips/a%20b.csv"
    assert first["region"] == {"startLine": 12, "endLine": 16}
    notes = run["invocations"][0]["toolExecutionNotifications"]
    assert notes[0]["associatedRule"]["id"] == "DYN008"


def test_sarif_keeps_the_official_schema(report: Report) -> None:
    """Of OASIS, version 2.1.0 rtm.5; see ORIGIN.md beside it."""
    schema = json.loads((Path(__file__).parent / "sarif-2.1.0" / "schema.json").read_text())
    check = Draft4Validator(schema, format_checker=Draft4Validator.FORMAT_CHECKER)
    none = replace(report, clip=replace(report.clip, sha256="", first_line=None))
    far = replace(report, clip=replace(report.clip, path=str(Path("a b.csv").absolute())))
    for many in (
        [report],
        [report, none, far],
        [report, far, report],
        replace(report, findings=()),
    ):
        check.validate(json.loads(render_sarif(many)))
    uri = json.loads(render_sarif(far))["runs"][0]["artifacts"][0]["location"]["uri"]
    assert uri.startswith("file:///")
    assert uri.endswith("a%20b.csv")
    check.validate(json.loads(render_sarif([], unread={"a b.npz": "a b.npz: is no clip."})))
    twice = json.loads(render_sarif([report, far, report]))["runs"][0]
    assert len(twice["artifacts"]) == 2
    place = [r["locations"][0]["physicalLocation"]["artifactLocation"] for r in twice["results"]]
    assert [p["index"] for p in place] == [0, 0, 0, 1, 1, 1, 0, 0, 0]
    assert all(twice["artifacts"][p["index"]]["location"]["uri"] == p["uri"] for p in place)
    for damage in ({"level": "fatal"}, {"ruleIndex": -2}, {"message": {}}):
        document = json.loads(render_sarif(report))
        document["runs"][0]["results"][0] |= damage
        with pytest.raises(ValidationError):
            check.validate(document)


def test_junit_counts(report: Report) -> None:
    root = Xml.fromstring(render_junit(report).split("\n", 1)[1])
    suite = root[0]
    assert suite.get("tests") == str(len(RULES))
    assert (suite.get("failures"), suite.get("skipped")) == ("1", "1")
    assert len(suite.findall("testcase")) == len(RULES)
    strict = Xml.fromstring(render_junit([report], fail_on="warning").split("\n", 1)[1])
    assert strict[0].get("failures") == "3"


def test_markdown_escapes_and_lists(report: Report) -> None:
    text = render_markdown([report, report])
    assert text.startswith("| clip |")
    assert "the floor \\| pulls" in text
    assert "not covered: DYN008" in text
    assert "❌ failed" in text
    clean = render_markdown(replace(report, findings=()))
    assert "✅ passed" in clean
