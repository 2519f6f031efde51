"""How ground forces are taken from captures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from physretarget.options.declaration import check, option


@dataclass(frozen=True, kw_only=True)
class ForcesOptions:
    """How a capture is filtered before its forces are taken.

    10 Hz come nearest to unfiltered plates in jumps, walks and squats (docs/captures.md).
    """

    lowpass_hz: float | None = option(
        10.0,
        name="lowpass",
        help="Cut-off of the low-pass filter on the capture; 0 turns it off.",
        unit="Hz",
        above=0,
        most=1000,
        zero_for_none=True,
        label="Low-pass",
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class ForcesOutput:
    """Where forces go."""

    out: Path = option(help="Table to write: .mot (OpenSim) or .csv.", metavar="FILE")
    report: Path | None = option(
        None, help="Also draw the forces over time into this picture.", metavar="FILE.png"
    )  # fmt: skip
