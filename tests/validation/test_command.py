"""physretarget validate on folders, in several processes, into folders that do not exist."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from physretarget.cli import app
from physretarget.clip import Clip

BOX = """<mujoco><worldbody><geom type="plane" size="9 9 .1"/><body pos="0 0 .1"><freejoint/>
<geom type="box" size=".1 .1 .1" mass="3"/></body></worldbody></mujoco>"""


@pytest.fixture
def library(tmp_path: Path) -> Path:
    (tmp_path / "box.xml").write_text(BOX)
    folder = tmp_path / "clips"
    folder.mkdir()
    for name, height in (("b_floats", 0.2), ("a_stands", 0.1)):
        qpos = np.tile([0, 0, height, 1, 0, 0, 0], (60, 1))
        Clip(qpos=qpos, time=np.arange(60) / 30).save(folder / f"{name}.npz")
    (folder / "notes.txt").write_text("no clip")
    return tmp_path


def run(library: Path, *options: str) -> tuple[int, str]:
    told = ["validate", str(library / "clips"), "--model", str(library / "box.xml"), *options]
    result = CliRunner().invoke(app, told)
    # What the program's main() turns into its exit code.
    code = getattr(result.exception, "exit_code", result.exit_code)
    return code, result.output


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_folder_is_judged_clip_by_clip(library: Path, jobs: str) -> None:
    out = library / "new" / "reports"
    code, _ = run(library, "--format", "json", "--out", str(out), "--jobs", jobs)
    assert code == 1
    assert sorted(p.name for p in out.iterdir()) == ["a_stands.json", "b_floats.json"]
    floats = json.loads((out / "b_floats.json").read_text())
    assert [f["code"] for f in floats["findings"]] == ["CON003"]
    assert json.loads((out / "a_stands.json").read_text())["summary"]["passed"]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_one_broken_clip_does_not_stop_the_others(library: Path, jobs: str) -> None:
    (library / "clips" / "c_broken.npz").write_bytes(b"nothing")
    code, said = run(library, "--format", "markdown", "--jobs", jobs)
    assert code == 2
    assert "c_broken.npz" in said
    assert "a_stands" in said
    assert "b_floats" in said


def test_parents_of_out_are_made_and_html_shows_forces(library: Path) -> None:
    out = library / "deep" / "er" / "page.html"
    clip = str(library / "clips" / "a_stands.npz")
    result = CliRunner().invoke(
        app,
        ["validate", clip, "--model", str(library / "box.xml"), "--format", "html", "--out",
         str(out)],
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "contact force" in out.read_text(encoding="utf-8")


def test_an_unknown_joint_order_and_an_empty_folder_are_usage_errors(library: Path) -> None:
    assert run(library, "--joint-order", "alphabetic")[0] == 2
    for path in (library / "clips").glob("*.npz"):
        path.unlink()
    assert run(library)[0] == 2
