"""The options of retarget and learn, one by one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, get_args

import typer

from physretarget import momentum, ocp
from physretarget.capture.skeleton import UNITS
from physretarget.cli.common import complete
from physretarget.mapping import NAMES
from physretarget.pipeline import STAGES, TAILS

DIMS = 30
HEADINGS = get_args(momentum.Heading)

CapturesArgument = Annotated[
    list[Path],
    typer.Argument(metavar="CAPTURE...", help="BVH, C3D, TRC, AMC or DeepMimic files."),
]
CharacterOption = Annotated[
    Path, typer.Option("--character", help="The character's MJCF file.", metavar="MODEL.xml")
]
KeyposesOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--keyposes",
        help="Key pose file to learn from; may be given several times.",
        metavar="FILE",
    ),
]
DimsOption = Annotated[
    int | None,
    typer.Option(
        "--dims",
        min=1,
        help=f"Latent dimensions of sgplvm and pca, fewer than key poses [default: {DIMS}].",
    ),
]
SeedOption = Annotated[
    int,
    typer.Option("--seed", min=0, help="Of learning: same seed, same mapper.", metavar="N"),
]

OutOption = Annotated[
    Path,
    typer.Option(
        "--out", help="Clip to write (.npz), or a folder; several captures need a folder."
    ),
]
MapperOption = Annotated[
    str,
    typer.Option(
        "--mapper",
        help="What to learn from --keyposes (sgplvm is the paper's), or a file written by learn.",
        metavar="|".join(NAMES) + "|MAPPER.npz",
    ),
]
UntilOption = Annotated[str, typer.Option("--until", help="Last stage to run.", **complete(STAGES))]
PhysicsOption = Annotated[
    str,
    typer.Option(
        "--physics",
        help="How stage physical finds the root's height; paper: as Yamane 2010 does.",
        **complete(ocp.PRESETS),
    ),
]
HeadingOption = Annotated[
    str,
    typer.Option(
        "--heading",
        help="What the character's facing follows: the actor's, or angular momentum (the paper).",
        **complete(HEADINGS),
    ),
]
TailOption = Annotated[
    str,
    typer.Option(
        "--tail",
        help="Joints that the model names as passive: posed by the mapper, or left to swing.",
        **complete(TAILS),
    ),
]
ContactsOption = Annotated[
    Path | None,
    typer.Option(
        "--contacts",
        help="When which foot stands, set by hand; found if not told.",
        metavar="FILE.toml",
    ),
]
FpsOption = Annotated[
    float | None,
    typer.Option("--fps", help="The clip's frames per second [default: the capture's, up to 60]."),
]
LowpassOption = Annotated[
    float,
    typer.Option("--lowpass", help="Low-pass filter on the capture; 0 for none.", metavar="HZ"),
]
UnitOption = Annotated[
    str | None,
    typer.Option(
        "--unit",
        help="The capture's length unit, if not to be guessed; or metres per unit, as in 0.0254. "
        "The CMU database's AMC files have cmu.",
        metavar="|".join(UNITS) + "|METRES",
    ),
]
UpOption = Annotated[
    str | None,
    typer.Option("--up", help="The capture's up axis, if not to be guessed.", metavar="[-]x|y|z"),
]
SkeletonOption = Annotated[
    Path | None,
    typer.Option(
        "--skeleton", help="Skeleton of an AMC capture, if not beside it.", metavar="FILE.asf"
    ),
]
MassOption = Annotated[
    float | None,
    typer.Option("--mass", help="The actor's [default: from the stature].", metavar="KG"),
]
ReportOption = Annotated[
    Path | None,
    typer.Option(
        "--report",
        help="Folder for a page with verdict and replay; of several captures a folder each in it.",
    ),
]
