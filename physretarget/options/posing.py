"""Key poses: which frames to pose next, and files and pictures of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from physretarget.options.declaration import check, option


@dataclass(frozen=True, kw_only=True)
class SheetFile:
    """Where the picture of all pairs goes."""

    out: Path = option(help="Picture to write.", metavar="SHEET.png")


@dataclass(frozen=True, kw_only=True)
class SuggestOptions:
    """Which frames are worth posing."""

    keyposes: tuple[Path, ...] = option(
        (),
        help="Key pose file with the poses so far; may be given several times.",
        metavar="FILE",
    )
    count: int = option(10, help="Number of frames to suggest.", least=1)
    resample: float = option(
        10.0,
        help="Consider this many frames per second of the capture.",
        unit="fps",
        least=1,
        most=240,
        aliases=("fps",),
    )
    format: Literal["text", "json"] = option("text", help="Format of the list.")
    out: Path | None = option(
        None, help="Write a key pose file with a start pose for each frame.", metavar="NEW.toml"
    )
    sheet: Path | None = option(
        None, help="Draw the start poses into this picture.", metavar="SHEET.png"
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class ProposeOptions:
    """Start poses for frames of one's own choice."""

    time: tuple[float, ...] = option(
        help="Time of a frame in the capture; may be given several times.", unit="s", least=0
    )
    out: Path = option(help="Key pose file to write.", metavar="NEW.toml")
    sheet: Path | None = option(
        None, help="Draw the start poses into this picture.", metavar="SHEET.png"
    )

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class StudioOptions:
    """Where the studio works, and listens."""

    keyposes: Path = option(
        help="Key pose file to edit; created if it does not exist.", metavar="FILE.toml"
    )
    host: str = option(
        "127.0.0.1", help="Address to listen on; the default is this machine only.",
        metavar="ADDRESS",
    )  # fmt: skip
    port: int = option(0, help="Port to listen on.", least=0, most=65535, default_text="a free one")

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True, kw_only=True)
class PlantOptions:
    """Where the poses go that were put down."""

    out: Path | None = option(
        None, help="Key pose file to write.", metavar="NEW.toml", default_text="in place"
    )


@dataclass(frozen=True, kw_only=True)
class NewCharacterOptions:
    """How a robot's file becomes a character."""

    out: Path = option(
        help="File for the character; meshes are copied into a folder beside it.", metavar="M.xml"
    )
    front: Literal["+x", "-x", "+y", "-y", "+z", "-z"] | None = option(
        None, help="Front direction, in the root's frame.", default_text="a guess"
    )
    up: Literal["+z", "+y"] = option("+z", help="Up direction, in the root's frame.")

    def __post_init__(self) -> None:
        check(self)
