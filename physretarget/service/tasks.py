"""What runs in a job's child process: the only code of the service that opens what was sent.

Called by name (:data:`physretarget.sandbox.child.TASKS`); takes plain data, writes files into
its folder, gives plain data back. Nothing here may be trusted by the server once it has run.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from physretarget import capture
from physretarget.clip import Clip, load_clip
from physretarget.clip.load import CLIP_SUFFIXES
from physretarget.errors import InputError
from physretarget.job import Done, Kind, run_job
from physretarget.mjcf import Character
from physretarget.options import JOBS, read
from physretarget.replay.clip import clip_scene
from physretarget.replay.web import render
from physretarget.report.html import render_html
from physretarget.report.json import render_json
from physretarget.report.junit import render_junit
from physretarget.report.markdown import render_markdown
from physretarget.report.retarget import retarget_data
from physretarget.report.retarget_html import render_retarget_html
from physretarget.report.sarif import render_sarif
from physretarget.report.text import cause_line, render_text
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.mjcf import check_model as check_files
from physretarget.service.layout import lay_out
from physretarget.suite.work import artifacts
from physretarget.validation import Report, judge_model

Progress = Callable[[float, str], None]
# What a job's time is spent on, roughly, by its stages.
_SHARES: Mapping[Kind, Mapping[str, float]] = {
    "validate": {"read": 0.05, "judge": 0.2},
    "retarget": {
        "read": 0.02, "prepare": 0.30, "map": 0.35, "pose": 0.40, "place": 0.50, "contact": 0.55,
        "physics": 0.60, "balance": 0.65, "judge": 0.8,
    },
}  # fmt: skip
_NICE = 10  # the server answers first
_ANY_FPS = 30.0  # for a look at a clip that states none; whoever judges it has to know
_FINDINGS = 200  # about a model that are kept


def validate(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Judge ``clip`` with ``model`` (paths) under ``options``; reports go into the folder."""
    given = _given("validate", request) | {"model": Path(request["model"])}
    done = _run("validate", request["clip"], given, request, progress)
    return _write(done, request, folder, progress)


def retarget(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Turn ``capture`` into a clip of ``model`` and judge it; clip and reports go into the folder.

    ``keyposes`` are paths, ``skeleton`` the path of an AMC capture's ASF file or None.
    """
    given = _given("retarget", request) | {
        "character": Path(request["model"]),
        "keyposes": tuple(map(Path, request["keyposes"])),
        "skeleton": request.get("skeleton"),
    }
    done = _run("retarget", request["capture"], given, request, progress)
    (folder / "clip.npz").write_bytes(done.clip.whole().to_bytes())
    return _write(done, request, folder, progress)


def _given(kind: Kind, request: Mapping[str, Any]) -> dict[str, Any]:
    return read(request["options"], JOBS[kind].api)


def _run(
    kind: Kind,
    source: str,
    given: Mapping[str, Any],
    request: Mapping[str, Any],
    progress: Progress,
) -> Done:
    os.nice(_NICE)
    return run_job(
        kind,
        Path(source),
        given,
        most_frames=request["clip_frames"],
        progress=lambda stage, share: progress(_SHARES[kind].get(stage, 0.6), stage),
    )


def check_model(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Unpack ``upload``, refuse what is unsafe, compile and audit what is left.

    ``upload`` is the path of an XML file or a zip, ``name`` what its client called it, ``main``
    the MJCF file inside a zip ("" to find it). The model's files go to ``model/`` in the folder.
    """
    os.nice(_NICE)
    limits = Limits.from_dict(request["limits"])
    progress(0.05, "unpack")
    root = folder / "model"
    main = lay_out(Path(request["upload"]), request["name"], request["main"], root, limits)
    progress(0.2, "check")
    check_files(root, root / main, limits)
    progress(0.4, "compile")
    character = Character.load(root / main)
    progress(0.7, "audit")
    return {
        "main": main,
        "name": character.name,
        "sha256": character.sha256,
        "mass_kg": float(character.mass),
        "bodies": int(character.model.nbody) - 1,
        "joints": len(character.joint_names),
        "findings": _model_findings(character),
    }


def check_clip(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Read ``path``, a clip or a capture, as far as that goes without a model.

    ``fps`` and ``quat`` are what its client tells, or None; ``skeleton`` the path of an AMC
    capture's ASF file, or None.

    Raises:
        InputError: it is neither.
        UnsafeInputError: it tries to run code or claims absurd sizes.
    """
    os.nice(_NICE)
    progress(0.1, "read")
    path = Path(request["path"])
    if path.suffix.lower() in CLIP_SUFFIXES:
        _check_frames(_look(path, request["fps"], request["quat"]).frames, request)
    elif path.suffix.lower() != ".amc" or request["skeleton"]:
        recording = capture.read(path, skeleton=request["skeleton"])
        _check_frames(len(recording.time), request)
    return {}


def _look(path: Path, fps: float | None, quat: str | None) -> Clip:
    """A clip, at any rate where its file states none and nobody has told one yet."""
    try:
        return load_clip(path, fps=fps, quat=quat)
    except InputError as error:
        if fps is not None or "states no frame rate" not in error.message:
            raise
    return load_clip(path, fps=_ANY_FPS, quat=quat)


def _model_findings(character: Character) -> list[dict[str, Any]]:
    return [
        {"code": f.code, "severity": f.severity, "message": f.message, "body": f.body}
        for f in judge_model(character)[:_FINDINGS]
    ]


def _check_frames(frames: int, request: Mapping[str, Any]) -> None:
    most = request["clip_frames"]
    if frames > most:
        raise InputError(f"has {frames} frames, at most {most} are accepted.")


def _named(report: Report, request: Mapping[str, Any]) -> Report:
    """The report with names as the client gave them: where the server keeps files is not told."""
    return replace(
        report,
        clip=replace(report.clip, path=request["clip_name"]),
        model=replace(report.model, path=request["model_name"]),
    )


def _write(
    done: Done, request: Mapping[str, Any], folder: Path, progress: Progress
) -> dict[str, Any]:
    assert done.report is not None
    report, clip, character = _named(done.report, request), done.clip.whole(), done.character
    page = None
    if done.retargeted is not None and done.mapper is not None:
        page = render_retarget_html(retarget_data(done.retargeted, done.mapper, report))
    progress(0.85, "report")
    title = request["clip_name"]
    texts = {
        "report.json": render_json(report),
        "report.sarif": render_sarif(report),
        "report.junit.xml": render_junit(report),
        "report.md": render_markdown(report),
        "report.txt": render_text(report),
        "report.html": page or render_html(report, clip, character, title=title),
        "replay.html": render(clip_scene(clip, character, report, title=title)),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for kind, content in artifacts(clip, character, report).items():
        # "motion", and "model/<sha256>" of the shapes.
        (folder / f"{kind.partition('/')[0]}.z").write_bytes(content)
    return {
        "summary": {
            "errors": report.errors, "warnings": report.warnings, "passed": report.passed,
            "verdict": report.verdict, "reason": report.not_judged or "",
            "cause": cause_line(report) if report.causes else "",
        },
    }  # fmt: skip
