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
        help="Thresholds: animation forgives what viewers do not see; robot also "
        "judges torques and joint limits as a machine's.",
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
        help="What is this close to the floor touches it.",
        unit="m",
        above=0,
        most=1,
        default_text="3 % of the CoM's height, 1 to 2 cm",
        advanced=True,
    )
    select: tuple[str, ...] = option(
        (),
        help="Codes of rules, or their beginnings, to apply and no others.",
        metavar="CODE,…",
        default_text="all",
        advanced=True,
        label="Only these findings",
    )
    ignore: tuple[str, ...] = option(
        (),
        help="Codes of rules, or their beginnings, to leave out.",
        metavar="CODE,…",
        advanced=True,
        label="Ignore findings",
    )
    limits: Mapping[str, Mapping[str, float]] = option(
        {},
        name="thresholds",
        help="Limits of rules.",
        metavar="CODE.NAME=NUMBER,…",
        advanced=True,
    )
    severity: Mapping[str, Severity] = option(
        {}, help="Severities of rules.", metavar="CODE=error|warning,…", advanced=True
    )  # fmt: skip

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class ValidationOptions(JudgingOptions):
    """How a clip is judged that others have made."""

    lowpass_hz: float | None = option(
        None,
        name="lowpass",
        help="Low-pass the clip before judging, for recorded or generated "
        "noise; 6 suits most, 0 is none.",
        unit="Hz",
        above=0,
        most=1000,
        zero_for_none=True,
        default_text="none",
        label="Low-pass",
    )
    simulate: bool = option(
        False,
        help="Also play the clip forward in MuJoCo, without and with assist: rules and measures "
        "SIM. Takes seconds per second.",
    )
    stands: bool = option(
        False,
        help="A model that is fixed to the world only stands on its floor: judge whether it tips "
        "over or slips.",
    )
    also_literature: bool = option(
        False, name="also", word="literature", help="Other tools' numbers too.", advanced=True,
        label="Also report",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ConfigFile:
    """Rules and thresholds from a file."""

    config: Path | None = option(None, help="Rules and thresholds.", metavar="FILE.toml")


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """What becomes of the reports on the command line."""

    baseline: Path | None = option(None, help="Findings accepted earlier.", metavar="FILE.json")
    accept: Path | None = option(None, help="Write findings as a baseline.", metavar="FILE.json")
    format: Format = option("text", help="Of the report.")
    fail_on: Severity = option("error", help="What makes the exit code 1.")
    require: tuple[Require, ...] = option(
        (), help="What must have been judged: the exit code is 1 where it could not be."
    )
    where: str | None = option(
        None,
        help="Report and copy only clips whose row in the table (--format csv) meets this, as in "
        "\"unexplained_force_rms_bw < 0.3 and verdict == 'passed'\". The exit code is that of all.",
        metavar="CONDITION",
        default_text="all",
    )
    copy_passed: Path | None = option(
        None, help="Copy the clips that pass into a folder.", metavar="FOLDER"
    )
    out: Path | None = option(
        None,
        help="Of several clips: a file for all (all.json), or a folder with a report of each.",
        metavar="FILE|FOLDER",
        default_text="stdout",
    )
    jobs: int = option(1, help="Clips judged at a time.", least=1, metavar="N")  # fmt: skip
