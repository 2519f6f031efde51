"""How captures become clips: the mapper, the stages, and the frames that come one by one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from physretarget.errors import UsageError
from physretarget.options.declaration import check, option

MapperName = Literal["sgplvm", "gp", "ridge", "pca", "nn3", "nn10"]
Stage = Literal["mapped", "placed", "contacted", "physical", "balanced", "simulated"]
Physics = Literal["default", "paper", "convex"]
Solver = Literal["banded", "ipopt"]
Heading = Literal["actor", "momentum"]
Blend = Literal["ballistic", "paper"]
Search = Literal["guided", "nearest"]
Markers = Literal["reference", "own"]
Preset = Literal["default", "yamane2010"]
Tail = Literal["mapped", "passive"]
MAPPERS: tuple[MapperName, ...] = get_args(MapperName)
STAGES: tuple[Stage, ...] = get_args(Stage)
DIALLED: tuple[Stage, ...] = ("physical", "balanced")
"""Stages whose change can be made in part: a foot that is half planted would slide."""
LONGEST_DELAY = 5.0  # s
PRESETS: Mapping[Preset, Mapping[str, str]] = {
    "default": {},
    "yamane2010": {
        "until": "physical",
        "physics": "paper",
        "heading": "momentum",
        "blend": "paper",
        "search": "nearest",
        "markers": "own",
    },
}
"""Options of a retargeting by preset."""


@dataclass(frozen=True, kw_only=True)
class MapperOptions:
    """How a mapper is learned from key poses."""

    mapper: str = option(
        "sgplvm",
        help=(
            "Method to learn from the key poses: sgplvm is the paper's; the others "
            "are baselines (Gaussian process, ridge regression, linear map, nearest "
            "key poses)."
        ),
        choices=MAPPERS,
    )
    dims: int = option(
        30,
        help="Latent dimensions of sgplvm and pca; must be fewer than the key poses.",
        least=1,
        most=200,
        advanced=True,
        label="Latent dimensions",
    )
    seed: int = option(
        0,
        help="Random seed of learning; the same seed gives the same mapper.",
        least=0,
        most=2**31 - 1,
        advanced=True,
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class MapperSource(MapperOptions):
    """A mapper to learn, or one that was learned before."""

    mapper: str = option(
        "sgplvm",
        help=(
            "Method to learn from the key poses, or a file that `learn` wrote. "
            "sgplvm is the paper's; the others are baselines."
        ),
        choices=MAPPERS,
        or_file=".npz",
        metavar="|".join(MAPPERS) + "|MAPPER.npz",
    )


@dataclass(frozen=True, kw_only=True)
class PresetOption:
    """Several options at once."""

    preset: Preset = option(
        "default",
        help=(
            "yamane2010 reproduces the paper: its printed parameters, and no later "
            "stage. Other options given with it still count."
        ),
    )

    def __post_init__(self) -> None:
        check(self)


def with_preset(given: Mapping[str, Any]) -> dict[str, Any]:
    """Options by name with those of the preset among them; what was given itself wins."""
    return {**PRESETS[given.get("preset") or "default"], **given}


@dataclass(frozen=True, kw_only=True)
class RetargetSettings:
    """What can be set about a retargeting; read once at the edge.

    ``lowpass_hz`` is a zero-lag 4th order Butterworth on the actor's motion before anything else
    (6 Hz is the biomechanics standard, Winter 2009). ``fps`` is the clip's frame rate, at which
    the capture is sampled; None for the capture's own up to ``max_fps``. For ``heading`` see
    :func:`physretarget.momentum.place`, for ``tail`` :mod:`physretarget.passive`.
    """

    until: Stage = option(
        "balanced",
        help=(
            "Last stage to run. simulated lets MuJoCo play the clip and takes "
            "several seconds per second of motion."
        ),
        advanced=True,
        label="Last stage",
    )
    physics: Physics = option(
        "default",
        help=(
            "How the stage physical finds the root's height; paper uses the printed "
            "parameters of Yamane 2010."
        ),
    )
    solver: Solver = option(
        "banded",
        help=(
            "Solver for the root's height: banded is linear in the clip's length; "
            "ipopt is slower and serves as a second opinion."
        ),
        advanced=True,
    )
    heading: Heading = option(
        "actor",
        help=(
            "What the character's heading follows: the actor's heading, or angular "
            "momentum (the paper)."
        ),
        advanced=True,
    )
    blend: Blend = option(
        "ballistic",
        help=(
            "How foot corrections are blended during flights: linearly (ballistic), "
            "or by eq. (9) of the paper."
        ),
        advanced=True,
    )
    search: Search = option(
        "guided",
        help=(
            "How sgplvm finds a frame's latent point: guided by a regression, or "
            "from the nearest key pose with uncalibrated variance (the paper)."
        ),
        advanced=True,
    )
    markers: Markers = option(
        "reference",
        help=(
            "Whose markers are mapped: those of the reference actor in the actor's "
            "pose, or the actor's own (the paper)."
        ),
        advanced=True,
    )
    tail: Tail = option(
        "mapped",
        help=(
            "What moves the joints that the model declares passive: the mapper, or "
            "their own springs."
        ),
        advanced=True,
    )
    start: float | None = option(
        None,
        help="Start at this time of the capture.",
        unit="s",
        least=0,
        default_text="its beginning",
    )
    end: float | None = option(
        None, help="End at this time of the capture.", unit="s", above=0, default_text="its end"
    )
    exaggerate: float = option(
        1.0,
        help=(
            "Scale the poses' distance from the clip's mean pose; 1.5 is half as far "
            "again. Joint limits and gravity still hold."
        ),
        least=0,
        most=3,
    )
    max_hop: float | None = option(
        None,
        help=(
            "Largest height of a hop, as a multiple of the character's height. "
            "Longer flights are played faster, since time in the air decides how "
            "high a hop is."
        ),
        above=0,
        most=100,
        default_text="as high as the actor's flights last",
    )
    strength: Mapping[str, float] = option(
        {},
        help=(
            "Share of a stage's change to make, for example balanced=0.5. Less keeps "
            "more of the acting and more of what physics forbids."
        ),
        keys=DIALLED,
        least=0,
        most=1,
        metavar="STAGE=SHARE",
    )
    keep: tuple[str, ...] = option(
        (),
        help=(
            "Seconds of the clip that the stages physical and balanced leave "
            "unchanged; may be given several times."
        ),
        span=True,
        metavar="START:END",
    )
    fps: float | None = option(
        None,
        name="resample",
        help="Resample the capture, and so the clip, to this many frames per second.",
        unit="fps",
        least=1,
        most=1000,
        default_text="the capture's, up to 60",
        aliases=("fps",),
        advanced=True,
    )
    lowpass_hz: float | None = option(
        6.0,
        name="lowpass",
        help="Cut-off of the low-pass filter on the capture; 0 turns it off.",
        unit="Hz",
        above=0,
        most=1000,
        zero_for_none=True,
        label="Low-pass",
    )
    seed: int = 0
    max_fps: float = 60.0  # fmt: skip

    def __post_init__(self) -> None:
        check(self)
        if self.tail == "passive" and self.until in ("mapped", "placed"):
            raise UsageError(f"a passive tail needs the contact stage; until is {self.until!r}.")
        if self.end is not None and self.end <= (self.start or 0.0):
            raise UsageError(
                f"end is {self.end:g} s; it must be later than start, {self.start or 0.0:g} s."
            )
        if self.solver == "ipopt" and self.physics == "convex":
            raise UsageError(
                "physics is 'convex', a cone programme with a solver of its own; "
                "solver 'ipopt' is for default and paper."
            )
        if not 1 <= self.max_fps <= 1000:
            raise UsageError(f"max_fps is {self.max_fps:g}; it must be a number from 1 to 1000.")


@dataclass(frozen=True, kw_only=True)
class KeyPoseFiles:
    """What a mapper is learned from."""

    keyposes: tuple[Path, ...] = option(
        (), help="Key pose file to learn from; may be given several times.", metavar="FILE"
    )


@dataclass(frozen=True, kw_only=True)
class MapperFile:
    """Where a mapper goes."""

    out: Path = option(help="The file to write.", metavar="MAPPER.npz")


@dataclass(frozen=True, kw_only=True)
class RetargetOutput:
    """Where clips and their reports go."""

    out: Path = option(
        help="Clip to write (.npz), or a folder for several captures.", metavar="PATH"
    )
    report: Path | None = option(
        None,
        help=("Folder for a page with verdict and replay; several captures get a subfolder each."),
        metavar="FOLDER",
    )


@dataclass(frozen=True, kw_only=True)
class PhasesFile:
    """Contact phases set by hand."""

    contacts: Path | None = option(
        None, help="When each foot stands, set by hand.", metavar="FILE.toml",
        default_text="detected",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class StreamOptions:
    """Retargeting frame by frame."""

    delay: float = option(
        0.0,
        help=(
            "Delay of the poses. A longer delay brings them nearer to the result of "
            "`retarget`; beyond a few steps it gains nothing."
        ),
        unit="s",
        least=0,
        most=LONGEST_DELAY,
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class StreamSource:
    """Where the mapper and the frames come from."""

    mapper: Path = option(help="Mapper written by `learn`.", metavar="MAPPER.npz")
    character: Path | None = option(
        None,
        help="The character's MJCF file, unless it came with the package.",
        aliases=("model",),
        metavar="MODEL.xml",
    )
    listen: str | None = option(
        None, help="Listen on a TCP socket instead of stdin.", metavar="HOST:PORT"
    )
    capture: Path | None = option(None, help="Play this capture instead of stdin.")
