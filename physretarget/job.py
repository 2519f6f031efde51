"""One job: a clip is judged, or a capture becomes a clip that is judged.

The same for everyone who asks, command line, service, suite and demo: what a job depends on are its
source and its options by name, as :mod:`physretarget.options` reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from physretarget import capture, contact
from physretarget.clip import Motion, open_clip
from physretarget.errors import InputError, UsageError
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.options import JOBS, build, read
from physretarget.options.judging import JudgingOptions, ValidationOptions
from physretarget.options.motion import CaptureOptions, ClipOptions
from physretarget.options.retargeting import (
    MAPPERS,
    MapperOptions,
    MapperSource,
    with_preset,
)
from physretarget.options.simulation import SimulationOptions
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.simulate import settings_of as simulation_settings
from physretarget.trained import TrainedMapper, check_mobile, learn
from physretarget.validation import RULES, Report, Settings, settings_of, validate

Kind = Literal["validate", "retarget"]
Given = Mapping[str, Any]
Progress = Callable[[str, float], None]
"""Takes the stage that runs and the share of it that is done: 0 when it begins."""


JUDGED_BY: Mapping[Kind, type[JudgingOptions]] = {
    "validate": ValidationOptions,
    "retarget": JudgingOptions,
}
"""Which options of a job are about judging: a capture's low-pass is not."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Done:
    """What a job gave; ``retargeted`` and ``mapper`` of a retargeting, ``report`` if judged."""

    clip: Motion
    character: Character
    report: Report | None
    retargeted: Retargeted | None = None
    mapper: TrainedMapper | None = None


def run_job(
    kind: Kind,
    source: Path,
    given: Given,
    *,
    judge: bool = True,
    most_frames: int | None = None,
    stamp: str = "",
    progress: Progress = lambda stage, share: None,
) -> Done:
    """Do a job.

    Args:
        kind: ``validate`` or ``retarget``.
        source: the clip, or the capture.
        given: options by name, those of suite files; ``model`` or ``character`` is among them.
        judge: whether a retargeted clip is judged too.
        most_frames: longer clips and captures are refused.
        stamp: changes when the model or the key poses do, which are kept between jobs; their
            files' times and sizes if empty.
        progress: is told of every stage.

    Raises:
        PhysretargetError: something cannot be used, or makes no sense.
    """
    progress("read", 0.0)
    given = read(given, JOBS[kind].suite)
    if kind == "validate":
        character = load_character(given["model"], stamp)
        settings = settings_of(given, RULES, JUDGED_BY[kind])
        clip = open_clip(source, character=character, **asdict(build(ClipOptions, given)))
        _check_frames(clip.frames, most_frames)
        return Done(
            clip=clip, character=character, report=_judged(clip, character, settings, progress)
        )
    mapper = mapper_of(given, stamp)
    settings = settings_of(given, RULES, JUDGED_BY[kind])
    phases = contact.read_phases(given["contacts"]) if "contacts" in given else None
    motion = capture.load(
        source,
        skeleton=given.get("skeleton"),
        map=given.get("map"),
        **asdict(build(CaptureOptions, given)),
    )
    _check_frames(len(motion.time), most_frames)
    made = retarget(
        motion,
        mapper,
        settings=build(RetargetSettings, with_preset(given), seed=given.get("seed", 0)),
        phases=phases,
        simulation=simulation_settings(build(SimulationOptions, given)),
        progress=lambda stage: progress(stage, 0.0),
    )
    report = _judged(made.clip, mapper.character, settings, progress) if judge else None
    return Done(
        clip=made.clip, character=mapper.character, report=report, retargeted=made, mapper=mapper
    )


def _judged(clip: Motion, character: Character, settings: Settings, progress: Progress) -> Report:
    progress("judge", 0.0)
    return validate(
        clip,
        character,
        settings=settings,
        progress=lambda done, frames: progress("judge", done / frames),
    )


def _check_frames(frames: int, most: int | None) -> None:
    if most is not None and frames > most:
        raise InputError(f"has {frames} frames, at most {most} are accepted.")


def load_character(path: Path, stamp: str = "") -> Character:
    """A character; the last few are kept, since jobs come in groups with one model."""
    return _character(path, stamp or _stamp(path))


# The stamp is in the key because a file may change between two jobs of one long-lived process.
@lru_cache(maxsize=4)
def _character(path: Path, stamp: str) -> Character:
    return Character.load(path)


def _stamp(*paths: Path) -> str:
    """What changes when files do; whoever reads one that is not there says so."""
    found = [path.stat() for path in paths if path.exists()]
    return str([(each.st_mtime_ns, each.st_size) for each in found])


def mapper_of(given: Given, stamp: str = "") -> TrainedMapper:
    """The mapper of a retargeting, read where a file is named, learned where a name is.

    Raises:
        UsageError: no key poses to learn from, or some where nothing is learned; too many
            dimensions.
    """
    mapper, keyposes = build(MapperSource, given).mapper, given.get("keyposes", ())
    # Refused before anything else is read if it cannot move about.
    check_mobile(load_character(given["character"], stamp))
    if mapper not in MAPPERS:
        trained = TrainedMapper.load(mapper, load_character(given["character"], stamp))
        for name in ("keyposes", "dims"):
            if name in given:
                raise UsageError(f"{name} is for learning, but {mapper} has been learned already.")
        return trained
    if not keyposes:
        raise UsageError("keyposes FILE is needed to learn a mapper.")
    files = (given["character"], *keyposes)
    return _learned(files, build(MapperOptions, given), "dims" in given, stamp or _stamp(*files))


@lru_cache(maxsize=4)
def _learned(
    files: tuple[Path, ...], settings: MapperOptions, told: bool, stamp: str
) -> TrainedMapper:
    model = Character.load(files[0])
    poses = load_keyposes(files[1:], model)
    most = max(len(poses.poses) - 1, 1)
    if told and settings.dims > most:
        raise UsageError(
            f"dims is {settings.dims}; {len(poses.poses)} key poses differ in at most {most} "
            f"dimensions, so {most} is the most."
        )
    return learn(model, poses, **asdict(settings))
