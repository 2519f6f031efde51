"""The examples run, and the papers that stand beside the code say what is there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from physretarget._version import __version__
from physretarget.clip import Clip
from physretarget.demo import models_folder
from physretarget.face import Curve, Key, Shot, read_shots, write_shot
from physretarget.mjcf import Character

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"


def run(name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(EXAMPLES / name), *map(str, arguments)], capture_output=True,
        text=True, check=False, timeout=300,
    )  # fmt: skip


def test_a_clip_is_judged(tmp_path: Path) -> None:
    lamp = Character.load(models_folder() / "lamp.xml")
    still = np.tile(lamp.reference_qpos, (40, 1))
    Clip(qpos=still, time=np.arange(40) / 30).save(tmp_path / "still.npz")
    assert (
        run("validate_clip.py", tmp_path / "still.npz", models_folder() / "lamp.xml").returncode
        == 0
    )
    still[:, lamp.root_qpos + 2] += 0.5
    Clip(qpos=still, time=np.arange(40) / 30).save(tmp_path / "floats.npz")
    failed = run("validate_clip.py", tmp_path / "floats.npz", models_folder() / "lamp.xml")
    assert failed.returncode == 1
    assert failed.stdout.startswith("failed")


def test_a_capture_is_retargeted(tmp_path: Path, motions: Path) -> None:
    done = run("retarget_capture.py", motions / "humanoid3d_jump.txt", tmp_path / "jump.npz")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "jump.npz").is_file()


def test_an_own_character_is_posed(tmp_path: Path, motions: Path) -> None:
    rig = tmp_path / "duck.xml"
    rig.write_text(
        "<mujoco><compiler angle='degree' autolimits='true'/><worldbody><body name='base'>"
        "<geom type='box' size='.1 .08 .02' mass='2'/><body name='neck' pos='0 0 .02'>"
        "<joint name='pitch' axis='0 1 0' range='-60 60'/>"
        "<geom type='capsule' fromto='0 0 0 0 0 .2' size='.02' mass='.2'/>"
        "<body name='head' pos='0 0 .2'><joint name='nod' axis='0 1 0' range='-60 60'/>"
        "<geom type='capsule' fromto='0 0 0 .08 0 0' size='.03' mass='.1'/></body></body></body>"
        "</worldbody></mujoco>"
    )
    done = run("own_character.py", rig, motions / "humanoid3d_walk.txt")
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d key poses; (passed|failed)", done.stdout)


def test_robot_clips_are_judged_in_ci(tmp_path: Path) -> None:
    lamp = Character.load(models_folder() / "lamp.xml")
    rows = np.tile(lamp.reference_qpos, (40, 1))
    (tmp_path / "clips").mkdir()
    np.savetxt(tmp_path / "clips" / "still.csv", rows, delimiter=",")
    command = [EXAMPLES / "robot_clip_in_ci.sh", models_folder() / "lamp.xml", "clips", "30"]
    done = subprocess.run(
        [str(word) for word in command], cwd=tmp_path, capture_output=True, text=True,
        check=False, timeout=120,
        env={**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for name in ("clips.junit.xml", "clips.sarif", "summary.md"):
        assert (tmp_path / name).stat().st_size > 100


def test_a_capture_is_posed_frame_by_frame(motions: Path) -> None:
    done = run("stream_capture.py", motions / "humanoid3d_jump.txt")
    assert done.returncode == 0, done.stderr
    assert "stands on" in done.stdout
    assert re.search(r"\d+ frames, median", done.stdout)


def test_a_face_becomes_sparse(tmp_path: Path) -> None:
    time = np.arange(61) / 30
    rise = np.interp(time, [0.0, 0.4, 0.8, 1.4, 1.8, 2.0], [0, 0, 1, 1, 0, 0])
    smooth = rise**2 * (3 - 2 * rise)
    rows = [
        "time,BrowInnerUp",
        *(f"{t:.4f},{v:.5f}" for t, v in zip(time, smooth, strict=True)),
    ]
    (tmp_path / "take.csv").write_text("\n".join(rows) + "\n")
    shots = tmp_path / "shots"
    shots.mkdir()
    for number in range(3):
        keys = [Key(0.3 * k + 0.1 * number, float(k % 2)) for k in range(8)]
        write_shot(
            shots / f"shot_{number}.curves.json", Shot(f"shot {number}", {"brow": Curve(keys)})
        )
    out = tmp_path / "out.curves.json"
    done = run("face_curves.py", tmp_path / "take.csv", shots, out)
    assert done.returncode == 0, done.stderr
    found = re.search(r"BrowInnerUp: 61 frames → (\d+) keys", done.stdout)
    assert found
    assert 2 <= int(found[1]) <= 15
    assert len(read_shots(out)[0].curves["BrowInnerUp"].keys) == int(found[1])


def test_a_library_is_judged_at_night(tmp_path: Path) -> None:
    pytest.importorskip("sqlalchemy", reason="suites need the extra 'suite'")
    (tmp_path / "models").mkdir()
    (tmp_path / "examples" / "clips").mkdir(parents=True)
    shutil.copy(models_folder() / "lamp.xml", tmp_path / "models")
    shutil.copy(EXAMPLES / "nightly.toml", tmp_path / "examples")
    lamp = Character.load(models_folder() / "lamp.xml")
    still = np.tile(lamp.reference_qpos, (40, 1))
    Clip(qpos=still, time=np.arange(40) / 30).save(tmp_path / "examples" / "clips" / "still.npz")
    done = subprocess.run(
        [sys.executable, "-m", "physretarget", "suite", "run", "examples/nightly.toml"],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "examples" / "nightly-report" / "index.html").is_file()


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.ipynb")), ids=lambda p: p.name)
def test_a_notebook_runs(path: Path, motions: Path, tmp_path: Path) -> None:
    nbformat = pytest.importorskip("nbformat", reason="notebooks need the extra 'test'")
    nbclient = pytest.importorskip("nbclient", reason="notebooks need the extra 'test'")
    notebook = nbformat.read(path, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "kept without outputs"
    nbclient.NotebookClient(
        notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    printed = "".join(output.get("text", "") for output in outputs)
    assert "passed" in printed or "failed" in printed


def test_every_example_is_run_here() -> None:
    text = Path(__file__).read_text() + (ROOT / "tests/service/test_examples.py").read_text()
    assert all(
        f'"{path.name}"' in text or path.suffix == ".ipynb"
        for path in EXAMPLES.iterdir()
        if path.is_file()
    )


def test_the_map_of_rooms_is_that_of_the_house() -> None:
    rooms = {
        path.stem
        for path in (ROOT / "physretarget").iterdir()
        if path.is_dir() and (path / "__init__.py").is_file()
    }
    text = (ROOT / "CONTRIBUTING.md").read_text()
    named = set(re.findall(r"`(\w+)`", text))
    assert rooms - named <= {"assets", "conversion", "groundtruth"}


@pytest.mark.parametrize("path", sorted((ROOT / ".github").rglob("*.yml")), ids=lambda p: p.name)
def test_workflows_are_yaml_and_call_what_there_is(path: Path) -> None:
    content = yaml.safe_load(path.read_text())
    assert content["name"]
    for job in content.get("jobs", {}).values():
        for step in job["steps"]:
            command = step.get("run", "")
            if command.startswith(".ci/"):
                assert os.access(ROOT / command.split()[0], os.X_OK)
            if "-m benchmarks." in command:
                module = command.split("-m benchmarks.")[1].split()[0]
                assert any((ROOT / "benchmarks").glob(f"{module}*"))


def test_the_citation_has_the_version() -> None:
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == __version__
