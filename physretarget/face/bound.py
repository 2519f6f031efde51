"""A hard bound on the deviation from the capture, kept by adding keys where it is exceeded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.face.curve import Curve

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
_ROUNDING = 1e-9


def bounded(
    table: Array, broken: Flags, held: Flags, values: Array, smooth: Array, most: float
) -> tuple[Array, Flags, Flags]:
    """Keys added, or moved onto the capture, until no frame deviates by more than ``most``.

    Every span that does gets a key where it is worst; a key that is itself too far off takes the
    capture's value. Keys at every frame would follow the capture exactly, so this ends. Locked keys
    stay, whatever they deviate.

    Args:
        table: (K, 6) keys in frames.
        broken: (K,) whether a key's tangents may differ.
        held: (K,) locked keys.
        values: (M,) capture.
        smooth: (M,) the same without noise, for slopes.
        most: bound, in the values' unit.
    """
    frames = np.arange(len(values), dtype=np.float64)
    slope = np.gradient(smooth)
    while True:
        over = np.abs(Curve.from_table(table).evaluate(frames) - values) - most
        over[over <= _ROUNDING * max(1.0, most)] = 0.0
        fixed = table[held, 0]
        over[np.isin(frames, fixed)] = 0.0
        if not over.any():
            return table, broken, held
        left = np.clip(np.searchsorted(table[:, 0], frames, side="right") - 1, 0, len(table) - 2)
        new, moved = [], False
        for k in np.unique(left[over > 0]).tolist():
            inside = np.flatnonzero(left == k)
            worst = int(inside[over[inside].argmax()])
            near = np.flatnonzero(np.abs(table[:, 0] - worst) < 1e-6)
            if len(near):
                table = table.copy()
                table[near[0], 1] = values[worst]
                moved = True
            else:
                new.append(worst)
        if not new and not moved:
            return table, broken, held
        for worst in new:
            table, broken, held = _with_key(
                table, broken, held, worst, float(values[worst]), float(slope[worst])
            )


def _with_key(
    table: Array, broken: Flags, held: Flags, frame: int, value: float, slope: float
) -> tuple[Array, Flags, Flags]:
    """One key more; handles of the two new spans keep their slopes and are thirds."""
    k = int(np.searchsorted(table[:, 0], frame))
    before, after = frame - table[k - 1, 0], table[k, 0] - frame
    result = np.insert(table, k, 0.0, axis=0)
    if not held[k - 1]:
        result[k - 1, 4:6] = _handle(table[k - 1, 4:6], before / 3.0)
    if not held[k]:
        result[k + 1, 2:4] = _handle(table[k, 2:4], -after / 3.0)
    result[k] = [frame, value, -before / 3, -before / 3 * slope, after / 3, after / 3 * slope]
    return result, np.insert(broken, k, False), np.insert(held, k, False)


def _handle(tangent: Array, run: float) -> Array:
    steep = tangent[1] / tangent[0] if abs(tangent[0]) > 1e-9 else 0.0
    return np.array([run, run * steep])
