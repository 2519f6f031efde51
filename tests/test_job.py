"""One job gives one result, whoever asks for it."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physretarget import cli
from physretarget.clip import Clip, load_clip
from physretarget.demo import models_folder
from physretarget.errors import InputError, UsageError
from physretarget.job import load_character, mapper_of, run_job
from physretarget.mjcf import Character
from physretarget.suite.file import load_suite
from physretarget.suite.plan import plan
from physretarget.suite.work import perform

from .cli.conftest import bvh_text

LAMP, POSES = models_folder() / "lamp.xml", models_folder() / "lamp.keyposes.toml"
OPTIONS = {  # of both kinds of job
    "validate": {"lowpass": 5.0, "unit": "cm", "fps": 20.0, "ignore": ["DAT"], "friction": 0.3,
                 "thresholds": {"CON003": {"error": 0.001}}, "profile": "robot"},
    "retarget": {"mapper": "pca", "dims": 6, "until": "placed", "resample": 25.0, "mass": 60.0,
                 "lowpass": 3.0, "heading": "momentum", "select": ["CON", "DYN"]},
}  # fmt: skip
FILES: dict[str, dict[str, Any]] = {
    "validate": {"model": LAMP},
    "retarget": {"character": LAMP, "keyposes": [POSES]},
}


@pytest.fixture
def sources(tmp_path: Path) -> dict[str, Path]:
    """A clip that hovers, in centimetres and without a header, and a capture that bows."""
    lamp = Character.load(LAMP)
    qpos = lamp.reference_qpos[None].repeat(40, axis=0)
    qpos[:, 2] += 0.05 + 0.01 * np.sin(np.arange(40) / 3)
    qpos[:, :3] *= 100
    clip, capture = tmp_path / "hover.npy", tmp_path / "bow.bvh"
    np.save(clip, qpos)
    capture.write_text(bvh_text())
    return {"validate": clip, "retarget": capture}


def by_hand(kind: str, source: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    words = [kind, str(source), "--model", str(LAMP)]
    for name, value in OPTIONS[kind].items():
        if isinstance(value, dict):
            value = ",".join(f"{c}.{n}={v}" for c, e in value.items() for n, v in e.items())
        text = ",".join(value) if isinstance(value, list) else str(value)
        words += [f"--{name.replace('_', '-')}", text]
    if kind == "retarget":
        words += ["--keyposes", str(POSES), "--out", str(folder / "out.npz")]
        words += ["--report", str(folder / "r")]
    else:
        words += ["--format", "json", "--out", str(folder / "out.json")]
    monkeypatch.setattr("sys.argv", ["physretarget", *words, "--quiet"])
    with suppress(SystemExit):
        cli.main()
    made = "out.json" if kind == "validate" else "r/report.json"
    return json.loads((folder / made).read_text())


def in_a_suite(kind: str, source: Path, folder: Path) -> Any:
    def toml(value: Any) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{key} = {toml(each)}" for key, each in value.items()) + "}"
        return json.dumps(value)

    files = {"clips": source.name, "model": str(LAMP)} if kind == "validate" else {
        "captures": source.name, "character": str(LAMP), "keyposes": [str(POSES)],
    }  # fmt: skip
    lines = [f"{name} = {toml(value)}" for name, value in (files | OPTIONS[kind]).items()]
    table = "case" if kind == "validate" else "retarget"
    (folder / "s.toml").write_text("\n".join([f"[[{table}]]", *lines]))
    (job,) = plan(load_suite(folder / "s.toml")).jobs
    done = perform(job)
    assert done.status == "ok", done.message
    return done.document, done.artifacts.get("clip")


def in_the_service(kind: str, source: Path, folder: Path) -> Any:
    from physretarget.service import tasks
    from physretarget.service.options import read_options

    folder.mkdir()
    request = {
        "model": str(LAMP), "options": read_options(kind, json.dumps(OPTIONS[kind])),
        "clip_frames": 1000, "clip_name": source.name, "model_name": "lamp.xml",
        "keyposes": [str(POSES)], "clip": str(source), "capture": str(source),
    }  # fmt: skip
    getattr(tasks, kind)(request, folder, lambda share, stage: None)
    return json.loads((folder / "report.json").read_text())


@pytest.mark.parametrize("kind", OPTIONS)
def test_command_line_suite_and_service_say_the_same(
    kind: Any, sources: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.nice", lambda _: 0)
    source = sources[kind]
    given = OPTIONS[kind] | FILES[kind]
    done = run_job(kind, source, given)
    assert done.report is not None
    wanted = done.report.to_dict()
    suite, made = in_a_suite(kind, source, tmp_path)
    service = in_the_service(kind, source, tmp_path / "service")
    typed = by_hand(kind, source, tmp_path, monkeypatch)
    for part in ("settings", "measures", "findings", "coverage", "summary"):
        assert suite[part] == json.loads(json.dumps(wanted[part])), part
        assert service[part] == suite[part], part
        assert typed[part] == suite[part], part
    if kind == "retarget":
        clips = [(tmp_path / "out.npz").read_bytes(), made, done.clip.whole().to_bytes(),
                 (tmp_path / "service" / "clip.npz").read_bytes()]  # fmt: skip
        assert len({hashlib.sha256(each).hexdigest() for each in clips}) == 1


@pytest.mark.parametrize("kind", OPTIONS)
def test_every_option_given_there_changes_the_result(kind: Any, sources: dict[str, Path]) -> None:
    """Or else the test above would not notice one that is lost on the way."""
    # A file of no rate needs one; the mass cancels where momentum is scaled by it.
    needed = {"fps", "unit", "mass"}
    given = OPTIONS[kind] | FILES[kind]

    def result(options: dict[str, Any]) -> str:
        done = run_job(kind, sources[kind], options)
        assert done.report is not None
        told = done.report.to_dict()
        parts = [told[part] for part in ("settings", "measures", "findings", "coverage")]
        return json.dumps([parts, done.clip.whole().qpos.tolist()], default=str)

    whole = result(given)
    for name in OPTIONS[kind].keys() - needed:
        without = {key: value for key, value in given.items() if key != name}
        assert result(without) != whole, name
    if kind == "validate":
        assert result(given | {"unit": "m"}) != whole
        assert result(given | {"fps": 30.0}) != whole


def test_models_and_mappers_are_kept_until_their_files_change(tmp_path: Path) -> None:
    model = tmp_path / "lamp.xml"
    model.write_bytes(LAMP.read_bytes())
    given = {"character": model, "keyposes": (POSES,), "mapper": "nn3"}
    first, mapper = load_character(model), mapper_of(given)
    assert load_character(model) is first
    assert mapper_of(given) is mapper
    assert mapper_of(given | {"mapper": "nn10"}) is not mapper
    model.write_text(model.read_text() + "\n")
    assert load_character(model) is not first
    assert mapper_of(given) is not mapper


def test_jobs_that_make_no_sense(tmp_path: Path, sources: dict[str, Path]) -> None:
    given: dict[str, Any] = {"character": LAMP, "keyposes": (POSES,)}
    with pytest.raises(InputError, match="45 frames, at most 10"):
        run_job("retarget", sources["retarget"], given, most_frames=10)
    with pytest.raises(UsageError, match="keyposes FILE is needed"):
        mapper_of({"character": LAMP})
    mapper = tmp_path / "m.npz"
    mapper_of(given | {"mapper": "nn3"}).save(mapper)
    with pytest.raises(UsageError, match="keyposes is for learning"):
        mapper_of(given | {"mapper": str(mapper)})
    assert mapper_of({"character": LAMP, "mapper": str(mapper)}).names


def test_progress_begins_with_reading_and_ends_with_a_judgement(tmp_path: Path) -> None:
    lamp = Character.load(LAMP)
    qpos = lamp.reference_qpos[None].repeat(30, axis=0)
    Clip(qpos=qpos, time=np.arange(30) / 30, joint_names=lamp.joint_names).save(tmp_path / "c.npz")
    seen: list[tuple[str, float]] = []
    run_job("validate", tmp_path / "c.npz", {"model": LAMP},
            progress=lambda stage, share: seen.append((stage, share)))  # fmt: skip
    assert seen[0] == ("read", 0.0)
    assert seen[1] == ("judge", 0.0)
    assert seen[-1] == ("judge", 1.0)
    assert load_clip(tmp_path / "c.npz", character=lamp).frames == 30
