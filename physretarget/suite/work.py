"""Doing one job: read or retarget, judge, and keep what history and report need.

What comes back is everything: nobody opens the clip again.
"""

from __future__ import annotations

import hashlib
import json
import time as clock
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from physretarget.clip import Clip
from physretarget.errors import InputError, PhysretargetError
from physretarget.job import JUDGED_BY, run_job
from physretarget.mjcf import Character
from physretarget.options import JOBS, read
from physretarget.replay.clip import clip_scene
from physretarget.replay.payload import pack, payload
from physretarget.replay.scene import Forces
from physretarget.suite.file import Suite
from physretarget.suite.job import Job, Outcome
from physretarget.validation import RULES, Report, settings_of


def perform(job: Job, root: str | None = None) -> Outcome:
    """Do a job; whatever goes wrong with this one clip comes back as an errored outcome.

    Args:
        job: what to do.
        root: folder under which the inputs lie; the job's own if None.
    """
    started = clock.perf_counter()
    base = Path(root or job.root)
    try:
        done = run_job(job.kind, base / job.inputs["clip"], given_of(job, base), stamp=_stamp(job))
        assert done.report is not None
        clip = done.clip.whole()
        made_files = artifacts(clip, done.character, done.report)
        if done.retargeted is not None:
            made_files["clip"] = clip.to_bytes()
        document = done.report.to_dict()
    except PhysretargetError as error:
        return _errored(job, _told(error, base / job.inputs["clip"]), started)
    except MemoryError:
        return _errored(job, "not enough memory to judge it.", started, transient=True)
    except Exception as error:
        # The suite goes on: one clip that meets a bug must not take the night with it.
        return _errored(job, f"bug: {type(error).__name__}: {error}", started)
    # A result is found by content: where the files lay when it was made says nothing.
    document["clip"]["path"] = Path(job.inputs["clip"]).name
    document["model"]["path"] = Path(_model_of(job)).name
    return Outcome(
        address=job.address,
        status="ok",
        message=document["summary"]["reason"],
        document=document,
        artifacts=made_files,
        seconds=clock.perf_counter() - started,
    )


def _told(error: PhysretargetError, clip: Path) -> str:
    """What went wrong; the clip itself is not named, its entry does that."""
    if isinstance(error, InputError) and error.path == str(clip):
        places = [f"line {error.line}"] if error.line is not None else []
        places += [f"frame {error.frame}"] if error.frame is not None else []
        return ": ".join([*places, error.message])
    return str(error).replace(f"{clip}: ", "")


def _errored(job: Job, message: str, started: float, *, transient: bool = False) -> Outcome:
    return Outcome(
        address=job.address,
        status="errored",
        message=message,
        seconds=clock.perf_counter() - started,
        transient=transient,
    )


def _model_of(job: Job) -> str:
    return job.inputs["model" if job.kind == "validate" else "character"]


def given_of(job: Job, base: Path) -> dict[str, Any]:
    """A job's options by name, its files under ``base``."""
    files: dict[str, Any] = {}
    for role, place in sorted(job.inputs.items()):
        if role.startswith("keyposes"):
            files["keyposes"] = (*files.get("keyposes", ()), base / place)
        elif role != "clip":
            files[role] = str(base / place) if role == "mapper" else base / place
    return read({**job.options, **files}, JOBS[job.kind].suite)


def _stamp(job: Job) -> str:
    """Of all files of a job but the clip: with them changes what may be kept of the last job."""
    clip = job.inputs["clip"]
    return json.dumps(sorted(sha for place, sha in job.files.items() if place != clip))


def check_ready(suite: Suite, cases: set[str]) -> None:
    """Refuse a model or config that cannot be used, once and with its case, before any work.

    Raises:
        InputError: names the case and its line in the suite file.
    """
    for case in suite.cases:
        if case.name not in cases:
            continue
        try:
            settings_of(case.given, RULES, JUDGED_BY[case.kind])
            Character.load(case.model)
        except PhysretargetError as error:
            raise InputError(
                f"case {case.name!r}: {error}", path=suite.path, line=case.line
            ) from error


# ---- what the report shows ---------------------------------------------------------------------


def artifacts(clip: Clip, character: Character, report: Report) -> dict[str, bytes]:
    """What a page needs to replay a judged clip: "motion" and "model/<sha256>", compressed.

    The scene, shapes apart from tracks: two thousand clips share a few models.
    """
    stage = clip_scene(clip, character, report)
    found = report.forces
    if found is not None and len(found.origin) == clip.frames:
        forces = Forces(found.origin.astype(np.float64), found.vector.astype(np.float64))
        drawn = replace(stage.figures[0], forces=forces)
        stage = replace(stage, figures=(drawn,))
    scene = payload(stage)
    figure = scene["figures"][0]
    looks = {
        "meshes": scene.pop("meshes"),
        **{key: figure.pop(key) for key in ("shapes", "lights", "tint", "repaint")},
    }
    look = _json(looks)
    digest = hashlib.sha256(look).hexdigest()
    motion = {
        "model": digest,
        "scene": scene,
        "series": {
            name: pack(values)
            for name, values in report.series.items()
            if values.shape == (clip.frames,)
        },
    }
    return {
        "motion": zlib.compress(_json(motion), 6),
        f"model/{digest}": zlib.compress(look, 6),
    }


def _json(content: object) -> bytes:
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
