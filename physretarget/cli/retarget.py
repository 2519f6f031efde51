"""retarget and learn: captures to clips."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from physretarget import capture, contact
from physretarget.capture.actor import ActorMotion
from physretarget.cli import app
from physretarget.cli.common import Given, command, fail, progress, say, warn
from physretarget.errors import PhysretargetError, UsageError
from physretarget.keyposes import load_keyposes
from physretarget.mapping import NAMES
from physretarget.mjcf import Character
from physretarget.options import LEARN, RETARGET, build
from physretarget.options.judging import JudgingOptions
from physretarget.options.motion import CAPTURES, CaptureOptions
from physretarget.options.retargeting import MapperOptions, MapperSource
from physretarget.pipeline import STAGES, Retargeted, RetargetSettings, retarget
from physretarget.report.retarget import write_retarget_report
from physretarget.report.text import one_line
from physretarget.report.words import count
from physretarget.trained import TrainedMapper, check_mobile, learn
from physretarget.validation import RULES, Report, Settings, settings_of, validate

CAPTURE_ENDINGS = (".bvh", ".c3d", ".trc", ".amc", ".txt", ".json")


CapturesArgument = Annotated[
    list[Path], typer.Argument(metavar="CAPTURE...", help=f"{CAPTURES} files.")
]


@command(
    app,
    "learn",
    LEARN,
    example="physretarget learn --character lamp.xml --keyposes lamp.keyposes.toml --out lamp.npz",
)
def learn_command(given: Given) -> None:
    """Learn a mapper from key poses, once for many captures.

    What it writes goes to retarget --mapper and stream --mapper.
    """
    out: Path = given["out"]
    _ends_in_npz(out)
    trained = _learn(_mobile(given["character"]), given)
    trained.save(out)
    say(f"{out}: {build(MapperOptions, given).mapper} learned from {len(trained.names)} key poses.")


def _learn(character: Character, given: Given) -> TrainedMapper:
    if not given.get("keyposes"):
        raise UsageError("--keyposes FILE is needed to learn a mapper.")
    settings = build(MapperOptions, given)
    poses = load_keyposes(given["keyposes"], character)
    most = max(len(poses.poses) - 1, 1)
    if "dims" in given and settings.dims > most:
        raise UsageError(
            f"--dims is {settings.dims}; {len(poses.poses)} key poses differ in at most {most} "
            f"dimensions, so {most} is the most."
        )
    return learn(character, poses, **asdict(settings))


@command(
    app,
    "retarget",
    RETARGET,
    example="physretarget retarget jump.bvh --character lamp.xml "
    "--keyposes lamp.keyposes.toml --out jump.npz --report jump-report",
)
def retarget_command(captures: CapturesArgument, given: Given) -> None:
    """Turn captures into clips of a character.

    Needs key poses (--keyposes), or what learn made of them (--mapper MAPPER.npz). The stages:
    mapped (poses), placed (the way over the floor), contacted (feet), physical (the root's
    height), balanced.
    """
    out: Path = given["out"]
    settings = build(RetargetSettings, given, seed=given.get("seed", 0))
    judging = settings_of(given, RULES, JudgingOptions)
    _no_folders(captures)
    targets = _targets(captures, out)
    contacts = given.get("contacts")
    trained = _mapper(_mobile(given["character"]), given)
    job = _Job(
        trained=trained,
        settings=settings,
        judging=judging,
        phases=contact.read_phases(contacts) if contacts else None,
        load=partial(
            capture.load, skeleton=given.get("skeleton"), **asdict(build(CaptureOptions, given))
        ),
    )
    if failed := _each(job, captures, targets, _folders(captures, targets, out, given)):
        raise typer.Exit(failed)


@dataclass(frozen=True, kw_only=True)
class _Job:
    """What all captures of one call share."""

    trained: TrainedMapper
    settings: RetargetSettings
    judging: Settings
    phases: contact.Phases | None
    load: Callable[[Path], ActorMotion]

    def run(
        self, path: Path, target: Path, folder: Path | None, step: Callable[[str], None]
    ) -> tuple[Retargeted, Report | None]:
        """Write the clip of one capture; judge it for a report where a folder is given."""
        step("read")
        result = retarget(
            self.load(path), self.trained, settings=self.settings, phases=self.phases, progress=step
        )
        result.clip.save(target)
        if folder is None:
            return result, None
        step("report")
        judged = validate(result.clip, self.trained.character, settings=self.judging)
        write_retarget_report(result, self.trained, judged, folder)
        return result, judged


def _each(job: _Job, captures: list[Path], targets: list[Path], folders: list[Path | None]) -> int:
    """Capture after capture; of several, those that cannot be used only set the exit code."""
    # Reading, preparing, mapping and posing come before the first stage that can be the last.
    steps = 4 + STAGES.index(job.settings.until) + (folders[0] is not None)
    code = 0
    made: list[Path] = []
    for number, (path, target, folder) in enumerate(
        zip(captures, targets, folders, strict=True), start=1
    ):
        which = f"{number}/{len(captures)} " if len(captures) > 1 else ""
        try:
            with progress(which + path.name, steps=steps) as step:
                result, judged = job.run(path, target, folder, step)
        except PhysretargetError as error:
            if len(captures) == 1:
                raise
            fail(error)
            code = error.exit_code
            continue
        _tell(result, target)
        if judged and folder:
            say(f"{target}: {one_line(judged)}")
            say(f"{folder / 'report.html'}: the report, with a replay.")
        made.append(target)
    if made and folders[0] is None:
        say(_how_to_judge(made, job.trained.character))
    return code


def _how_to_judge(clips: list[Path], character: Character) -> str:
    """The command that gives the verdict on clips that nobody has judged."""
    words = ["physretarget", "validate", *map(str, clips), "--model", str(character.path)]
    return f"{'Are they' if len(clips) > 1 else 'Is it'} plausible? {shlex.join(words)}"


def _mobile(character: Path) -> Character:
    """The character, refused before anything else is read if it cannot move about."""
    model = Character.load(character)
    check_mobile(model)
    return model


def _no_folders(captures: list[Path]) -> None:
    """A folder is refused with what to write in its stead: the captures that are in it."""
    for folder in filter(Path.is_dir, captures):
        endings = Counter(path.suffix for path in folder.iterdir())
        found = [end for end in endings if end.lower() in CAPTURE_ENDINGS]
        if not found:
            known = ", ".join(CAPTURE_ENDINGS)
            raise UsageError(f"{folder} is a folder without captures ({known}): name the files.")
        ending = min(found, key=lambda end: CAPTURE_ENDINGS.index(end.lower()))
        raise UsageError(
            f"{folder} is a folder: name the captures in it, as in {folder / f'*{ending}'} "
            f"({count(endings[ending], 'file')}), with a folder as --out."
        )


def _ends_in_npz(out: Path) -> None:
    if out.suffix.lower() != ".npz":
        raise UsageError(f"--out is {str(out)!r}; it must end in .npz.")


def _targets(captures: list[Path], out: Path) -> list[Path]:
    """Where each capture's clip goes: the file told, or one in the folder told."""
    if len(captures) == 1 and not out.is_dir():
        if out.suffix.lower() != ".npz":
            raise UsageError(
                f"--out is {str(out)!r}; it must end in .npz or be a folder that is there."
            )
        return [out]
    if out.suffix.lower() == ".npz" and not out.is_dir():
        raise UsageError(f"--out is {str(out)!r}; several captures need a folder.")
    targets = [out / f"{path.stem}.npz" for path in captures]
    for path, target in zip(captures, targets, strict=True):
        if targets.count(target) > 1:
            raise UsageError(
                f"{path.name} shares its name with another capture: "
                f"both clips would be {target}, so give them folders of their own."
            )
    return targets


def _folders(
    captures: list[Path], targets: list[Path], out: Path, given: Given
) -> list[Path | None]:
    """Where each capture's report goes: the folder told, or one in it where clips get one too."""
    report: Path | None = given.get("report")
    return [
        report / path.stem if report and target != out else report
        for path, target in zip(captures, targets, strict=True)
    ]


def _mapper(model: Character, given: Given) -> TrainedMapper:
    """Read where a file is told, learned where a name is."""
    mapper = build(MapperSource, given).mapper
    if mapper in NAMES:
        return _learn(model, given)
    trained = TrainedMapper.load(mapper, model)
    for name in ("keyposes", "dims"):
        if name in given:
            raise UsageError(f"--{name} is for learning, but {mapper} has been learned already.")
    return trained


def _tell(result: Retargeted, target: Path) -> None:
    for note in result.notes:
        if note in result.motion.doubts:
            warn(note)
        else:
            say(f"  {'warning' if note in result.warnings else 'note'}: {note}")
    clip = result.clip
    say(
        f"{target}: {len(clip.time)} frames, {clip.time[-1]:.2f} s, "
        f"made in {sum(result.seconds.values()):.2f} s."
    )
