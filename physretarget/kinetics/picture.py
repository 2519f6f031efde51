"""A picture of ground forces over time."""

from __future__ import annotations

import io
from os import PathLike

import numpy as np
from matplotlib.figure import Figure

from physretarget.errors import UsageError
from physretarget.files import write_file
from physretarget.kinetics.ground import GroundForces

_COLOURS = {"left": "#d1495b", "right": "#1b6ca8"}


def write_picture(found: GroundForces, path: str | PathLike[str]) -> None:
    """Vertical force, force along the floor and centre of pressure of both feet, as a PNG.

    Raises:
        UsageError: the name does not end in ``.png``.
    """
    if not str(path).lower().endswith(".png"):
        raise UsageError(f"a picture of forces is a .png, not {str(path)!r}")
    figure = Figure(figsize=(10, 7.5), layout="constrained")
    rows = figure.subplots(3, 1, sharex=True)
    time = found.time + found.start
    rows[0].plot(time, found.total[:, 2] / found.weight, color="#b8c0c8", lw=1.2, label="both feet")
    for name, foot in (("left", found.left), ("right", found.right)):
        colour, loaded = _COLOURS[name], foot.force[:, 2] > 0.05 * found.weight
        rows[0].plot(time, foot.force[:, 2] / found.weight, color=colour, lw=1.4, label=name)
        for axis, style, label in ((0, "-", "x"), (1, "--", "y")):
            rows[1].plot(
                time, foot.force[:, axis] / found.weight, style, color=colour, lw=1.2,
                label=f"{name}, {label}",
            )  # fmt: skip
            point = np.where(loaded, foot.point[:, axis], np.nan)
            rows[2].plot(time, point, style, color=colour, lw=1.2)
    for axes, label in zip(
        rows, ("vertical, BW", "along the floor, BW", "centre of pressure, m"), strict=True
    ):
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in rows[:2]:
        axes.legend(fontsize=8, ncols=4, frameon=False, loc="upper right")
    rows[-1].set_xlabel("time, s (x, y: the floor's axes, z up)")
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    write_file(path, stream.getvalue())
