"""One placement for a group of channels, with small lags: the paper's outlook on coordination.

Channels that move together are keyed together: the group's cuts are those of the cheapest chain
under the summed price. Faces move uncoordinated in detail, so each channel may then set every cut
a few frames early or late, whichever is cheapest for it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physretarget.face.place import shortest_path

Array = NDArray[np.float64]


def joint_paths(
    cost: NDArray[np.float32], spans: NDArray[np.intp], lag: int
) -> list[list[tuple[int, int]]]:
    """Paths as shortest_path's for channels (C, M, L) that share their cuts up to a lag."""
    shared = shortest_path(cost.sum(axis=0, keepdims=True), spans)[0]
    ends = [0, *(j for j, _ in shared)]
    return [lagging(one, spans, ends, lag) for one in cost]


def lagging(
    cost: NDArray[np.float32], spans: NDArray[np.intp], cuts: list[int], lag: int
) -> list[tuple[int, int]]:
    """The cheapest path of one channel (M, L) whose cuts lie within ``lag`` frames of these.

    First and last cut stay. Exact, by dynamic programming over the lags of successive cuts.
    """
    number = {int(n): x for x, n in enumerate(spans)}
    states = [_near(cut, lag, k, len(cuts), cost.shape[0]) for k, cut in enumerate(cuts)]
    best = np.zeros(1)
    came: list[NDArray[np.intp]] = []
    for before, after in pairwise(states):
        edge = np.array(
            [[cost[j, number[j - i]] if j - i in number else np.inf for i in before] for j in after]
        )
        total = edge + best
        came.append(np.argmin(total, axis=1))
        best = total.min(axis=1)
    path: list[tuple[int, int]] = []
    state = 0
    for k in range(len(cuts) - 1, 0, -1):
        previous = int(came[k - 1][state])
        j, i = states[k][state], states[k - 1][previous]
        path.append((j, number[j - i]))
        state = previous
    return path[::-1]


def _near(cut: int, lag: int, k: int, count: int, frames: int) -> list[int]:
    if k in (0, count - 1):
        return [cut]
    return [j for j in range(cut - lag, cut + lag + 1) if 0 < j < frames - 1]
