"""The main job on a real capture, with no arguments: what `physretarget demo` runs.

The captures are the DeepMimic motion files inside the ``pybullet`` wheel (zlib licence), which
is used for its data alone and never imported.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from physretarget.errors import InputError, MissingExtraError
from physretarget.job import mapper_of, run_job
from physretarget.pipeline import Progress, Retargeted
from physretarget.report.demo import Card, write_index
from physretarget.report.retarget import write_retarget_report
from physretarget.validation import Report

MOTIONS = {
    "jump": "humanoid3d_jump.txt",
    "dance": "humanoid3d_dance_a.txt",
}
STEPS = 1 + 10 * len(MOTIONS)
"""How often :func:`run` tells its progress."""

SENTENCES = {
    "jump": "Squash, a jump off both feet, and a soft landing.",
    "dance": "Turns on the spot, reaches up, dives low.",
}


@dataclass(frozen=True, kw_only=True)
class Shown:
    """One capture's way through the demo."""

    name: str
    page: Path
    result: Retargeted
    report: Report


def models_folder() -> Path:
    """Where the characters and their key poses are: in the wheel, or beside the package."""
    here = Path(__file__).resolve().parent
    for folder in (here / "models", here.parent / "models"):
        if (folder / "lamp.xml").is_file():
            return folder
    raise InputError("models/lamp.xml is missing: the installation is damaged.", path=here)


def motions_folder() -> Path:
    """Where the ``pybullet`` wheel keeps its captures."""
    found = importlib.util.find_spec("pybullet_data")
    folder = Path(found.origin).parent / "data" / "motions" if found and found.origin else None
    if folder is None or not folder.is_dir():
        raise MissingExtraError("pybullet", extra="demo", purpose="The demo's captures")
    return folder


def run(out: str | Path, *, progress: Progress) -> tuple[Path, tuple[Shown, ...]]:
    """Retarget, judge and show a jump and a dance; returns the index page and what was made."""
    out, motions = Path(out), motions_folder()
    out.mkdir(parents=True, exist_ok=True)
    models = models_folder()
    progress("learn the lamp from its key poses")
    given = {"character": models / "lamp.xml", "keyposes": (models / "lamp.keyposes.toml",)}
    mapper_of(given)
    shown = []
    for name, file in MOTIONS.items():
        done = run_job("retarget", motions / file, given, progress=_prefixed(progress, name))
        assert done.retargeted is not None
        assert done.mapper is not None
        assert done.report is not None
        progress(f"{name}: report")
        page = write_retarget_report(done.retargeted, done.mapper, done.report, out / name)
        shown.append(Shown(name=name, page=page, result=done.retargeted, report=done.report))
    return write_index([_card(each) for each in shown], out), tuple(shown)


def _prefixed(progress: Progress, name: str) -> Callable[[str, float], None]:
    return lambda stage, share: progress(f"{name}: {stage}") if share == 0 else None


def _card(shown: Shown) -> Card:
    result, physical = shown.result, shown.result.physical
    facts = [
        ("capture", result.motion.source.name),
        ("animation", f"{result.clip.duration:.2f} s, {result.clip.frames} frames"),
        ("computed in", f"{sum(result.seconds.values()):.2f} s"),
    ]
    if physical is not None:
        facts.append(
            (
                "vertical mismatch, by the root’s height",
                f"{physical.mismatch_before:.1f} → {physical.mismatch_after:.1f} N RMS",
            )
        )
    facts.append(
        ("the clip, judged", f"{shown.report.errors} errors, {shown.report.warnings} warnings")
    )
    return Card(
        title=shown.name.capitalize(),
        page=shown.page,
        sentence=SENTENCES[shown.name],
        facts=tuple(facts),
    )
