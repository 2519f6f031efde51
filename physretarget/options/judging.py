"""How clips are judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from physretarget.options.declaration import check, option

Profile = Literal["animation", "robot"]
Verdict = Literal["passed", "failed", "not judged"]
Severity = Literal["error", "warning"]
Require = Literal["dynamics", "contact", "torques"]
Format = Literal["text", "json", "sarif", "junit", "markdown", "html", "csv", "parquet"]


@dataclass(frozen=True, kw_only=True)
class JudgingOptions:
    """How any clip is judged, one that has just been made too."""

    profile: Profile = option(
        "animation",
        help=(
            "Set of thresholds. animation forgives what viewers do not see; robot "
            "also judges torques and the joint limits of a machine."
        ),
    )
    friction: float | None = option(
        None,
        help="Friction coefficient of the floor.",
        above=0,
        most=10,
        default_text="from the model",
        advanced=True,
    )
    contact_tolerance_m: float | None = option(
        None,
        name="contact_tolerance",
        help="Geometry this close to the floor counts as touching it.",
        unit="m",
        above=0,
        most=1,
        default_text="3 % of the CoM's height, 1 to 2 cm",
        advanced=True,
    )
    select: tuple[str, ...] = option(
        (),
        help="Apply only rules with these codes or beginnings of codes.",
        metavar="CODE,…",
        default_text="all",
        advanced=True,
        label="Only these findings",
    )
    ignore: tuple[str, ...] = option(
        (),
        help="Skip rules with these codes or beginnings of codes.",
        metavar="CODE,…",
        advanced=True,
        label="Ignore findings",
    )
    limits: Mapping[str, Mapping[str, float]] = option(
        {},
        name="thresholds",
        help="Override limits of rules.",
        metavar="CODE.NAME=NUMBER,…",
        advanced=True,
    )
    severity: Mapping[str, Severity] = option(
        {}, help="Override severities of rules.", metavar="CODE=error|warning,…", advanced=True
    )  # fmt: skip

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class ValidationOptions(JudgingOptions):
    """How a clip is judged that others have made."""

    lowpass_hz: float | None = option(
        None,
        name="lowpass",
        help=(
            "Cut-off of a low-pass filter before judging, for recorded or generated "
            "noise. 6 suits most clips; 0 turns it off."
        ),
        unit="Hz",
        above=0,
        most=1000,
        zero_for_none=True,
        default_text="none",
        label="Low-pass",
    )
    simulate: bool = option(
        False,
        help=(
            "Also play the clip forward in MuJoCo, without and with assist, for the "
            "SIM rules. Takes several seconds per second of motion."
        ),
    )
    stands: bool = option(
        False,
        help=(
            "The model is fixed to the world in the file but only stands on its "
            "floor: judge whether it tips over or slips."
        ),
    )
    also_literature: bool = option(
        False,
        name="also",
        word="literature",
        help="Also print the measures of other tools, for comparison.",
        advanced=True,
        label="Also report",
    )


@dataclass(frozen=True, kw_only=True)
class ConfigFile:
    """Rules and thresholds from a file."""

    config: Path | None = option(None, help="File of rules and thresholds.", metavar="FILE.toml")


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """What becomes of the reports on the command line."""

    baseline: Path | None = option(
        None,
        help="Findings that were accepted earlier and are not reported again.",
        metavar="FILE.json",
    )
    accept: Path | None = option(
        None,
        help="Write the findings into this file, to be used as --baseline.",
        metavar="FILE.json",
    )
    format: Format = option("text", help="Format of the report.")
    fail_on: Severity = option("error", help="Lowest severity that makes the exit code 1.")
    require: tuple[Require, ...] = option(
        (), help="What must be judged; the exit code is 1 if it could not be."
    )
    where: str | None = option(
        None,
        help=(
            "Report and copy only clips whose row in the table (--format csv) meets "
            'this condition, for example "unexplained_force_rms_bw < 0.3 and verdict '
            "== 'passed'\". The exit code still counts all clips."
        ),
        metavar="CONDITION",
        default_text="all",
    )
    copy_passed: Path | None = option(
        None, help="Copy the clips that pass into a folder.", metavar="FOLDER"
    )
    out: Path | None = option(
        None,
        help="File for the report, or for several clips a folder with one report each.",
        metavar="FILE|FOLDER",
        default_text="stdout",
    )
    jobs: int = option(1, help="Number of clips judged in parallel.", least=1, metavar="N")
