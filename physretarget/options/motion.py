"""How clips and captures are read: what their files do not say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from physretarget.options.declaration import check, option

Quat = Literal["wxyz", "xyzw"]
JointOrder = Literal["model", "breadth-first"]

CLIP_UNITS: Mapping[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}
"""Metres per unit."""
# The CMU database's Acclaim files count in units of 1/0.45 inch.
CAPTURE_UNITS: Mapping[str, float] = {**CLIP_UNITS, "cmu": 0.0254 / 0.45}
"""Metres per unit."""
CAPTURES = "BVH, C3D, TRC, AMC, SMPL, FBX, glTF, USD, MVNX, Motive, Qualisys or key point"


@dataclass(frozen=True, kw_only=True)
class ClipOptions:
    """What a clip's file does not say."""

    fps: float | None = option(
        None,
        help="Frames per second, for files that do not state it.",
        unit="fps",
        above=0,
        most=10_000,
        default_text="from the file",
        label="Frame rate",
    )
    quat: Quat | None = option(
        None,
        help="Order of the root's quaternion, for files that do not state it.",
        default_text="detected",
        label="Quaternions",
    )
    unit: str | None = option(
        None,
        help="Length unit of the file, or metres per unit (for example 0.0254).",
        choices=tuple(CLIP_UNITS),
        or_metres=True,
        default_text="m",
        advanced=True,
        label="Length unit",
    )
    joint_order: JointOrder | None = option(
        None, help="Order of the joints, for files that do not name them.",
        default_text="detected", advanced=True,
    )  # fmt: skip

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class CaptureOptions:
    """What a capture's file does not say."""

    unit: str | None = option(
        None,
        help=(
            "Length unit of the capture, or metres per unit (for example 0.0254). "
            "AMC files of the CMU database use cmu."
        ),
        choices=tuple(CAPTURE_UNITS),
        or_metres=True,
        default_text="guessed",
        advanced=True,
        label="Length unit",
    )
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = option(
        None,
        help="Up axis of the capture.",
        default_text="guessed",
        metavar="[-]x|y|z",
        advanced=True,
        label="Up axis",
    )
    mass: float | None = option(
        None, help="Actor mass in kg.", unit="kg", least=5, most=500,
        default_text="from the stature", advanced=True, label="Actor's mass",
    )  # fmt: skip
    subject: str | None = option(
        None,
        help=(
            "Which person to use if there are several: the name before the colon in "
            "labels or joints, or a number from 1."
        ),
        default_text="the first, or the best marked",
        advanced=True,
    )
    rate: float | None = option(
        None,
        help="Frames per second, for captures that do not state it.",
        unit="fps",
        least=1,
        most=1000,
        default_text="from the file",
        advanced=True,
        label="Capture's frame rate",
    )
    hold_floor: bool = option(
        False,
        help=("Remove the motion of a moving floor, such as a treadmill's belt or drift."),
        advanced=True,
        label="Hold the floor still",
    )
    on_doubt: Literal["note", "fail"] = option(
        "note",
        help=(
            "What to do with a capture that no human on a floor could have made: "
            "note prints the doubt, fail refuses it."
        ),
        advanced=True,
        label="On doubt",
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class InspectionOutput:
    """How an inspection is shown."""

    format: Literal["text", "json"] = option("text", help="Format of the output.")
    picture: Path | None = option(
        None, help="Draw the capture and the fitted actor into this picture.", metavar="FILE.png"
    )


@dataclass(frozen=True, kw_only=True)
class SkeletonFile:
    """The second file of an AMC capture."""

    skeleton: Path | None = option(
        None,
        help="Skeleton of an AMC capture, if it is not in the same folder.",
        metavar="FILE.asf",
    )


@dataclass(frozen=True, kw_only=True)
class NameMapFile:
    """What the joints or markers of a capture are."""

    map: Path | None = option(
        None,
        help=(
            "Which joint or marker of the capture is which part of the body, where their "
            "names do not say so."
        ),
        metavar="FILE.toml",
    )


@dataclass(frozen=True, kw_only=True)
class Resampling:
    """The rate at which a capture is played."""

    resample: float | None = option(
        None,
        help="Resample the capture to this many frames per second first.",
        unit="fps",
        least=1,
        most=1000,
        default_text="as recorded",
        aliases=("fps",),
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class ClipModel:
    """The model of a clip."""

    model: Path = option(help="The clips' MJCF file.", aliases=("character",), metavar="MODEL.xml")


@dataclass(frozen=True, kw_only=True)
class CharacterFile:
    """The character that is to move."""

    character: Path = option(
        help="The character's MJCF file.", aliases=("model",), metavar="MODEL.xml"
    )


@dataclass(frozen=True, kw_only=True)
class ConversionOptions:
    """What is written by a conversion."""

    model: Path | None = option(
        None,
        help="The clip's MJCF file; bvh and glb need it.",
        aliases=("character",),
        metavar="MODEL.xml",
    )
    to_quat: Quat = option("xyzw", help="Quaternion order of OUT if it is a csv file.")
    header: bool = option(False, help="Write a header line and a time column into a csv file.")


@dataclass(frozen=True, kw_only=True)
class FixOutput:
    """Where mended clips go."""

    out: Path = option(
        help="File for the mended clip (.npz), or a folder for several clips.", metavar="FIXED"
    )
    report: Path | None = option(
        None, help="Folder for a page with the clip before and after, side by side.", metavar="DIR"
    )


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """Where a clip is shown."""

    video: Path | None = option(None, help="Write a film; no display is needed.", metavar="F.mp4")
    html: Path | None = option(
        None, help="Write a single HTML page that plays in any browser, offline.", metavar="F.html"
    )
    web: bool = option(False, help="Serve the page on this machine.")
    port: int = option(0, help="Port for --web; 0 picks a free one.", least=0, most=65535)
    report: Path | None = option(
        None,
        help="Show the findings of this report instead of judging the clip now.",
        metavar="FILE.json",
    )
    speed: float = option(
        1.0, help="Speed of window and film; 0.25 is slow motion.", above=0, most=100
    )
