"""The GitHub Action and the pre-commit hook do what they say, outside of their platforms."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from physretarget.cli import COMMANDS

ROOT = Path(__file__).parents[1]
BOX = (
    "<mujoco><worldbody><body name='box' pos='0 0 0.1'><freejoint/>"
    "<geom type='box' size='0.1 0.1 0.1'/></body></worldbody></mujoco>"
)


@pytest.fixture
def clips(tmp_path: Path) -> Path:
    """A box that stands, and one that hangs in the air."""
    (tmp_path / "box.xml").write_text(BOX)
    folder = tmp_path / "clips"
    folder.mkdir()
    for name, height in (("stands", 0.1), ("floats", 0.5)):
        (folder / f"{name}.csv").write_text(f"0,0,{height},1,0,0,0\n" * 60)
    return folder


def validate_step() -> tuple[str, dict[str, str]]:
    steps = yaml.safe_load((ROOT / "action.yml").read_text())["runs"]["steps"]
    (step,) = (each for each in steps if each.get("name") == "Validate")
    return step["run"], step["env"]


@pytest.mark.parametrize(("which", "code"), [("stands", 0), ("floats", 1)])
def test_the_action_fails_where_a_clip_does(clips: Path, which: str, code: int) -> None:
    script, names = validate_step()
    assert not re.search(r"\$\{\{", script), "inputs in the script could be executed"
    assert set(names) == {"CLIPS", "ARGUMENTS", "SARIF"}
    bin_folder = clips.parent / "bin"
    bin_folder.mkdir()
    program = bin_folder / "physretarget"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m physretarget "$@"\n')
    program.chmod(0o755)
    environment = {
        **os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}", "CLIPS": f"clips/{which}.csv",
        "ARGUMENTS": "--model box.xml --fps 30 --quat wxyz", "SARIF": "out.sarif",
    }  # fmt: skip
    done = subprocess.run(
        ["bash", "-e", "-c", script], cwd=clips.parent, env=environment, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == code, done.stderr
    results = yaml.safe_load((clips.parent / "out.sarif").read_text())["runs"][0]["results"]
    assert all(r["locations"][0]["physicalLocation"]["region"]["startLine"] >= 1 for r in results)
    assert any(r["level"] == "error" for r in results) == (code == 1)


def test_the_action_installs_what_the_repository_has() -> None:
    steps = yaml.safe_load((ROOT / "action.yml").read_text())["runs"]["steps"]
    text = " ".join(step.get("run", "") for step in steps)
    assert (ROOT / "constraints.txt").is_file()
    assert '"$GITHUB_ACTION_PATH"' in text


def test_the_hook_names_a_command() -> None:
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    program, command = hook["entry"].split()
    assert program == "physretarget"
    assert command in COMMANDS
    assert re.search(hook["files"], "motion/walk.csv")
