"""What every command owes its user: help with an example, streams, exit codes, same bytes."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main

import physretarget
from physretarget.cli import app
from physretarget.clip import Clip, load_clip
from physretarget.mjcf import Character

from .conftest import LAMP, MODELS, Run


def _commands() -> list[tuple[str, ...]]:
    def walk(group, before: tuple[str, ...]):
        yield before
        for name in getattr(group, "commands", {}):
            _, command, _ = group.resolve_command(typer.Context(group), [name])
            yield from walk(command, (*before, name))

    return list(walk(typer.main.get_command(app), ()))


COMMANDS = _commands()


def _is_group(command: tuple[str, ...]) -> bool:
    return any(c[:-1] == command for c in COMMANDS if c)


def test_the_commands_that_were_promised_are_there() -> None:
    promised = {
        "demo", "retarget", "learn", "validate", "rules", "inspect", "replay", "convert",
        "fix", "forces",
    }  # fmt: skip
    assert promised <= {c[0] for c in COMMANDS if c}
    assert {("keyposes", "check"), ("keyposes", "sheet")} <= set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_help_has_an_example_of_this_very_command(run: Run, command: tuple[str, ...]) -> None:
    got = run(*command, "--help")
    assert got.code == 0
    assert got.err == ""
    text = " ".join(got.out.split())
    assert "Example: " + " ".join(("physretarget", *command)) in text
    assert _is_group(command) or ("--quiet" in text and "--debug" in text)
    assert "{" not in text.split("Options:")[0], "braces of Typer's"
    # What to write, and what for: no names of Python types, no option without a word.
    assert not re.search(r"<(list|path|int|float|str)", text)
    for line, following in pairwise(got.out.split("Example: ")[0].splitlines()):
        if re.fullmatch(r"  --[a-z-]+( [^ ]+)?", line):
            assert following.startswith(" " * 10), line


@pytest.mark.parametrize("command", [c for c in COMMANDS if c], ids=" ".join)
def test_examples_use_options_that_exist(run: Run, command: tuple[str, ...]) -> None:
    text = " ".join(run(*command, "--help").out.split())
    usage, example = text.split("Example: ")
    for option in re.findall(r"--[a-z-]+", example):
        assert option in usage or _is_group(command)


def test_version(run: Run) -> None:
    assert run("--version").out == f"physretarget {physretarget.__version__}\n"


def test_retarget_writes_a_clip_and_tells_on_stderr(run: Run, tmp_path: Path, good: Path) -> None:
    out = tmp_path / "new" / "folder" / "clip.npz"
    got = run("retarget", good, *LAMP, "--mapper", "pca", "--until", "contacted", "--out", out)
    assert got.code == 0
    assert got.out == ""
    assert "clip.npz: 45 frames" in got.err.replace("\n", " ")
    assert "\x1b" not in got.err  # neither colour nor bar when piped
    lamp = Character.load(MODELS / "lamp.xml")
    clip = load_clip(out, character=lamp)
    assert clip.joint_names == lamp.joint_names
    assert clip.model_sha256 == lamp.sha256
    assert clip.contact_active is not None
    assert clip.meta["inputs"]["capture"]["name"] == "bow.bvh"
    assert {p.name for p in out.parent.iterdir()} == {"clip.npz"}


def test_quiet_is_silent(run: Run, tmp_path: Path, good: Path) -> None:
    mapper, clip = tmp_path / "m.npz", tmp_path / "c.npz"
    learned = run("learn", *LAMP, "--mapper", "nn3", "--out", mapper, "--quiet")
    assert (learned.code, learned.out, learned.err) == (0, "", "")
    made = run("retarget", good, *LAMP[:2], "--mapper", mapper, "--out", clip, "-q")
    assert (made.code, made.out, made.err) == (0, "", "")
    judged = run("validate", clip, "--model", LAMP[1], "--out", tmp_path / "r.txt", "--quiet")
    assert judged.code in (0, 1)
    assert (judged.out, judged.err) == ("", "")


def test_validate_prints_results_to_stdout_and_fails_on_findings(run: Run, tmp_path: Path) -> None:
    lamp = Character.load(MODELS / "lamp.xml")
    still = Clip(
        qpos=lamp.reference_qpos[None].repeat(30, axis=0),
        time=np.arange(30) / 30,
        joint_names=lamp.joint_names,
    )
    still.save(tmp_path / "still.npz")
    hovering = still.qpos.copy()
    hovering[:, 2] += 0.5
    Clip(qpos=hovering, time=still.time, joint_names=lamp.joint_names).save(
        tmp_path / "hovering.npz"
    )
    model = ("--model", LAMP[1])
    fine = run("validate", tmp_path / "still.npz", *model)
    assert (fine.code, fine.err) == (0, "")
    assert fine.out
    bad = run("validate", tmp_path / "hovering.npz", *model, "--format", "json")
    assert (bad.code, bad.err) == (1, "")
    assert bad.out.lstrip().startswith("{")
    both = run(
        "validate", tmp_path / "still.npz", tmp_path / "hovering.npz", *model, "--format", "json",
        "--out", tmp_path / "reports",
    )  # fmt: skip
    assert (both.code, both.out) == (1, "")
    names = {p.name for p in (tmp_path / "reports").iterdir()}
    assert names == {"still.json", "hovering.json"}


def test_rules_and_inspect_print_to_stdout(run: Run) -> None:
    assert "DYN001" in run("rules").out
    assert "DYN001" in run("rules", "dyn001").out
    assert run("inspect", LAMP[1]).out.startswith("lamp: ")


def test_retarget_says_where_the_report_is(run: Run, tmp_path: Path, good: Path) -> None:
    got = run(
        "retarget", good, *LAMP, "--out", tmp_path / "c.npz", "--report", tmp_path / "r",
    )  # fmt: skip
    assert got.code == 0
    assert "report.html: the report" in got.err.replace("\n", " ")
    assert (tmp_path / "r" / "report.html").is_file()


@pytest.mark.parametrize("until", ["mapped", "balanced"])
def test_retarget_ends_with_the_verdict(run: Run, tmp_path: Path, good: Path, until: str) -> None:
    clip, folder = tmp_path / "c.npz", tmp_path / "r"
    got = run("retarget", good, *LAMP, "--until", until, "--out", clip, "--report", folder)
    judged = json.loads((folder / "report.json").read_text())
    summary, findings = judged["summary"], judged["findings"]
    (line,) = (each for each in got.err.splitlines() if "plausible" in each)
    assert summary["passed"] == (until == "balanced"), "on the spot, its feet off the floor"
    assert line.startswith(f"{clip}: {'' if summary['passed'] else 'not '}plausible, ")
    assert f"{summary['errors']} error" in line
    for worst in findings[:1]:
        shown = [cause["message"] for cause in judged["causes"]] or [
            f"{worst['code']} at {worst['time_s']:.2f} s: {worst['message']}"
        ]
        assert any(each in line for each in shown)


def test_retarget_without_a_report_says_how_to_get_the_verdict(
    run: Run, tmp_path: Path, good: Path
) -> None:
    twin, out = good.parent / "second bow.bvh", tmp_path / "clips"
    twin.write_text(good.read_text())
    got = run("retarget", good, twin, *LAMP, "--mapper", "pca", "--out", out)
    words = shlex.split(got.err.splitlines()[-1].split("? ")[1])
    assert words[:2] == ["physretarget", "validate"]
    assert run(*words[1:]).out.startswith("2 clips, ")


def test_inspect_names_the_part_that_it_speaks_of(run: Run, tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(
        "<mujoco><worldbody><body name='forearm'><freejoint/><geom size='0.1'/>"
        "<body name='hand'><joint name='wrist'/><geom size='0.1'/></body></body>"
        "</worldbody></mujoco>"
    )
    assert "limit_missing: joint wrist: " in run("inspect", str(model)).out


def test_the_help_lists_commands_whole_and_the_first_to_try_first(run: Run) -> None:
    listed = run("--help").out.split("Commands:")[1]
    assert listed.split()[0] == "demo"
    assert "..." not in listed
    groups = [c for c in COMMANDS if c and _is_group(c)]
    assert groups
    assert all("..." not in run(*c, "--help").out.split("Commands:")[1] for c in groups)


def test_a_folder_takes_a_single_capture_too(run: Run, tmp_path: Path, good: Path) -> None:
    (tmp_path / "clips").mkdir()
    quick = ("--mapper", "nn3", "--until", "mapped")
    assert run("retarget", good, *LAMP, *quick, "--out", tmp_path / "clips").code == 0
    assert (tmp_path / "clips" / "bow.npz").is_file()


def _process(*arguments: object, folder: Path, seed: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "physretarget", *map(str, arguments)],
        cwd=folder,
        env={**os.environ, "PYTHONHASHSEED": seed},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_same_inputs_same_bytes_in_two_processes(tmp_path: Path, good: Path) -> None:
    made = []
    for seed in ("1", "2"):
        folder = tmp_path / seed
        folder.mkdir()
        learned = _process("learn", *LAMP, "--out", "m.npz", folder=folder, seed=seed)
        assert learned.returncode == 0, learned.stderr
        done = _process(
            "retarget", good, *LAMP[:2], "--mapper", "m.npz", "--out", "c.npz", "--report", "r",
            folder=folder, seed=seed,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        made.append({p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()})
    assert made[0].keys() == made[1].keys()
    assert [name for name in made[0] if made[0][name] != made[1][name]] == []


@pytest.mark.slow
def test_a_terminal_sees_progress(tmp_path: Path, good: Path) -> None:
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [
            sys.executable, "-m", "physretarget", "retarget", str(good), *LAMP,
            "--mapper", "pca", "--out", str(tmp_path / "c.npz"),
        ],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=theirs,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "200"},
    ) as process:  # fmt: skip
        os.close(theirs)
        seen = b""
        try:
            while chunk := os.read(ours, 4096):
                seen += chunk
        except OSError:  # Linux says EIO when the other side closes
            pass
    os.close(ours)
    assert process.returncode == 0
    assert b"bow.bvh" in seen
    assert b"\x1b[" in seen


def test_a_library_is_curated(run: Run, tmp_path: Path, good: Path) -> None:
    clips, kept, table = tmp_path / "clips", tmp_path / "kept", tmp_path / "table.csv"
    twin = good.parent / "second.bvh"
    twin.write_text(good.read_text())
    run("retarget", good, twin, *LAMP, "--mapper", "pca", "--out", clips)
    given = ("validate", clips, "--model", LAMP[1], "--ignore", "DYN,CON,KIN,SIM")
    got = run(*given, "--format", "csv", "--out", table, "--copy-passed", kept,
              "--where", "verdict == 'not judged'")  # fmt: skip
    assert got.code == 0
    assert "--where: 0 clips (0.0 s) of 2 clips" in got.err
    assert not list(kept.iterdir())
    given = (
        "validate",
        clips,
        "--model",
        LAMP[1],
        "--select",
        "DYN001",
        "--severity",
        "DYN001=warning",
    )
    got = run(*given, "--format", "csv", "--out", table, "--copy-passed", kept)
    assert got.code == 0, got.err
    assert len(table.read_text().splitlines()) == 3
    assert sorted(p.name for p in kept.iterdir()) == sorted(p.name for p in clips.iterdir())
    assert all((clips / p.name).read_bytes() == p.read_bytes() for p in kept.iterdir())
    assert run(*given, "--copy-passed", clips).code == 2, "onto themselves"
    assert run(*given, clips, "--copy-passed", tmp_path / "two").code == 2, "one name, two clips"
    assert run(*given, "--where", "verdict = 1").code == 2
    assert run(*given, "--format", "parquet").code == 2, "not to a terminal"


def test_a_condition_without_a_column_is_refused_with_the_first_clip(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not after the last of a night's clips, whose verdicts would be lost."""
    from physretarget.cli import validate

    (tmp_path / "box.xml").write_text(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    for name in "abc":
        (tmp_path / f"{name}.csv").write_text("0,0,0.1,1,0,0,0\n" * 20)
    judged: list[Path] = []
    judge = validate._judge

    def noted(path: Path, *more: Any) -> Any:
        judged.append(path)
        return judge(path, *more)

    monkeypatch.setattr(validate, "_judge", noted)
    clips = [tmp_path / f"{name}.csv" for name in "abc"]
    got = run("validate", *clips, "--model", tmp_path / "box.xml", "--fps", "30", "--quat", "wxyz",
              "--where", "no_such < 1")  # fmt: skip
    assert got.code == 2
    assert "no_such" in got.err
    assert len(judged) == 1
