"""Values and slopes of keys at given times: one weighted least-squares problem per channel.

Unknown are each key's value and the slopes of the sides that move; a hold's two keys share their
value, and sides that both move share their slope. Only neighbours meet, so the normal equations
are banded and a take of any length is solved in time proportional to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from physretarget.face.bezier import solve_time
from physretarget.face.curve import Key
from physretarget.face.spans import HOLD, KINDS, LINE

Array = NDArray[np.float64]
Ints = NDArray[np.intp]
_MOVES = np.array([[k.leaves(0), k.leaves(1)] for k in KINDS])
_BAND = 8


@dataclass(frozen=True, eq=False)
class Chain:
    """A channel's keys as frames (K,) and the kinds of the spans between them (K-1,)."""

    frames: Ints
    kinds: Ints


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the unknowns of a chain are.

    value (K,): column of a key's value. slope (K, 2): columns of its in and out slope, -1 where the
    side is flat. count: number of columns.
    """

    value: Ints
    slope: Ints
    count: int


def layout(chain: Chain, lines: bool, held: Mapping[int, Key] | None = None) -> Layout:
    """Columns in order of time.

    lines: straight spans stay straight, so their sides have no slope of their own; otherwise a side
    of one may bend to meet a neighbour that moves as well. held: numbers of locked keys; their
    slopes are given.
    """
    moves = _MOVES[chain.kinds].copy()
    straight = chain.kinds == LINE
    count = len(chain.frames)
    value, slope = np.zeros(count, dtype=np.intp), np.full((count, 2), -1, dtype=np.intp)
    column = 0
    for k in range(count):
        tied = k > 0 and chain.kinds[k - 1] == HOLD
        value[k] = value[k - 1] if tied else column
        column += not tied
        if held and k in held:
            continue
        into, out = k > 0 and bool(moves[k - 1, 1]), k < count - 1 and bool(moves[k, 0])
        rigid = (k > 0 and bool(straight[k - 1])), (k < count - 1 and bool(straight[k]))
        if lines or not (into and out) or all(rigid):
            into, out = into and not rigid[0], out and not rigid[1]
        if into:
            slope[k, 0] = column
        if out:
            slope[k, 1] = column
        column += into or out
    return Layout(value, slope, column)


def key_table(
    chain: Chain,
    values: Array,
    weight: Array,
    held: Mapping[int, Key] | None = None,
    *,
    lines: bool = False,
) -> Array:
    """(K, 6) rows as Curve.table in frames: the curve closest to values (M,), handles of thirds.

    held: locked keys by number, in frames and the values' unit; they stay as they are.
    """
    pins = held or {}
    table = _thirds(chain.frames.astype(np.float64))
    for k, key in pins.items():
        table[k] = [chain.frames[k], key.value, *key.in_tangent, *key.out_tangent]
    where = layout(chain, lines, pins)
    straight = _straight(chain, where, pins)
    basis, left = span_basis(table, len(values), straight)
    columns = np.stack(
        [where.value[left], where.slope[left, 1], where.value[left + 1], where.slope[left + 1, 0]]
    )
    known = np.zeros(len(values))
    for k in pins:
        known += np.where(left == k, basis[1] * table[k, 5], 0.0)
        known += np.where(left + 1 == k, basis[3] * table[k, 3], 0.0)
    basis[1] *= table[left, 4]
    basis[3] *= table[left + 1, 2]
    first = where.value[left]
    solved = _solve(columns, basis, values - known, weight, where, first, pins)
    table[:, 1] = solved[where.value]
    for k, key in pins.items():
        table[k, 1] = key.value
    steep = np.where(where.slope >= 0, solved[where.slope], 0.0)
    for k in range(len(table) - 1):
        if straight[k]:
            mean = (table[k + 1, 1] - table[k, 1]) / (table[k + 1, 0] - table[k, 0])
            steep[k, 1], steep[k + 1, 0] = mean, mean
    free = np.array([k not in pins for k in range(len(table))])
    table[free, 3] = (table[:, 2] * steep[:, 0])[free]
    table[free, 5] = (table[:, 4] * steep[:, 1])[free]
    return table


def curve_of(table: Array, frames: int) -> Array:
    """(M,) values of a key table on frames 0 to M-1."""
    basis, left = span_basis(table, frames, np.zeros(len(table) - 1, dtype=np.bool_))
    before = basis[0] * table[left, 1] + basis[1] * table[left, 5]
    value: Array = before + basis[2] * table[left + 1, 1] + basis[3] * table[left + 1, 3]
    return value


def span_basis(table: Array, frames: int, straight: NDArray[np.bool_]) -> tuple[Array, Ints]:
    """(4, M) weights of left value, out tangent, right value and in tangent; the left key (M,)."""
    time = np.arange(frames, dtype=np.float64)
    left = np.clip(np.searchsorted(table[:, 0], time, side="right") - 1, 0, len(table) - 2)
    width = table[left + 1, 0] - table[left, 0]
    x = np.clip((time - table[left, 0]) / width, 0.0, 1.0)
    one, two = table[left, 4] / width, 1.0 + table[left + 1, 2] / width
    third = np.allclose(one, 1 / 3) and np.allclose(two, 2 / 3)
    u = x if third else solve_time(x, np.clip(one, 0.0, 1.0), np.clip(two, 0.0, 1.0))
    v = 1.0 - u
    b1, b2 = 3 * v * v * u, 3 * v * u * u
    basis = np.stack([v**3 + b1, b1, u**3 + b2, b2])
    flat = straight[left]
    basis[0] = np.where(flat, 1.0 - x, basis[0])
    basis[2] = np.where(flat, x, basis[2])
    return basis, left


def _straight(chain: Chain, where: Layout, pins: Mapping[int, Key]) -> NDArray[np.bool_]:
    bent = (where.slope[:-1, 1] >= 0) | (where.slope[1:, 0] >= 0)
    beside = np.array([k in pins or k + 1 in pins for k in range(len(chain.kinds))], dtype=np.bool_)
    straight: NDArray[np.bool_] = (chain.kinds == LINE) & ~bent & ~beside
    return straight


def _thirds(time: Array) -> Array:
    table = np.zeros((len(time), 6))
    table[:, 0] = time
    table[1:, 2] = -np.diff(time) / 3.0
    table[:-1, 4] = np.diff(time) / 3.0
    return table


def _solve(
    columns: Ints,
    basis: Array,
    target: Array,
    weight: Array,
    where: Layout,
    first: Ints,
    pins: Mapping[int, Key],
) -> Array:
    band = np.zeros((_BAND, where.count))
    right = np.zeros(where.count)
    for a in range(4):
        heavy = weight * basis[a]
        some = columns[a] >= 0
        np.add.at(right, columns[a][some], (heavy * target)[some])
        for b in range(4):
            both = some & (columns[b] >= columns[a])
            gap = columns[b][both] - columns[a][both]
            np.add.at(band, (_BAND - 1 - gap, columns[b][both]), (heavy * basis[b])[both])
    # A trace of a pull keeps keys determined that no frame tells of.
    band[-1] += 1e-9 * max(float(band[-1].max(initial=0.0)), 1e-12)
    for k, key in pins.items():
        pull = 1e9 * max(float(band[-1].max()), 1.0)
        band[-1, where.value[k]] += pull
        right[where.value[k]] += pull * key.value
    solved: Array = solveh_banded(band, right)
    return solved
