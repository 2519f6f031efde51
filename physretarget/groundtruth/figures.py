"""The page's pictures."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from physretarget.groundtruth.compare import Comparison

_MEASURED, _PREDICTED, _RAW = "#222222", "#d1495b", "#b8c0c8"
_COLOURS = (
    "#1b6ca8", "#d1495b", "#2a9d6f", "#e09f3e", "#7a5195", "#5f6b73", "#00a6a6", "#9c6644",
    "#c2185b",
)  # fmt: skip


def vertical(comparisons: Sequence[Comparison]) -> bytes:
    """Vertical force of every trial over time, predicted and measured."""
    columns = 3
    rows = -(-len(comparisons) // columns)
    figure, grid = _grid(rows, columns, height=2.15)
    for axes, one in zip(grid, comparisons, strict=False):
        axes.plot(one.time, one.raw[:, 2], color=_RAW, lw=1.0, label="plates, unfiltered")
        axes.plot(one.time, one.measured[:, 2], color=_MEASURED, lw=1.4, label="plates")
        axes.plot(one.time, one.predicted[:, 2], color=_PREDICTED, lw=1.4, label="from motion")
        _shade(axes, one)
        top = float(max(one.measured[:, 2].max(), one.predicted[:, 2].max(), 1.0))
        axes.set_ylim(-0.25, max(1.5, 1.12 * top))
        axes.set_title(f"{one.name} · RMSE {one.vertical.rmse:.3f} BW", fontsize=9)
    _finish(figure, grid, len(comparisons), "vertical force, BW")
    return _png(figure)


def horizontal(comparisons: Sequence[Comparison]) -> bytes:
    """Forward force on top, sideways force below, one column per trial."""
    figure, grid = _grid(2, len(comparisons), height=2.1)
    for i, one in enumerate(comparisons):
        for row, axis in enumerate((0, 1)):
            axes = grid[row * len(comparisons) + i]
            axes.plot(one.time, one.raw[:, axis], color=_RAW, lw=1.0, label="plates, unfiltered")
            axes.plot(one.time, one.measured[:, axis], color=_MEASURED, lw=1.4, label="plates")
            axes.plot(
                one.time, one.predicted[:, axis], color=_PREDICTED, lw=1.4, label="from motion"
            )
            _shade(axes, one)
            shown = np.abs(np.concatenate([one.measured, one.predicted])[:, axis]).max()
            shown = max(float(shown), 0.02)
            axes.set_ylim(-1.15 * shown, 1.15 * shown)
            name = ("forward", "sideways")[row]
            error = (one.forward, one.left)[row].rmse
            axes.set_title(f"{one.name} · {name} · RMSE {error:.3f} BW", fontsize=9)
    _finish(figure, grid, len(grid), "force, BW")
    return _png(figure)


def filters(by_trial: Mapping[str, Sequence[tuple[float, float, float | None]]]) -> bytes:
    """Vertical RMSE and correlation over the cut-off: (Hz, RMSE, r) per trial."""
    figure, (left, right) = _grid(1, 2, height=3.0)
    for colour, (name, points) in zip(_COLOURS * 3, by_trial.items(), strict=False):
        hz = [point[0] for point in points]
        left.plot(hz, [point[1] for point in points], "o-", ms=3, lw=1.2, color=colour, label=name)
        if points[0][2] is not None:
            r = [np.nan if point[2] is None else point[2] for point in points]
            right.plot(hz, r, "o-", ms=3, lw=1.2, color=colour)
    left.axhline(0.12, color="#888888", lw=0.8, ls="--")
    right.axhline(0.9, color="#888888", lw=0.8, ls="--")
    left.set_ylim(0, 0.16)
    right.set_ylim(0.88, 1.002)
    left.set_ylabel("vertical RMSE, BW", fontsize=9)
    right.set_ylabel("r", fontsize=9)
    for axes in (left, right):
        axes.set_xlabel("low-pass of motion and plates, Hz", fontsize=9)
    left.legend(fontsize=7, frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, 0.98))
    figure.tight_layout()
    return _png(figure)


def _grid(rows: int, columns: int, *, height: float) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(9.6, rows * height), dpi=96)
    axes = figure.subplots(rows, columns, squeeze=False)
    for each in axes.flat:
        each.tick_params(labelsize=8)
        each.grid(color="#eeeeee", lw=0.6)
        for side in ("top", "right"):
            each.spines[side].set_visible(False)
    return figure, list(axes.flat)


def _shade(axes: Any, one: Comparison) -> None:
    """Grey where nothing is judged."""
    axes.set_xlim(one.time[0], one.time[-1])
    low, high = 0.0, 1.0
    axes.fill_between(
        one.time, low, high, where=~one.frames, step="mid", color="#f0ede6",
        transform=axes.get_xaxis_transform(), zorder=0, lw=0,
    )  # fmt: skip


def _finish(figure: Figure, grid: Sequence[Any], used: int, label: str) -> None:
    for axes in grid[used:]:
        axes.set_axis_off()
    handles, names = grid[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="upper center", ncols=3, fontsize=9, frameon=False)
    figure.supxlabel("time, s", fontsize=9)
    figure.supylabel(label, fontsize=9)
    inches = float(figure.get_size_inches()[1])
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.28 / inches))


def _png(figure: Figure) -> bytes:
    """Without the library's name and version, so that the same data give the same bytes."""
    content = io.BytesIO()
    figure.savefig(content, format="png", metadata={"Software": None})
    return content.getvalue()
