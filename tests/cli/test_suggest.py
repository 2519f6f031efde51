from __future__ import annotations

import json
from pathlib import Path

from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character

from .conftest import LAMP, MODELS, Run

MODEL = LAMP[:2]


def test_suggestions_say_where_and_why(run: Run, good: Path) -> None:
    got = run("keyposes", "suggest", good, *LAMP, "--count", 3, "--format", "json")
    assert got.code == 0
    rows = json.loads(got.out)
    assert len(rows) == 3
    assert rows[0]["capture"] == good.name
    assert 0 <= rows[0]["frame"] < 45
    assert rows[0]["nearest"]
    assert "cm (RMS) from" in rows[0]["reason"]


def test_suggest_writes_start_poses_that_learn_reads(run: Run, good: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "next.toml"
    got = run("keyposes", "suggest", good, *MODEL, "--count", 4, "--out", out)
    assert got.code == 0, got.err
    assert len(got.out.splitlines()) == 5
    poses = load_keyposes(out, Character.load(MODELS / "lamp.xml"))
    assert len(poses) == 4
    assert all("to be posed" in pose.note for pose in poses.poses)
    assert run("keyposes", "check", out, *MODEL).code == 0


def test_propose_takes_times(run: Run, good: Path, tmp_path: Path) -> None:
    out = tmp_path / "own.toml"
    got = run("keyposes", "propose", good, "--time", 0.2, "--time", 1.0, *MODEL, "--out", out)
    assert got.code == 0, got.err
    poses = load_keyposes(out, Character.load(MODELS / "lamp.xml")).poses
    assert [round(pose.time, 3) for pose in poses] == [0.2, 1.0]


def test_propose_refuses_times_outside(run: Run, good: Path, tmp_path: Path) -> None:
    got = run("keyposes", "propose", good, "--time", 9, *MODEL, "--out", tmp_path / "x.toml")
    assert got.code == 2
    assert "--time is 9" in got.err


def test_check_passes_with_warnings_alone(run: Run, tmp_path: Path) -> None:
    text = (MODELS / "lamp.keyposes.toml").read_text()
    old = text.index('sha256 = "') + 10
    other = tmp_path / "other.toml"
    other.write_text(text[:old] + "0" * 64 + text[old + 64 :])
    got = run("keyposes", "check", other, *MODEL)
    assert got.code == 0
    assert got.out.startswith("warning: ")
