"""Keys of a chain of placed templates, before their values are fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Key
from physretarget.face.hmm import align
from physretarget.face.place import Placed
from physretarget.face.templates import Bank, sample
from physretarget.face.warp import Draft
from physretarget.options.facial import Method

Array = NDArray[np.float64]
_NODES = 24


@dataclass
class _Rows:
    table: list[Array]
    slopes: list[list[float]]
    steep: list[float]
    join: list[bool]
    piece: list[int]


def assemble(
    placed: list[Placed],
    bank: Bank,
    fps: float,
    smooth: Array,
    pinned: Mapping[int, Key],
    method: Method = "distance",
) -> tuple[Draft, tuple[int, ...]]:
    """Lay the templates' keys end to end; neighbours share one key.

    Args:
        placed: a chain from the first to the last frame.
        bank: their templates.
        fps: frame rate.
        smooth: (M,) capture that segments begin and end on.
        pinned: locked keys by frame, in frames and units of the range.
        method: with ``hmm`` the keys inside a phrase move to the frames of the alignment.

    Returns:
        The draft, and per key the piece that ends there (first key: that begins there).
    """
    rows = _Rows([np.zeros(6)], [[]], [0.0], [True], [0])
    rows.table[0][:2] = placed[0].first, smooth[placed[0].first]
    for number, piece in enumerate(placed):
        _append(rows, number, _local(piece, bank, fps, smooth, method))
    table = np.array(rows.table)
    slope = np.array([np.mean(s) if s else 0.0 for s in rows.slopes])
    # Templates may disagree with the capture by about half their own mean steepness.
    spread = 0.5 * np.array(rows.steep) + 1e-3
    join = np.array(rows.join)
    held = np.zeros(len(table), dtype=bool)
    for k, frame in enumerate(table[:, 0]):
        key = pinned.get(round(float(frame))) if join[k] else None
        if key is not None:
            table[k] = [frame, key.value, *key.in_tangent, *key.out_tangent]
            held[k], join[k] = True, False
    return Draft(table, join, held, slope, spread), tuple(rows.piece)


def _local(piece: Placed, bank: Bank, fps: float, smooth: Array, method: Method) -> Array:
    """(K, 6) the template's keys over its frames, ends on the smooth capture."""
    n = piece.last - piece.first
    if piece.phrase:
        source = bank.phrase_table(piece.template, n / fps)
    else:
        source = bank.spans[piece.template].table
    start, end = smooth[piece.first], smooth[piece.last]
    table = source.copy()
    if not piece.phrase:
        table *= np.array([n, end - start] * 3)
    else:
        window = smooth[piece.first : piece.last + 1]
        table = _phrase(table, window, n)
        if method == "hmm":
            table = _aligned(source, table, window)
    table[:, 0] += piece.first
    table[:, 1] += start
    return table


def _phrase(table: Array, window: Array, n: int) -> Array:
    """Least-squares amplitude plus the ramp that makes the ends meet the window's."""
    shape = sample([table], n + 1)[0]
    ramp = np.linspace(0.0, 1.0, n + 1)
    level = window - window[0]
    bent = shape - shape[-1] * ramp
    power = float(bent @ bent)
    gain = max(0.0, float(bent @ (level - level[-1] * ramp)) / power) if power > 1e-12 else 0.0
    tilt = level[-1] - gain * shape[-1]
    result = table * np.array([1.0, gain] * 3)
    result[:, 1] += tilt * table[:, 0]
    result[:, 3] += tilt * table[:, 2]
    result[:, 5] += tilt * table[:, 4]
    scaled: Array = result * np.array([n, 1.0] * 3)
    return scaled


def _aligned(source: Array, table: Array, window: Array) -> Array:
    """Inner keys at the frames that Viterbi gives them, tangent lengths with their spans."""
    n = len(window) - 1
    nodes = min(_NODES, n + 1)
    place = np.linspace(0.0, 1.0, nodes)
    example = np.interp(place * n, np.arange(n + 1), sample_table(table, n + 1))
    frames = align(example, window).astype(np.float64)
    moved = np.round(np.interp(source[:, 0], place, frames))
    if (np.diff(moved) < 2.0).any() or moved[0] != 0 or moved[-1] != n:
        return table
    result = table.copy()
    before, after = np.diff(table[:, 0]), np.diff(moved)
    result[:, 0] = moved
    result[:-1, 4] *= after / before
    result[1:, 2] *= after / before
    return result


def sample_table(table: Array, count: int) -> Array:
    """(count,) values of a key table that starts at time zero, at even times."""
    width = table[-1, 0]
    values: Array = sample([table / np.array([width, 1.0] * 3)], count)[0]
    return values


def _append(rows: _Rows, number: int, local: Array) -> None:
    steep = np.abs(np.diff(local[:, 1])) / np.diff(local[:, 0])
    rows.table[-1][4:6] = local[0, 4:6]
    rows.slopes[-1].append(float(local[0, 5] / local[0, 4]))
    rows.steep[-1] = max(rows.steep[-1], float(steep[0]))
    last = len(local) - 1
    # Whole frames where the keys stay apart; else all as they are, lest two meet.
    whole = bool(np.diff(np.round(local[:, 0])).min() > 0)
    for k in range(1, len(local)):
        row = local[k].copy()
        if k < last and whole:
            row[0] = round(row[0])
        rows.table.append(row)
        rows.slopes.append([float(row[3] / row[2])] if k == last else [])
        rows.steep.append(float(steep[k - 1]))
        rows.join.append(k == last)
        rows.piece.append(number)
