"""physretarget validate on folders, in several processes, into folders that do not exist."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from physretarget.cli import app, common
from physretarget.cli import validate as command
from physretarget.clip import Clip
from physretarget.errors import UsageError
from physretarget.kinematics import forward
from physretarget.mjcf import Character
from physretarget.validation import Settings, analysis, validate

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
    assert [f["code"] for f in floats["findings"]] == ["CON003", "CON007"]
    assert json.loads((out / "a_stands.json").read_text())["summary"]["passed"]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_one_broken_clip_does_not_stop_the_others(library: Path, jobs: str) -> None:
    (library / "clips" / "c_broken.npz").write_bytes(b"nothing")
    code, said = run(library, "--format", "markdown", "--jobs", jobs)
    assert code == 2
    assert "c_broken.npz" in said
    assert "a_stands" in said
    assert "b_floats" in said


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_clip_that_nobody_could_read_is_an_error_to_ci(library: Path, jobs: str) -> None:
    (library / "clips" / "c_broken.npz").write_bytes(b"nothing")
    out = library / "all"
    for suffix, format_ in ((".xml", "junit"), (".sarif", "sarif"), (".json", "json")):
        told = ("--format", format_, "--out", str(out.with_suffix(suffix)), "--jobs", jobs)
        assert run(library, *told)[0] == 2
    suite = Xml.fromstring(out.with_suffix(".xml").read_bytes())[2]
    assert suite.get("name", "").endswith("c_broken.npz")
    assert (suite.get("tests"), suite.get("errors")) == ("1", "1")
    assert "c_broken.npz" in suite[0][0].get("message", "")
    (only,) = json.loads(out.with_suffix(".sarif").read_text())["runs"]
    (invocation,) = only["invocations"]
    assert not invocation["executionSuccessful"]
    (notice,) = [n for n in invocation["toolExecutionNotifications"] if n["level"] == "error"]
    place = notice["locations"][0]["physicalLocation"]["artifactLocation"]
    assert place["uri"].endswith("c_broken.npz")
    assert names_in(out.with_suffix(".json").read_text(), "json") == [
        "a_stands.npz",
        "b_floats.npz",
    ]


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


def test_the_help_names_every_unit_and_one_written_out_is_taken(library: Path) -> None:
    told = CliRunner().invoke(app, ["validate", "--help"]).output
    assert "--unit m|cm|mm|inch|METRES" in told
    assert "metres per unit (for example 0.0254)" in " ".join(told.split())
    code, said = run(library, "--format", "json", "--unit", "0.5")
    assert code == 1  # boxes at half their height stand in the floor
    assert any("0.5 m to the unit" in n for r in json.loads(said) for n in r["clip"]["notes"])


def test_an_unknown_joint_order_and_an_empty_folder_are_usage_errors(library: Path) -> None:
    assert run(library, "--joint-order", "alphabetic")[0] == 2
    for path in (library / "clips").glob("*.npz"):
        path.unlink()
    assert run(library)[0] == 2


BRANCHES = """<mujoco><worldbody><geom type="plane" size="9 9 .1"/>
<body name="trunk" pos="0 0 .1"><freejoint name="root"/><geom type="box" size=".1 .1 .1" mass="3"/>
<body name="l1" pos="0 .2 .1"><joint name="l1" axis="0 1 0"/><geom size=".02" mass=".1"/>
<body name="l2" pos="0 .2 0"><joint name="l2" axis="0 0 1"/><geom size=".02" mass=".1"/></body>
</body>
<body name="r1" pos="0 -.2 .1"><joint name="r1" axis="0 1 0"/><geom size=".02" mass=".1"/></body>
</body></worldbody></mujoco>"""


def nameless(folder: Path, order: str) -> tuple[Path, Path, np.ndarray]:
    """A motion npz that names no joints, in the model's or in breadth-first order, and whose
    bodies do not tell which."""
    (folder / "branches.xml").write_text(BRANCHES)
    character = Character.load(folder / "branches.xml")
    qpos = np.tile(character.reference_qpos, (20, 1))
    qpos[:, 7:] = np.linspace(0, 1, 20)[:, None] * [0.3, 0.5, -0.4]
    columns = [7, 8, 9] if order == "model" else [7, 9, 8]
    bodies = forward(character.tree, qpos).position[:, 1:2]
    quat = np.tile([1.0, 0, 0, 0], (20, 1, 1))
    np.savez(
        folder / f"{order}.npz", fps=30, joint_pos=qpos[:, columns], body_pos_w=bodies,
        body_quat_w=quat,
    )  # fmt: skip
    return folder / f"{order}.npz", folder / "branches.xml", qpos


@pytest.mark.parametrize("order", ["model", "breadth-first"])
def test_a_told_joint_order_is_used(tmp_path: Path, order: str) -> None:
    path, model, qpos = nameless(tmp_path, order)
    base = ["validate", str(path), "--model", str(model), "--format", "json"]
    refused = CliRunner().invoke(app, base)
    assert "joint order" in str(refused.exception)
    told = CliRunner().invoke(app, [*base, "--joint-order", order])
    document = json.loads(told.stdout)
    assert f"Joint order {order} as told." in document["clip"]["notes"]
    wanted = validate(Clip(qpos=qpos, time=np.arange(20) / 30), Character.load(model))
    speed = wanted.measures["joint_speed_max_rad_s"]
    assert document["measures"]["joint_speed_max_rad_s"]["value"] == pytest.approx(speed.value)
    other = "model" if order == "breadth-first" else "breadth-first"
    wrong = json.loads(CliRunner().invoke(app, [*base, "--joint-order", other]).stdout)
    assert wrong["measures"] != document["measures"]


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_several_clips_in_their_order_whatever_the_jobs(library: Path, jobs: str) -> None:
    clips = [library / "clips" / f"{name}.npz" for name in ("b_floats", "a_stands")]
    result = CliRunner().invoke(
        app,
        ["validate", *map(str, clips), "--model", str(library / "box.xml"), "--format", "json",
         "--jobs", jobs],
    )  # fmt: skip
    assert [Path(d["clip"]["path"]).name for d in json.loads(result.stdout)] == [
        "b_floats.npz", "a_stands.npz",
    ]  # fmt: skip


def names_in(text: str, format_: str) -> list[str]:
    """The clips that a document is about, by a parser of its format."""
    if format_ == "junit":
        root = Xml.fromstring(text.split("\n", 1)[1])
        assert root.tag == "testsuites"
        paths = [suite.get("name", "") for suite in root]
    elif format_ == "json":
        paths = [report["clip"]["path"] for report in json.loads(text)]
    elif format_ == "sarif":
        (only,) = json.loads(text)["runs"]
        paths = [artifact["location"]["uri"] for artifact in only["artifacts"]]
    elif format_ == "markdown":
        return re.findall(r"^### .*`(\w+\.npz)`", text, flags=re.MULTILINE)
    else:
        paths = sorted(set(re.findall(r"\S+\.npz", text)))  # the worst come first
    return [Path(path).name for path in paths]


@pytest.mark.parametrize(
    ("format_", "name"),
    [("json", "all.json"), ("sarif", "all.sarif"), ("sarif", "all.sarif.json"),
     ("junit", "all.xml"), ("markdown", "all.md"), ("text", "all.txt")],
)  # fmt: skip
def test_several_clips_make_one_document(library: Path, format_: str, name: str) -> None:
    told = ["validate", str(library / "clips"), "--model", str(library / "box.xml"), "--format"]
    printed = CliRunner().invoke(app, [*told, format_])
    assert names_in(printed.stdout, format_) == ["a_stands.npz", "b_floats.npz"]
    code, said = run(library, "--format", format_, "--out", str(library / "new" / name))
    assert code == 1
    assert "2 clips, 1 failed" in said
    assert [p.name for p in (library / "new").iterdir()] == [name]
    assert (library / "new" / name).read_text() == printed.stdout


def test_junit_fails_by_what_makes_the_exit_code_one(library: Path) -> None:
    """A warning is a failure to the file where it is one to the shell."""
    config = library / "mild.toml"
    config.write_text('[severity]\nCON003 = "warning"\n')
    for fail_on, failures in (("error", 0), ("warning", 2)):
        code, said = run(
            library, "--format", "junit", "--config", str(config), "--fail-on", fail_on
        )  # fmt: skip
        assert code == (1 if failures else 0)
        assert sum(int(s.get("failures", "")) for s in Xml.fromstring(said.split("\n", 1)[1])) == (
            failures
        )


def test_a_folder_stays_an_array_whatever_it_holds(library: Path) -> None:
    (library / "clips" / "b_floats.npz").unlink()
    code, said = run(library, "--format", "json")
    assert code == 0
    assert names_in(said, "json") == ["a_stands.npz"]


@pytest.mark.parametrize("name", ["reports", "reports.d", "there.json"])
def test_a_folder_gets_a_file_for_each_clip(library: Path, name: str) -> None:
    (library / "there.json").mkdir()
    assert run(library, "--format", "junit", "--out", str(library / name))[0] == 1
    assert sorted(p.name for p in (library / name).iterdir()) == ["a_stands.xml", "b_floats.xml"]


def test_one_clip_goes_into_a_folder_that_is_there_and_else_becomes_the_file(library: Path) -> None:
    (library / "there").mkdir()
    told = ["validate", str(library / "clips" / "a_stands.npz"), "--model"]
    for out in ("there", "report"):
        given = [*told, str(library / "box.xml"), "--format", "json", "--out", str(library / out)]
        assert CliRunner().invoke(app, given).exit_code == 0
    document = json.loads((library / "there" / "a_stands.json").read_text())
    assert document == json.loads((library / "report").read_text())


@pytest.mark.parametrize("out", [(), ("--out", "page.html")])
def test_html_of_several_clips_needs_a_folder(
    library: Path, out: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(library)
    told = ["validate", str(library / "clips"), "--model", str(library / "box.xml")]
    refused = CliRunner().invoke(app, [*told, "--format", "html", *out])
    assert isinstance(refused.exception, UsageError)
    assert refused.exception.exit_code == 2
    assert "--out must name a folder" in str(refused.exception)
    assert not Path("page.html").exists()
    assert run(library, "--format", "html", "--out", "pages")[0] == 1
    assert sorted(p.name for p in Path("pages").iterdir()) == ["a_stands.html", "b_floats.html"]


def test_a_file_in_the_folders_place_is_an_error(library: Path) -> None:
    (library / "reports").write_text("mine")
    assert run(library, "--out", str(library / "reports"))[0] == 2
    assert (library / "reports").read_text() == "mine"


def test_progress_is_shown_on_a_terminal_and_nowhere_else(
    library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = str(library / "clips" / "a_stands.npz")
    told = ["validate", clip, "--model", str(library / "box.xml"), "--format", "json"]
    quiet = CliRunner().invoke(app, told)
    assert "validate" not in quiet.stderr
    screen = io.StringIO()
    terminal = Console(file=screen, force_terminal=True, highlight=False, width=100)
    monkeypatch.setattr(common, "messages", terminal)
    monkeypatch.setattr(command, "messages", terminal)
    shown = CliRunner().invoke(app, told)
    assert "validate a_stands.npz" in screen.getvalue()
    # Pipes get the report alone, whether there is a terminal for messages or not.
    assert shown.stdout == quiet.stdout
    json.loads(shown.stdout)


def test_progress_goes_on_within_a_clip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(analysis, "CHUNK", 25)
    box = Character.from_xml(BOX, name="box")
    clip = Clip(qpos=np.tile(box.reference_qpos, (60, 1)), time=np.arange(60) / 30)
    seen: list[tuple[int, int]] = []
    validate(clip, box, settings=Settings(), progress=lambda done, all_: seen.append((done, all_)))
    assert seen == [(25, 60), (50, 60), (60, 60)]
