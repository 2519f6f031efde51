"""retarget and learn: captures to clips."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from physretarget.capture import READERS
from physretarget.cli import app
from physretarget.cli.common import Given, command, fail, progress, say, warn
from physretarget.errors import PhysretargetError, UsageError
from physretarget.job import Done, mapper_of, run_job
from physretarget.options import LEARN, RETARGET, build
from physretarget.options.judging import JudgingOptions
from physretarget.options.motion import CAPTURES
from physretarget.options.retargeting import STAGES, MapperOptions, RetargetSettings, with_preset
from physretarget.pipeline import Retargeted
from physretarget.report.retarget import write_retarget_report
from physretarget.report.text import one_line
from physretarget.report.words import count
from physretarget.validation import RULES, settings_of

CAPTURE_ENDINGS = tuple(dict.fromkeys(end for reader in READERS for end in reader.endings))


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

    Use the file with `retarget --mapper` and `stream --mapper`.
    """
    out: Path = given["out"]
    _ends_in_npz(out)
    trained = mapper_of(given)
    trained.save(out)
    say(f"{out}: {build(MapperOptions, given).mapper} learned from {len(trained.names)} key poses.")


@command(
    app,
    "retarget",
    RETARGET,
    example="physretarget retarget jump.bvh --character lamp.xml "
    "--keyposes lamp.keyposes.toml --out jump.npz --report jump-report",
)
def retarget_command(captures: CapturesArgument, given: Given) -> None:
    """Turn captures into clips of a character.

    Needs key poses (--keyposes) or a learned mapper (--mapper MAPPER.npz). The stages are mapped
    (poses), placed (the path over the floor), contacted (feet), physical (the root's height) and
    balanced (the whole body). With --until simulated MuJoCo plays the clip, and the proof is
    written beside it as NAME.sim.npz (docs/validate.md).
    """
    out: Path = given["out"]
    _no_folders(captures)
    targets = _targets(captures, out)
    mapper_of(given)  # broken key poses are one error, not one for every capture
    settings_of(given, RULES, JudgingOptions)
    if failed := _each(captures, targets, _folders(captures, targets, out, given), given):
        raise typer.Exit(failed)


def _each(
    captures: list[Path], targets: list[Path], folders: list[Path | None], given: Given
) -> int:
    """Capture after capture; of several, those that cannot be used only set the exit code."""
    # Reading, preparing, mapping and posing come before the first stage that can be the last.
    until = STAGES.index(build(RetargetSettings, with_preset(given)).until)
    steps = 4 + until + 2 * (folders[0] is not None)
    code = 0
    made: list[Path] = []
    for number, (path, target, folder) in enumerate(
        zip(captures, targets, folders, strict=True), start=1
    ):
        which = f"{number}/{len(captures)} " if len(captures) > 1 else ""
        try:
            with progress(which + path.name, steps=steps) as step:
                done = _run(path, target, folder, given, step)
        except PhysretargetError as error:
            if len(captures) == 1:
                raise
            fail(error)
            code = error.exit_code
            continue
        assert done.retargeted is not None
        _tell(done.retargeted, target)
        if done.report and folder:
            say(f"{target}: {one_line(done.report)}")
            say(f"{folder / 'report.html'}: the report, with a replay.")
        made.append(target)
    if made and folders[0] is None:
        say(_how_to_judge(made, given["character"]))
    return code


def _run(
    path: Path, target: Path, folder: Path | None, given: Given, step: Callable[[str], None]
) -> Done:
    """Write the clip of one capture; judge it for a report where a folder is given."""

    def begin(stage: str, share: float) -> None:
        if share == 0:
            step(stage)

    done = run_job(
        "retarget", path, RETARGET.of_job(given), judge=folder is not None, progress=begin
    )
    done.clip.whole().save(target)
    if done.retargeted is not None and done.retargeted.simulated is not None:
        done.retargeted.simulated.save(target.with_suffix(".sim.npz"))
    if folder is not None:
        assert done.retargeted is not None
        assert done.mapper is not None
        assert done.report is not None
        step("report")
        write_retarget_report(done.retargeted, done.mapper, done.report, folder)
    return done


def _how_to_judge(clips: list[Path], character: Path) -> str:
    """The command that gives the verdict on clips that nobody has judged."""
    words = ["physretarget", "validate", *map(str, clips), "--model", str(character)]
    return f"{'Are they' if len(clips) > 1 else 'Is it'} plausible? {shlex.join(words)}"


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
