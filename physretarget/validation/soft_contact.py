"""How far a model's own soft contacts let a landing body sink.

MuJoCo's contacts are springs and dampers: `solref` gives their time constant tau, by default 20 ms.
A body that arrives at the floor with v m/s sinks as a critically damped spring does,

    depth(t) = v t exp(-t / tau),   at most v tau / e   (7 mm at 1 m/s),

and is back at a tenth of that after five time constants. A simulated clip shows this; it is the
model's doing, no mistake of the clip.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.validation.analysis import Analysis
from physretarget.validation.series import FloorTouch

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Time constants after which a landing is over.
_OVER = 5.0
_DEFAULT_S = 0.02
_BLOCK = 2048


def landing_depth(analysis: Analysis, floor: FloorTouch, above: float) -> Floats:
    """(T,) m that the deepest body may have sunk by landing, where it is deeper than ``above``."""
    deep = -floor.deepest > above
    allowed = np.zeros(analysis.frames)
    bodies = floor.deepest_body
    taus = {int(body): time_constant(analysis, int(body)) for body in np.unique(bodies[deep])}
    before = math.ceil(_OVER * max(taus.values(), default=0.0) * analysis.fps) + 1
    near = deep.copy()
    for k in range(1, min(before, len(deep) - 1) + 1):
        near[:-k] |= deep[k:]
    needed = np.flatnonzero(near)
    for start in range(0, analysis.frames if deep.any() else 0, _BLOCK):
        stop = min(start + _BLOCK, analysis.frames)
        begin = max(0, start - before)
        rows = needed[(needed >= begin) & (needed < stop)]
        if len(rows) == 0:
            continue
        poses = analysis.poses(begin, stop)[rows - begin]
        pose = kinematics.forward(analysis.character.tree, poses)
        for body, tau in taus.items():
            mine = start + np.flatnonzero((deep & (bodies == body))[start:stop])
            speed = _fastest(analysis, pose, body, rows - begin, stop - begin)
            frames = math.ceil(_OVER * tau * analysis.fps) + 2
            padded = np.r_[np.zeros(frames - 1), speed]
            window = np.lib.stride_tricks.sliding_window_view(padded, frames)[mine - begin]
            allowed[mine] = window.max(axis=1, initial=0.0) * tau / math.e
    return allowed


def _fastest(
    analysis: Analysis, pose: kinematics.Pose, body: int, rows: Ints, frames: int
) -> Floats:
    """(frames,) m/s at which a body comes down to each frame; 0 where it was not looked at.

    ``pose`` is that of ``rows``.
    """
    work = analysis.work
    height = np.full(frames, np.nan)
    height[rows] = work.points.of_body(body).heights(pose).min(axis=1)
    down: Floats = np.nan_to_num(np.maximum(-np.diff(height, prepend=np.nan), 0.0)) * analysis.fps
    return down


def time_constant(analysis: Analysis, body: int) -> float:
    """Seconds of the softest contact between a body's geoms and the floor, MuJoCo's mixture."""
    model = analysis.character.model
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    own = np.flatnonzero(solid & (model.geom_bodyid == body))
    plane = (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid == 0)
    tau = max((_constant(model.geom_solref[g]) for g in own), default=_DEFAULT_S)
    if plane.any():
        floor = max(_constant(model.geom_solref[g]) for g in np.flatnonzero(plane))
        tau = 0.5 * (tau + floor)
    return max(tau, 2 * float(model.opt.timestep))


def _constant(solref: Floats) -> float:
    """1 / omega of (time constant, damping ratio), or of (-stiffness, -damping)."""
    if solref[0] > 0:
        return float(solref[0] * max(solref[1], 0.0))
    return 1 / math.sqrt(max(-float(solref[0]), 1e-6))
