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
        help=(
            "Let a wrench on the root help the simulation, as little as keeps the "
            "body on track: faster, but not exact."
        ),
    )
    budget: float | None = option(
        None,
        help=(
            "CPU-seconds of simulation per second of the clip. Beyond that, plans "
            "are coarser and runs differ."
        ),
        unit="s",
        above=0,
        most=1000,
        default_text="none",
        advanced=True,
    )
    seed: int = option(
        0,
        help=(
            "Random seed of the noise on hard stretches; the same seed gives the same simulation."
        ),
        least=0,
        most=2**31 - 1,
        advanced=True,
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class SimulationOutput:
    """What becomes of a simulation on the command line."""

    out: Path | None = option(
        None,
        help="File for the simulation with its proof; it is a clip file, too.",
        metavar="SIM.npz",
    )
    report: Path | None = option(
        None,
        help="Folder for a page that plays the simulation and shows its numbers.",
        metavar="FOLDER",
    )
    format: Literal["text", "json"] = option("text", help="Format of the numbers.")
