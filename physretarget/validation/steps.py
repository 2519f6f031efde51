"""From frame to frame, unfiltered: frames that repeat, frames that leap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import Tree, difference

Floats = NDArray[np.float64]
Series = dict[str, NDArray[np.generic]]


def linear_dofs(tree: Tree) -> NDArray[np.bool_]:
    """(nv,) which degrees of freedom move in metres."""
    linear = np.zeros(tree.nv, dtype=bool)
    for joint in tree.joints:
        if joint.kind in ("free", "slide"):
            linear[joint.dof : joint.dof + (3 if joint.kind == "free" else 1)] = True
    return linear


def judge_steps(tree: Tree, raw: Floats, fps: float, keep: slice) -> Series:
    """``step`` (T,) largest change of a coordinate since the frame before (0 at the start), and
    ``leap_linear`` m/s, ``leap_angular`` rad/s: how much faster than the steps before and after.

    ``raw`` (T, nq) comes with its neighbours.
    """
    change = np.abs(np.diff(raw, axis=0)).max(axis=1)
    series: Series = {"step": np.r_[0.0, change][keep]}
    if len(raw) < 3:
        return series
    speed = np.abs(difference(tree, raw[:-1], raw[1:])) * fps
    around = np.empty_like(speed)
    around[0], around[-1] = speed[1], speed[-2]
    around[1:-1] = np.maximum(speed[:-2], speed[2:])
    leap = np.vstack([np.zeros((1, tree.nv)), speed - around])[keep]
    linear = linear_dofs(tree)
    for name, flags in (("leap_linear", linear), ("leap_angular", ~linear)):
        if flags.any():
            worst = np.flatnonzero(flags)[leap[:, flags].argmax(axis=1)]
            series[name] = leap[np.arange(len(leap)), worst]
            series[f"{name}_dof"] = worst
    return series
