"""Doing one job: read or retarget, judge, and keep what history and report need.

What comes back is everything: nobody opens the clip again.
"""

from __future__ import annotations

import hashlib
import json
import time as clock
import zlib
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from physretarget import capture
from physretarget.clip import Clip, load_clip
from physretarget.errors import InputError, PhysretargetError
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.pipeline import RetargetSettings, retarget
from physretarget.replay.clip import clip_scene
from physretarget.replay.payload import pack, payload
from physretarget.replay.scene import Forces
from physretarget.suite.file import Case, RetargetCase, Suite
from physretarget.suite.job import Job, Outcome
from physretarget.trained import TrainedMapper, learn
from physretarget.validation import RULES, Report, Settings, load_settings, validate


def perform(job: Job, root: str | None = None) -> Outcome:
    """Do a job; whatever goes wrong with this one clip comes back as an errored outcome.

    Args:
        job: what to do.
        root: folder under which the inputs lie; the job's own if None.
    """
    started = clock.perf_counter()
    base = Path(root or job.root)
    try:
        clip, character, made = _motion(job, base)
        report = validate(clip, character, settings=_settings(job, base))
        made_files = artifacts(clip, character, report)
        if made:
            made_files["clip"] = clip.to_bytes()
        document = report.to_dict()
    except PhysretargetError as error:
        return _errored(job, _told(error, base / job.inputs["clip"]), started)
    except MemoryError:
        return _errored(job, "not enough memory to judge it.", started, transient=True)
    except Exception as error:
        # The suite goes on: one clip that meets a bug must not take the night with it.
        return _errored(job, f"bug: {type(error).__name__}: {error}", started)
    # A result is found by content: where the files lay when it was made says nothing.
    document["clip"]["path"] = Path(job.inputs["clip"]).name
    document["model"]["path"] = Path(job.inputs["model"]).name
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


def _motion(job: Job, base: Path) -> tuple[Clip, Character, bool]:
    model = str(base / job.inputs["model"])
    options = job.options
    if job.kind == "clip":
        character = _character(model, job.files[job.inputs["model"]])
        clip = load_clip(
            base / job.inputs["clip"],
            character=character,
            fps=options.get("fps"),
            quat=options.get("quat"),
        )
        return clip, character, False
    poses = tuple(str(base / v) for k, v in sorted(job.inputs.items()) if k.startswith("keyposes"))
    hashes = tuple(job.files[v] for k, v in sorted(job.inputs.items()) if k.startswith("keyposes"))
    trained = _trained(
        model, job.files[job.inputs["model"]], poses, hashes,
        options["mapper"], options["dims"], options["seed"],
    )  # fmt: skip
    skeleton = job.inputs.get("skeleton")
    motion = capture.load(
        base / job.inputs["clip"],
        unit=options.get("unit"),
        up=options.get("up"),
        skeleton=base / skeleton if skeleton else None,
    )
    settings = RetargetSettings(
        physics=options["physics"], heading=options["heading"], fps=options.get("fps"),
        seed=options["seed"],
    )  # fmt: skip
    return retarget(motion, trained, settings=settings).clip, trained.character, True


# Clips come in groups with one model: a worker keeps the last few. The hash is in the key
# because a file may change between two runs of one long-lived worker.
@lru_cache(maxsize=4)
def _character(path: str, sha256: str) -> Character:
    return Character.load(path)


@lru_cache(maxsize=4)
def _trained(
    model: str, sha256: str, keyposes: tuple[str, ...], hashes: tuple[str, ...],
    mapper: str, dims: int, seed: int,
) -> TrainedMapper:  # fmt: skip
    character = _character(model, sha256)
    poses = load_keyposes([Path(p) for p in keyposes], character)
    return learn(character, poses, mapper=mapper, dims=dims, seed=seed)


def _settings(job: Job, base: Path) -> Settings:
    return judge_settings(
        base / job.inputs["config"] if "config" in job.inputs else None,
        job.options.get("profile"),
        job.options.get("lowpass"),
    )


def judge_settings(config: Path | None, profile: str | None, lowpass: float | None) -> Settings:
    """The config file's settings with the case's profile and low-pass over them."""
    settings = load_settings(config, RULES) if config else Settings()
    given: dict[str, Any] = {}
    if profile is not None:
        given["profile"] = profile
    if lowpass is not None:
        given["lowpass_hz"] = lowpass
    return replace(settings, **given)


def check_ready(suite: Suite, cases: set[str]) -> None:
    """Refuse a model or config that cannot be used, once and with its case, before any work.

    Raises:
        InputError: names the case and its line in the suite file.
    """
    every: list[Case | RetargetCase] = [*suite.cases, *suite.retargets]
    for case in every:
        if case.name not in cases:
            continue
        try:
            judge_settings(case.config, case.profile, None)
            Character.load(case.model if isinstance(case, Case) else case.character)
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
