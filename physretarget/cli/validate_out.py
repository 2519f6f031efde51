"""Where validate's reports go: stdout, one file for all clips, or a folder with one for each."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import typer

from physretarget.cli.common import say
from physretarget.clip import write_file
from physretarget.errors import InputError, UsageError
from physretarget.files import beside
from physretarget.options.judging import Severity
from physretarget.report.formats import render
from physretarget.report.words import count
from physretarget.validation import Report

SUFFIXES: dict[str, tuple[str, ...]] = {
    "text": (".txt",),
    "json": (".json",),
    "sarif": (".sarif", ".json"),
    "junit": (".xml",),
    "markdown": (".md", ".markdown"),
    "html": (".html", ".htm"),
    "csv": (".csv",),
    "parquet": (".parquet",),
}
"""By format, what its files end in; the first is what files in a folder get."""
_TABLES = ("csv", "parquet")


@dataclass(frozen=True)
class Judged:
    """A clip's report; ``page`` is its HTML, which needs the poses, where that was asked for."""

    path: Path
    report: Report
    page: str | None = None


@dataclass(frozen=True, kw_only=True)
class Output:
    """How reports are written.

    ``several`` is what was asked for, not what was found: a folder with one clip in it counts,
    so that a script gets the same kind of document whatever the folder holds today.
    """

    format: str
    fail_on: Severity
    path: Path | None
    several: bool

    def check(self) -> None:
        """Raise UsageError where the reports will not fit: before the clips are judged."""
        if self.format == "parquet" and self.path is None:
            raise UsageError("a Parquet table is no text: --out must name its file.")
        if self.format in _TABLES and self._folder():
            raise UsageError(f"a table holds all clips: --out must name a file, not '{self.path}'.")
        if self.format == "html" and self.several and not self._folder():
            told = "" if self.path is None else f", not the file '{self.path}'"
            raise UsageError(
                f"an HTML report shows one clip: of several, --out must name a folder{told}."
            )

    def put(self, judged: Sequence[Judged], unread: Mapping[str, str]) -> None:
        """Write them all; ``unread`` are the clips that could not be judged, and why."""
        if self.path is None:
            text = self._all(judged, unread)
            typer.echo(text, nl=not text.endswith(b"\n"))
        elif self._folder():
            self._put_each(judged, self.path)
        else:
            write_file(self.path, self._all(judged, unread))
            say(f"{self.path}: {_verdict(judged)}")

    def _folder(self) -> bool:
        """Whether each clip gets a file: a folder that is there, or several and no file's name."""
        if self.path is None:
            return False
        named = any(self.path.suffix.lower() in known for known in SUFFIXES.values())
        return self.path.is_dir() or (self.several and not named)

    def _put_each(self, judged: Sequence[Judged], folder: Path) -> None:
        if folder.exists() and not folder.is_dir():
            raise InputError("is a file; reports of several clips need a folder.", path=folder)
        folder.mkdir(parents=True, exist_ok=True)
        stems = [one.path.stem for one in judged]
        for one in judged:
            # walk.csv and walk.npz must not share a page.
            name = one.path.stem if stems.count(one.path.stem) == 1 else one.path.name
            target = folder / f"{name}{SUFFIXES[self.format][0]}"
            write_file(target, self._one(one))
            say(f"{target}: {_verdict([one])}")

    def _one(self, one: Judged) -> bytes:
        if one.page is not None:
            return one.page.encode()
        return render(one.report, self.format, fail_on=self.fail_on)

    def _all(self, judged: Sequence[Judged], unread: Mapping[str, str]) -> bytes:
        if not self.several and len(judged) == 1:
            return self._one(judged[0])
        return render(
            [one.report for one in judged], self.format, fail_on=self.fail_on, unread=unread
        )


def _verdict(judged: Sequence[Judged]) -> str:
    reports = [one.report for one in judged]
    told: str = reports[0].verdict if reports else "passed"
    if len(reports) > 1:
        failed = sum(report.verdict == "failed" for report in reports)
        unjudged = sum(report.verdict == "not judged" for report in reports)
        told = f"{count(len(reports), 'clip')}, {failed or 'none'} failed"
        told += f", {unjudged} not judged" if unjudged else ""
    return (
        f"{told}, {count(sum(r.errors for r in reports), 'error')}, "
        f"{count(sum(r.warnings for r in reports), 'warning')}."
    )


def check_copies(paths: Sequence[Path], folder: Path) -> None:
    """Raise where copies of these clips would replace each other, or the clips themselves."""
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file; clips are copied into a folder.", path=folder)
    seen: dict[str, Path] = {}
    for path in paths:
        if path.parent.resolve() == folder.resolve():
            raise UsageError(f"--copy-passed '{folder}' is the folder of '{path.name}' itself.")
        if path.name in seen:
            raise UsageError(
                f"--copy-passed would put '{seen[path.name]}' and '{path}' into one file: judge "
                "their folders one at a time, with a folder for each."
            )
        seen[path.name] = path


def copy_clips(paths: Sequence[Path], folder: Path) -> None:
    """Copy files into a folder, each whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in paths:
        with beside(folder / path.name) as target:
            shutil.copyfile(path, target)
