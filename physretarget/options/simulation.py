"""How a clip is played forward."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from physretarget.options.declaration import check, option


@dataclass(frozen=True, kw_only=True)
class SimulationOptions:
    """How a clip is played forward by MuJoCo."""

    assist: bool = option(
        False,
        help="Let a wrench on the root help a simulation, as little as keeps it on track: faster, "
        "not exact.",
    )
    budget: float | None = option(
        None,
        help="CPU-seconds of a simulation per second of the clip; beyond, plans are coarser, and "
        "no run is like another.",
        unit="s",
        above=0,
        most=1000,
        default_text="none",
        advanced=True,
    )
    seed: int = option(
        0, help="Of the noise on hard stretches: same seed, same simulation.", least=0,
        most=2**31 - 1, advanced=True,
    )  # fmt: skip

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class SimulationOutput:
    """What becomes of a simulation on the command line."""

    out: Path | None = option(
        None, help="The simulation with its proof, a clip file too.", metavar="SIM.npz"
    )
    report: Path | None = option(
        None, help="A folder for a page that plays it, and its numbers.", metavar="FOLDER"
    )
    format: Literal["text", "json"] = option("text", help="Of the numbers.")
