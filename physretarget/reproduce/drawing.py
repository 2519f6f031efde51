"""Figures as SVG in a data address: light ground, dark ink, the paper's colours."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from physretarget.reproduce.store import Piece

Array = NDArray[np.float64]
BLUE, RED, GREEN, GREY = "#1f6fc4", "#d6402b", "#12875c", "#7a8499"
COLOURS = (BLUE, RED, GREEN, "#b86e00", "#7a48c2", GREY)
STYLE = {
    "font.size": 9,
    "font.family": "sans-serif",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e9ef",
    "legend.frameon": False,
    "svg.hashsalt": "physretarget",
    "svg.fonttype": "path",
    "path.simplify_threshold": 0.5,
}


def figure(width: float, height: float, rows: int, columns: int, **more: Any) -> tuple[Figure, Any]:
    """A figure in our style; axes as a (rows, columns) array. No window, no global state."""
    drawn = Figure(figsize=(width, height), layout="constrained")
    return drawn, drawn.subplots(rows, columns, squeeze=False, **more)


def svg(drawn: Figure) -> str:
    """The figure as a data address; same figure, same bytes."""
    content = io.BytesIO()
    drawn.savefig(content, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(content.getvalue()).decode("ascii")


def latent_maps(piece: Piece, dims: Sequence[int], searches: Sequence[tuple[str, str]]) -> str:
    """Figure 6: trajectories on the variance map, a row per search, a column per dimension."""
    with matplotlib.rc_context(STYLE):
        drawn, axes = figure(10.5, 3.5 * len(searches), len(searches), len(dims))
        own = piece.arrays["own"].astype(bool)
        for row, (search, label) in zip(axes, searches, strict=True):
            for axis, count in zip(row, dims, strict=True):
                tag = f"{count}_{search}"
                way, keys = piece.arrays[f"way_{tag}"], piece.arrays[f"keys_{tag}"]
                axis.imshow(
                    np.sqrt(piece.arrays[f"variance_{tag}"]),
                    extent=tuple(piece.arrays[f"extent_{tag}"]),
                    origin="lower",
                    aspect="auto",
                    cmap="Greys",
                    vmax=1.6 * float(np.sqrt(piece.arrays[f"variance_{tag}"].max())),
                )
                axis.plot(*way.T, color=BLUE, linewidth=0.9)
                axis.plot(*way.T, "^", color=BLUE, markersize=2.2)
                axis.plot(*keys[~own].T, "x", color=RED, markersize=4.5, markeredgewidth=0.9)
                axis.plot(
                    *keys[own].T,
                    "o",
                    markersize=8,
                    markerfacecolor="none",
                    markeredgecolor=GREEN,
                    markeredgewidth=1.8,
                )
                axis.set_title(f"{count} dimensions, {label}")
                axis.grid(False)
                axis.set_xticks([])
                axis.set_yticks([])
        return svg(drawn)


def dimension_curves(pieces: dict[str, Piece]) -> str:
    """Both criteria against the latent dimension."""
    with matplotlib.rc_context(STYLE):
        drawn, axes = figure(10.5, 3.2, 1, 3)
        panels = (
            ("keypose_error", "Key poses, % of the height"),
            ("unseen", "Held-out sequences, % of the height"),
            ("jerk", "Jerk of a mapped marker, m/s³"),
        )
        for axis, (key, title) in zip(axes[0], panels, strict=True):
            for colour, (name, piece) in zip(COLOURS, pieces.items(), strict=False):
                rows = piece.facts["rows"]
                dims = [row["dims"] for row in rows]
                for search, dash in (("guided", "-"), ("paper", ":")):
                    if search == "paper" and key == "unseen":
                        continue
                    axis.plot(
                        dims,
                        [_criterion(piece, row, search, key) for row in rows],
                        dash,
                        marker="o",
                        markersize=3.5,
                        color=colour,
                        label=name if search == "guided" else f"{name}, paper's search",
                    )
            axis.set_title(title)
            axis.set_xticks([row["dims"] for row in rows])
            axis.set_xlabel("latent dimensions")
            axis.set_ylim(bottom=0)
        axes[0, 2].legend(fontsize=7.5)
        return svg(drawn)


def _criterion(piece: Piece, row: dict[str, Any], search: str, key: str) -> float:
    if key == "jerk":
        return float(row[search][key])
    return _part(piece, row[key] if key == "unseen" else row[search][key])


def _part(piece: Piece, metres: float) -> float:
    return 100 * metres / float(piece.facts["height"])


def iteration_curves(pieces: dict[str, Piece]) -> str:
    """Errors on seen and unseen key poses against iterations."""
    with matplotlib.rc_context(STYLE):
        drawn, axes = figure(10.5, 3.0, 1, 2)
        for axis, (key, title) in zip(
            axes[0],
            (("keypose_error", "Key poses"), ("unseen", "Held-out sequences")),
            strict=True,
        ):
            for colour, (name, piece) in zip(COLOURS, pieces.items(), strict=False):
                rows = piece.facts["rows"]
                axis.semilogx(
                    [row["iterations"] for row in rows],
                    [_part(piece, row[key]) for row in rows],
                    "o-",
                    markersize=3.5,
                    color=colour,
                    label=name,
                )
            axis.axvline(70, color=GREY, linestyle="--", linewidth=1)
            ticks = [row["iterations"] for row in rows]
            axis.set_xticks(ticks, [str(t) for t in ticks], minor=False)
            axis.minorticks_off()
            axis.set_title(f"{title}, % of the height")
            axis.set_xlabel("iterations (dashed: the paper's 70)")
            axis.set_ylim(bottom=0)
            axis.legend()
        return svg(drawn)


def momentum_curves(pieces: Sequence[tuple[str, Piece]]) -> str:
    """Figure 8, a panel per sequence: scaled actor and character, forward."""
    with matplotlib.rc_context(STYLE):
        rows = -(-len(pieces) // 3)
        drawn, axes = figure(10.5, 1.75 * rows, rows, 3)
        for axis, (title, piece) in zip(axes.flat, pieces, strict=False):
            time = piece.arrays["time"]
            axis.plot(time, piece.arrays["momentum_achieved"], color=RED, linewidth=1.5)
            axis.plot(time, piece.arrays["momentum_target"], "--", color=BLUE, linewidth=1.1)
            axis.set_title(title)
        _blank(axes.flat, len(pieces))
        _ends(axes, "s", "kg m/s")
        return svg(drawn)


def force_curves(pieces: Sequence[tuple[str, Piece]]) -> str:
    """Figure 9, a row per sequence: required and contact-model force, before and after."""
    with matplotlib.rc_context(STYLE):
        drawn, axes = figure(10.5, 1.55 * len(pieces), len(pieces), 2, sharey="row")
        for row, (title, piece) in zip(axes, pieces, strict=True):
            a = piece.arrays
            for axis, when in zip(row, ("before", "after"), strict=True):
                axis.plot(a["time"], a[f"contact_{when}"], color=RED, linewidth=1.4)
                axis.plot(a["time"], a[f"required_{when}"], "--", color=BLUE, linewidth=1.0)
                rest = a[f"contact_{when}"] - a[f"required_{when}"]
                axis.set_title(f"{title}, {when}: {np.sqrt(np.mean(rest**2)):.2f} BW apart")
            top = np.quantile(
                np.concatenate([a["required_before"], a["required_after"], a["contact_after"]]),
                [0.002, 0.998],
            )
            row[0].set_ylim(min(float(top[0]), 0.0) - 0.3, float(top[1]) + 0.5)
        _ends(axes, "s", "BW")
        return svg(drawn)


def _blank(axes: Any, used: int) -> None:
    for axis in list(axes)[used:]:
        axis.set_visible(False)


def _ends(axes: Any, x: str, y: str) -> None:
    for row in axes:
        row[0].set_ylabel(y)
    for axis in axes[-1]:
        axis.set_xlabel(x)


def error_bars(pieces: dict[str, Piece], groups: Sequence[tuple[str, str]]) -> str:
    """Held-out errors of the mappers: a panel per character, a group of bars per way."""
    with matplotlib.rc_context(STYLE):
        drawn, axes = figure(10.5, 3.1, 1, len(pieces))
        for axis, (name, piece) in zip(axes[0], pieces.items(), strict=True):
            rows = piece.facts["rows"]
            width = 0.8 / len(rows)
            for k, row in enumerate(rows):
                at = np.arange(len(groups)) + (k - (len(rows) - 1) / 2) * width
                values = [_part(piece, row[key]) for key, _ in groups]
                axis.bar(at, values, 0.92 * width, color=COLOURS[k], label=row["mapper"])
            axis.set_xticks(np.arange(len(groups)), [label for _, label in groups])
            axis.set_title(f"{name}: error, % of the height")
            axis.grid(False, axis="x")
        axes[0, 0].legend(ncols=2, fontsize=8)
        return svg(drawn)
