"""Plant faults of growing size into clean clips; tell the smallest that is found.

    python -m benchmarks.planted_faults [--only "root noise" "up axis y" …] [--out PAGE.md]

A fault is found when a finding names it that the clean clip does not have: first as a warning,
then as an error. Then break whole clips and tell whether the cause is named. Without the robot
data the clips of the G1 are left out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.planted_faults import broken
from benchmarks.planted_faults.faults import FAULTS, Fault, Planted
from physretarget.clip import Clip
from physretarget.validation import Report, Settings, validate

WAYS = ((30, None), (60, None), (120, None), (30, 6.0), (60, 6.0), (120, 6.0))
"""Frames per second and low-pass (Hz)."""


@dataclass(frozen=True)
class Found:
    """The smallest sizes that are named by a warning or worse and by an error; None: not found.

    ``by`` are the codes that name it at the smallest such size; ``clean`` are codes of errors
    about the clip without the fault.
    """

    warned: float | None
    erred: float | None
    by: tuple[str, ...]
    clean: tuple[str, ...]


def report_of(planted: Planted, clip: Clip, lowpass: float | None) -> Report:
    settings = Settings(profile=planted.profile, lowpass_hz=lowpass)
    return validate(clip, planted.character, settings=settings)


def smallest(fault: Fault, planted: Planted, fps: float, lowpass: float | None) -> Found:
    """Go from mild to bad until an error names the fault."""
    clean = report_of(planted, planted.clean(fps), lowpass)
    had = {(f.code, f.severity) for f in clean.findings}
    errors = tuple(sorted({code for code, severity in had if severity == "error"}))
    warned: float | None = None
    by: tuple[str, ...] = ()
    for size in fault.sizes:
        clip = planted.clip(fps, size)
        if clip is None:
            break
        report = report_of(planted, clip, lowpass)
        named = {
            (f.code, f.severity) for f in report.findings if f.code.startswith(fault.codes)
        } - had
        if named and warned is None:
            warned, by = size, tuple(sorted({code for code, _ in named}))
        if any(severity == "error" for _, severity in named):
            return Found(warned, size, by, errors)
    return Found(warned, None, by, errors)


def cell(found: Found) -> str:
    """ "2 / 5": a warning from 2, an error from 5."""

    def told(size: float | None) -> str:
        return "–" if size is None else f"{size:g}"

    text = told(found.warned)
    return text if found.warned == found.erred else f"{text} / {told(found.erred)}"


def table(faults: Sequence[Fault]) -> list[str]:
    columns = [f"{fps}" + (f", {hz:g} Hz" if hz else "") for fps, hz in WAYS]
    lines = [
        "| fault | in | " + " | ".join(columns) + " | named by |",
        "|---" * (len(columns) + 3) + "|",
    ]
    for fault in faults:
        for planted in fault.planted():
            if sys.stderr.isatty():
                print(f"\r{fault.name}: {planted.base:30s}", end="", file=sys.stderr)
            found = [smallest(fault, planted, fps, hz) for fps, hz in WAYS]
            by = sorted({code for f in found for code in f.by})
            unclean = sorted({code for f in found for code in f.clean})
            note = f" (clean: {', '.join(unclean)})" if unclean else ""
            lines.append(
                f"| {fault.name}, {fault.unit} | {planted.base}{note} | "
                + " | ".join(map(cell, found))
                + f" | {', '.join(by) or '–'} |"
            )
    return lines


def page(faults: Sequence[Fault], mistakes: Sequence[str], command: str) -> str:
    return "\n".join(
        [
            "# The smallest planted fault that is found",
            "",
            f"Made by `{command}`. Each fault is planted, in growing sizes, into clean clips at "
            "30, 60 and 120 frames/s, judged as they are and with `--lowpass 6`. A cell gives the "
            "smallest size tried that a finding names which the clean clip does not have: one "
            "number where it is an error at once, `2 / 5` where it is a warning from 2 and an "
            "error from 5, – where no size tried is found. The sizes tried stand below.",
            "",
            *table(faults),
            "",
            "Sizes tried:",
            "",
            *(
                f"- {fault.name} ({fault.unit}): " + ", ".join(f"{s:g}" for s in fault.sizes)
                for fault in faults
            ),
            "",
            "# The cause of broken input",
            "",
            "Whole clips broken by one mistake each, at 30, 60 and 120 frames/s: whether the first "
            "cause that is named is the mistake, or what is named instead. Half of the clips are "
            "simulations of bodies and motions that no rule was made with; where a motion cannot "
            "tell (what does not walk has no steps), none is the best that can be had.",
            "",
            *broken.table(mistakes),
            "",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="*", default=[], help="names of faults")
    parser.add_argument("--out", type=Path, help="page to write")
    given = parser.parse_args()
    names = [f.name for f in FAULTS] + [f.name for f in broken.BROKEN]
    unknown = set(given.only) - set(names)
    if unknown:
        parser.error(f"no such fault: {', '.join(unknown)}; there are {names}")
    wanted = given.only or names
    faults = [f for f in FAULTS if f.name in wanted]
    mistakes = [b.name for b in broken.BROKEN if b.name in wanted]
    text = page(faults, mistakes, "python -m benchmarks.planted_faults")
    if given.out:
        given.out.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
