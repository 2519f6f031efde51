"""Unusable input: one sentence that says where, exit code 2, nothing written."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest

from physretarget.cli import common
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character

from .conftest import LAMP, MODELS, Run, bvh_text

QUICK = ("--mapper", "pca", "--until", "contacted")


@pytest.fixture
def refused(run: Run, tmp_path: Path):
    """Run a command that must refuse, and check everything that refusals share."""

    def call(*arguments: object, says: str) -> None:
        before = sorted(p for p in tmp_path.rglob("*"))
        got = run(*arguments)
        assert got.code == 2, got
        assert "Traceback" not in got.err
        assert got.out == ""
        assert got.err.startswith("error: ")
        assert "should not have happened" not in got.err
        assert len(got.err.strip().splitlines()) == 1, got.err
        assert re.search(says, got.err), got.err
        assert sorted(p for p in tmp_path.rglob("*")) == before, "something was left behind"

    return call


def lines_of(text: str) -> list[str]:
    return text.splitlines(keepends=True)


MOTION_LINE = lines_of(bvh_text()).index("MOTION\n")


def damaged(kind: str) -> str:
    lines = lines_of(bvh_text())
    row = MOTION_LINE + 3 + 20
    if kind == "header":
        return "".join(lines[: MOTION_LINE // 2])
    if kind == "row":
        return "".join(lines[:row]) + lines[row][:40]
    if kind == "frames":
        return "".join(lines[:row])
    cells = lines[row].split()
    cells[7] = {"nan": "nan", "word": "abc"}[kind]
    lines[row] = " ".join(cells) + "\n"
    return "".join(lines)


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("header", r"bad\.bvh:\d+: .*truncated"),
        ("row", rf"bad\.bvh:{MOTION_LINE + 24}: .*values"),
        ("frames", r"bad\.bvh:\d+: .*45 is declared.* 20"),
        ("nan", r"bad\.bvh, frame 20: "),
        ("word", rf"bad\.bvh:{MOTION_LINE + 24}: .*not a number"),
    ],
)
def test_damaged_bvh(refused, tmp_path: Path, kind: str, says: str) -> None:
    path = tmp_path / "bad.bvh"
    path.write_text(damaged(kind))
    refused("retarget", path, *LAMP, *QUICK, "--out", tmp_path / "out.npz", says=says)


@pytest.mark.parametrize("ending", ["bvh", "c3d", "trc", "amc", "txt", "json"])
def test_empty_capture(refused, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"empty.{ending}"
    path.touch()
    refused(
        "retarget", path, *LAMP, *QUICK, "--out", tmp_path / "o.npz",
        says=rf"empty\.{ending}: [Tt]he file is empty",
    )  # fmt: skip


def test_missing_capture_folder_and_unknown_format(refused, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "out.npz")
    refused("retarget", tmp_path / "no.bvh", *LAMP, *QUICK, *out, says=r"no\.bvh: .*not exist")
    refused("retarget", tmp_path, *LAMP, *QUICK, *out, says="folder")
    (tmp_path / "a.xlsx").write_text("x")
    refused("retarget", tmp_path / "a.xlsx", *LAMP, *QUICK, *out, says="BVH")


def test_unknown_markers(refused, tmp_path: Path) -> None:
    path = tmp_path / "odd.trc"
    rows = "".join(f"{k + 1}\t{k / 100}\t1\t2\t3\t400\t500\t600\n" for k in range(20))
    path.write_text(
        "PathFileType\t4\t(X/Y/Z)\todd.trc\n"
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
        "\tOrigNumFrames\n100\t100\t20\t2\tmm\t100\t1\t20\n"
        "Frame#\tTime\tfoo\t\t\tbar\t\t\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n" + rows
    )
    refused(
        "retarget", path, *LAMP, *QUICK, "--out", tmp_path / "o.npz",
        says=r"odd\.trc: .*unknown: foo, bar",
    )  # fmt: skip


FIXED = (
    "<mujoco model='arm'><worldbody><geom type='plane' size='1 1 .1'/><body name='a'>"
    "<joint name='h' type='hinge'/><geom size='.1' mass='1'/></body></worldbody></mujoco>"
)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (FIXED, r"m\.xml: .*'arm' has no free joint"),
        ("<mujoco>\n<worldbody>\n<body>\n</worldbody></mujoco>", r"m\.xml:3: "),
        ("", r"m\.xml: .*empty"),
        (None, r"m\.xml: cannot be read"),
    ],
)
def test_unusable_character(refused, tmp_path, good, content, says) -> None:
    model = tmp_path / "m.xml"
    if content is not None:
        model.write_text(content)
    keyposes = ("--keyposes", MODELS / "lamp.keyposes.toml")
    refused(
        "retarget", good, "--character", model, *keyposes, "--out", tmp_path / "o.npz", says=says
    )
    refused("learn", "--character", model, *keyposes, "--out", tmp_path / "m.npz", says=says)


def test_key_poses_of_another_character(refused, tmp_path, good) -> None:
    refused(
        "retarget", good, "--character", MODELS / "penguin.xml",
        "--keyposes", MODELS / "lamp.keyposes.toml", "--out", tmp_path / "o.npz",
        says=r"lamp\.keyposes\.toml:\d+: .*'lamp'.*'penguin'",
    )  # fmt: skip


def test_unusable_key_poses(refused, tmp_path, good) -> None:
    lamp = ("--character", MODELS / "lamp.xml")
    (tmp_path / "empty.toml").touch()
    for file, says in (
        (tmp_path / "empty.toml", r"empty\.toml: "),
        (tmp_path / "no.toml", r"no\.toml: cannot be read"),
        (good, r"bow\.bvh:1: .*TOML"),
    ):
        refused("retarget", good, *lamp, "--keyposes", file, "--out", tmp_path / "o.npz", says=says)
    refused("retarget", good, *lamp, "--out", tmp_path / "o.npz", says="keyposes FILE is needed")


@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("--mapper", "foo", r"--mapper.*'foo'.*sgplvm, gp"),
        ("--mapper", "no.npz", r"no\.npz: cannot be read"),
        ("--until", "never", r"--until is 'never'.*mapped, placed"),
        ("--physics", "never", r"--physics is 'never'.*default, paper"),
        ("--heading", "never", "--heading is 'never'"),
        ("--solver", "never", "--solver is 'never'.*banded, ipopt"),
        ("--fps", "0", "--fps is 0; it must be a number from 1 to 1000 fps"),
        ("--fps", "-3", "--fps is -3"),
        ("--fps", "nan", "--fps is nan"),
        ("--fps", "1e9", "--fps is 1000000000; "),
        ("--lowpass", "100", "low-pass of 100 Hz"),
        ("--lowpass", "nan", "--lowpass is nan"),
        ("--unit", "furlong", "unit is 'furlong'"),
        ("--up", "w", "up"),
        ("--mass", "-3", "--mass is -3; it must be a number from 5 to 500 kg"),
        ("--skeleton", "a.asf", "AMC"),
        ("--contacts", "no.toml", r"no\.toml: "),
        ("--out", "/proc/no/out.npz", "cannot be written"),
        ("--out", "clip.bvh", r"--out is 'clip\.bvh'.*\.npz"),
    ],
)
def test_option_values(refused, tmp_path, good, option: str, value: str, says: str) -> None:
    given = {"--mapper": "pca", "--until": "contacted", "--out": str(tmp_path / "o.npz")}
    given[option] = value
    refused("retarget", good, *LAMP, *(x for pair in given.items() for x in pair), says=says)


def test_a_solver_that_is_for_another_problem(refused, tmp_path, good) -> None:
    refused("retarget", good, *LAMP, "--mapper", "pca", "--physics", "convex", "--solver", "ipopt",
            "--out", tmp_path / "o.npz", says="'convex', a cone programme")  # fmt: skip


def test_a_mapper_of_another_character(run: Run, refused, tmp_path, good) -> None:
    mapper = tmp_path / "lamp.npz"
    assert run("learn", *LAMP, "--mapper", "pca", "--out", mapper).code == 0
    other = tmp_path / "other.xml"
    text = (MODELS / "lamp.xml").read_text()
    other.write_text(text.replace('model="lamp"', 'model="torch"'))
    options = ("--mapper", mapper, "--out", tmp_path / "o.npz")
    refused("retarget", good, "--character", other, *options, says=r"lamp\.npz: learned for 'lamp'")
    refused("retarget", good, *LAMP, *options, says=r"keyposes is for learning, .*lamp\.npz")
    mapper.write_bytes(mapper.read_bytes()[:2000])
    refused("retarget", good, *LAMP[:2], *options, says=r"lamp\.npz: ")


def test_several_captures(run: Run, refused, tmp_path, good) -> None:
    twin = tmp_path / "twin" / "bow.bvh"
    twin.parent.mkdir()
    twin.write_text(good.read_text())
    refused("retarget", good, twin, *LAMP, "--out", tmp_path / "o", says="shares its name")
    refused("retarget", good, twin, *LAMP, "--out", tmp_path / "o.npz", says="folder")
    bad = tmp_path / "bad.bvh"
    bad.write_text(damaged("nan"))
    got = run("retarget", bad, good, *LAMP, *QUICK, "--out", tmp_path / "clips")
    assert got.code == 2
    assert "bad.bvh, frame 20" in got.err
    assert [p.name for p in (tmp_path / "clips").iterdir()] == ["bow.npz"]


def test_a_folder_of_captures_is_told_how_to_name_them(run: Run, refused, tmp_path, good) -> None:
    options = (*LAMP, *QUICK, "--out", tmp_path / "clips")
    says = r"captures is a folder: name the captures.* (\S+\*\.bvh) \(1 file\)"
    refused("retarget", good.parent, *options, says=says)
    (good.parent / "LICENSE.txt").touch()
    refused("retarget", good.parent, *options, says=says)
    (tmp_path / "empty").mkdir()
    refused("retarget", good, tmp_path / "empty", *options, says="folder without captures")


def test_dimensions_that_key_poses_cannot_fill(refused, tmp_path, good) -> None:
    poses = len(load_keyposes([Path(LAMP[3])], Character.load(LAMP[1])).poses)
    says = rf"dims is {poses}; {poses} key poses .* {poses - 1} is the most"
    refused("retarget", good, *LAMP, "--dims", poses, "--out", tmp_path / "o.npz", says=says)
    refused("learn", *LAMP, "--dims", poses, "--out", tmp_path / "m.npz", says=says)


@pytest.mark.parametrize("delay", ["9", "-1", "nan"])
def test_delays_of_no_use(refused, tmp_path, delay: str) -> None:
    says = rf"--delay is {delay}; it must be a number from 0 to 5 s"
    refused("stream", "--mapper", tmp_path / "m.npz", "--delay", delay, says=says)


def test_validate(refused, tmp_path, good) -> None:
    model = ("--model", MODELS / "lamp.xml")
    (tmp_path / "empty.npz").touch()
    qpos = np.tile(np.r_[0.0, 0, 0.3, 1, 0, 0, 0, np.zeros(5)], (9, 1))
    qpos[4, 2] = np.nan
    np.savez(tmp_path / "nan.npz", qpos=qpos)
    np.savez(tmp_path / "wide.npz", qpos=np.zeros((9, 50)))
    for clip, says in (
        ("empty.npz", r"empty\.npz: .*empty"),
        ("no.npz", r"no\.npz: cannot be read"),
        ("nan.npz", r"nan\.npz, frame 4: "),
        ("wide.npz", r"wide\.npz: .*50"),
    ):
        refused("validate", tmp_path / clip, *model, "--fps", "30", says=says)
    refused("validate", tmp_path / "wide.npz", *model, says="--fps")
    refused("validate", good, *model, says="no clip format")
    refused("validate", tmp_path / "wide.npz", *model, "--format", "pdf", says="--format is 'pdf'")
    refused("validate", tmp_path / "a.npz", "--model", tmp_path / "m.xml", says=r"m\.xml")


def test_other_commands(refused, tmp_path) -> None:
    refused("rules", "XYZ001", says="no rule 'XYZ001'")
    refused("inspect", tmp_path / "no.xml", says=r"no\.xml")
    refused("demo", "--out", "/proc/no", says="/proc/no")
    sheet = ("keyposes", "sheet", MODELS / "lamp.keyposes.toml", *LAMP[:2])
    refused(*sheet, "--out", tmp_path / "sheet.xyz", says=r"\.png")
    check = ("keyposes", "check", tmp_path / "no.toml", *LAMP[:2])
    refused(*check, says=r"no\.toml: cannot be read")


@pytest.mark.parametrize(
    "arguments", [["retarget"], ["retargt"], ["retarget", "a.bvh", "--dims", "0"], ["--nonsense"]]
)
def test_usage_errors_have_exit_code_2(run: Run, arguments: list[str]) -> None:
    got = run(*arguments)
    assert got.code == 2
    assert got.out == ""
    assert "Traceback" not in got.err


def test_debug_shows_the_traceback(run: Run, tmp_path, good, monkeypatch) -> None:
    monkeypatch.setattr(common, "debug", False)
    with pytest.raises(Exception, match="mass is -3"):
        run("retarget", good, *LAMP, "--mass", "-3", "--out", tmp_path / "o.npz", "--debug")


def test_a_full_disk_leaves_nothing_half_written(run: Run, tmp_path, good, monkeypatch) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    out = tmp_path / "o.npz"
    out.write_bytes(b"yesterday's clip")
    monkeypatch.setattr(os, "replace", fail)
    got = run("retarget", good, *LAMP, *QUICK, "--out", out)
    assert got.code == 2
    assert "No space left" in got.err
    assert out.read_bytes() == b"yesterday's clip"
    assert [p.name for p in tmp_path.glob(".*")] == []
