"""How facial capture becomes sparse curves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from physretarget.options.declaration import check, option

Method = Literal["distance", "sax", "hmm"]
Preset = Literal["ruhland2017"]
Reducer = Literal["decimate", "schneider", "rdp"]
METHODS: tuple[Method, ...] = get_args(Method)
LARGEST_ERROR = 0.02  # of what a channel moves


@dataclass(frozen=True, kw_only=True)
class ChannelOptions:
    """Which channels are keyed."""

    lips: bool = option(
        False, help="Also set keys on the lips, which are otherwise left to the capture."
    )


@dataclass(frozen=True, kw_only=True)
class MatchOptions(ChannelOptions):
    """The animator's two sliders and what else can be chosen."""

    method: Method = option("distance", help="Similarity measure, with --preset.")
    fidelity: float = option(
        0.01,
        help="Deviation that is never worth a key, as a share of the channel's motion.",
        above=0,
    )
    key_cost: float = option(7.0, help="Price of a key in nats; higher gives fewer keys.", above=0)
    max_error: float | None = option(
        None,
        help=(
            "Largest deviation from the capture at any frame, as a share of the "
            "channel's motion. Keys are added until it holds."
        ),
        above=0,
        default_text="none",
    )
    preset: Preset | None = option(
        None,
        help=(
            "The paper's method as written: segments of past curves, longest first, "
            "compared by --method."
        ),
        default_text="none",
    )
    tau: float = option(
        0.05,
        help=("With --preset: largest misfit of a segment, as a share of the channel's motion."),
        above=0,
    )
    word: int = option(8, help="With --method sax: symbols per word.", least=2)
    alphabet: int = option(
        8, help="With --method sax: number of different symbols, 3 to 10.", least=3, most=10
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class RangeOptions:
    """Which part of a capture is matched."""

    start: float | None = option(
        None,
        help="First or last second of the take that is matched.",
        unit="s",
        least=0,
        default_text="the beginning",
    )
    end: float | None = option(
        None,
        help="First or last second of the take that is matched.",
        unit="s",
        above=0,
        default_text="the end",
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class RigFile:
    "Rig file that maps capture channels to rig channels."

    rig: Path | None = option(
        None,
        help="Rig file that maps capture channels to rig channels.",
        metavar="RIG.toml",
        default_text="ARKit's",
    )


@dataclass(frozen=True, kw_only=True)
class LibraryFiles:
    """What is matched against, and what stays."""

    library: Path = option(help="Library written by `face library`.", metavar="LIB.npz")
    locked: Path | None = option(
        None, help="File of keyed curves whose keys must not change.", metavar="FILE"
    )


@dataclass(frozen=True, kw_only=True)
class CurvesFile:
    """Where curves go."""

    out: Path = option(
        help="File of curves to write; its suffix selects the format.", metavar="FILE"
    )


@dataclass(frozen=True, kw_only=True)
class MatchReport:
    """Where the report of a match goes."""

    report: Path | None = option(None, help="Folder for an HTML report.", metavar="DIR")


@dataclass(frozen=True, kw_only=True)
class ReductionOptions(ChannelOptions):
    """Plain key reduction."""

    how: Reducer = option("decimate", help="Method of reduction.")
    error: float | None = option(
        None,
        help="Largest error, as a share of the channel's motion.",
        above=0,
        default_text=f"{LARGEST_ERROR:g}, without --keys",
    )
    keys: int | None = option(
        None, help="Number of keys per channel; use this or --error.", least=2
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class EventOptions:
    """Which event is moved, and where the result goes."""

    move: int | None = option(
        None, help="Number of the event to move; the list gives the numbers.", least=1
    )
    by: float | None = option(
        None, help="How much later the event happens; negative for earlier.", unit="s"
    )
    out: Path | None = option(
        None,
        help="File of curves to write after the move; its suffix selects the format.",
        metavar="FILE",
    )


@dataclass(frozen=True, kw_only=True)
class LibraryOptions:
    """How a library is collected."""

    out: Path = option(help="Library file to write.", metavar="LIB.npz")
    min_keys: int = option(
        4, help="Halve curves until a half would have fewer keys than this.", least=2
    )
    list: bool = option(False, help="List every shot of the library.")
