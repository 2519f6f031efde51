"""The ground's wrench shared between two feet: force, centre of pressure and free moment each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d
from scipy.optimize import nnls

from physretarget import kinematics
from physretarget.capture.actor import SEGMENT, ActorMotion
from physretarget.contact import Phases
from physretarget.kinematics import runs
from physretarget.kinetics.wrench import GroundWrench
from physretarget.mjcf import smoothed

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SIDES = ("left", "right")
_HEEL_WIDTH, _BALL_WIDTH = 0.035, 0.052
"""Half widths of a shoe's sole at heel and ball, m at a stature of 1.75 m."""
_TOES = 0.055
"""From the ball to the tip of the toes, as the actor's looks have it, m at 1.75 m."""
_LOADING = 0.12  # s: double support of a walk, in which load passes from foot to foot
_RAISED = 0.06  # m: a foot that stands higher stands on something
_EVEN = 0.02  # m: how far the centre of pressure may stray for an evener load


@dataclass(frozen=True, kw_only=True, eq=False)
class FootForce:
    """What the ground applies to one foot, world axes, z up.

    ``force`` (T, 3) N at ``point`` (T, 3) m, the centre of pressure; ``torque`` (T, 3) N m, the
    free moment about the vertical through it. Without load the point is the middle of the sole.
    """

    force: Floats
    point: Floats
    torque: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Shared:
    """``left``, ``right``, and ``outside`` (T,) m: how far the wanted centre of pressure lies
    beside what the soles that touch can reach.
    """

    left: FootForce
    right: FootForce
    outside: Floats


def shared(motion: ActorMotion, wrench: GroundWrench, hz: float | None) -> Shared:
    """Share the wrench between the soles that touch.

    Points of the soles push, and none pulls: of all loads that give the vertical force and its
    centre of pressure the evenest is taken (least squares), where points that have just
    touched, or are about to leave, count little. A filter's reach is undone: force in frames
    without contact goes back to the stances beside.

    Force along the floor passes along each leg, from the centre of pressure to the hip, as far
    as the sum allows; what is left of it, and the free moment, follow the load.
    """
    active = wrench.phases.active
    force, moment = wrench.force, wrench.moment
    touching: Bools = np.asarray(active.any(axis=1))
    if hz is not None:
        force, moment = (_into_contact(v, touching, motion.fps, hz) for v in (force, moment))
    points, trust = _soles(motion, wrench.phases)
    count = points.shape[1] // 2
    load = np.zeros(points.shape[:2])
    level = _level(points, trust)
    outside = np.zeros(len(force))
    for t in np.flatnonzero((trust > 0).any(axis=1) & (force[:, 2] > 0)):
        down = np.array([0.0, 0.0, level[t] - wrench.com[t, 2]])
        tilt = moment[t] - np.cross(down, force[t])  # about the point below the centre of mass
        centre = np.array([-tilt[1], tilt[0]]) / force[t, 2]
        arms = points[t, :, :2] - wrench.com[t, :2]
        load[t] = _pushed(force[t, 2], centre, arms, trust[t])
        outside[t] = np.linalg.norm(load[t] @ arms / force[t, 2] - centre)
    both = []
    for side in range(2):
        some = slice(side * count, (side + 1) * count)
        both.append(_centre(load[:, some], points[:, some], level))
    vertical = np.stack([load[:, :count].sum(axis=1), load[:, count:].sum(axis=1)], axis=1)
    hips = _hips(motion)
    left, right = _along(force, moment, wrench.com, vertical, np.stack(both, axis=1), hips)
    return Shared(left=left, right=right, outside=outside)


def _pushed(total: float, centre: Floats, arms: Floats, trust: Floats) -> Floats:
    """Loads (n,) N, none negative, with their sum and as near as can be to their centre."""
    on = np.flatnonzero(trust > 0)
    even = _EVEN / np.sqrt(trust[on])
    rows = np.vstack([np.ones(len(on)) * 1e2, arms[on].T, np.diag(even)])
    wanted = np.concatenate([[1e2], centre, np.zeros(len(on))])
    share, _ = nnls(rows, wanted)
    load = np.zeros(len(trust))
    load[on] = total * share / max(float(share.sum()), 1e-9)
    return load


def _centre(load: Floats, points: Floats, level: Floats) -> Floats:
    """(T, 3) centre of pressure, the middle of the sole where nothing loads it."""
    total = load.sum(axis=1, keepdims=True)
    middle = points.mean(axis=1)
    centre = np.where(
        total > 0, np.einsum("tn,tnc->tc", load, points) / np.maximum(total, 1e-9), middle
    )
    centre[:, 2] = level
    return np.asarray(centre)


def _along(
    force: Floats, moment: Floats, com: Floats, vertical: Floats, centre: Floats, hips: Floats
) -> tuple[FootForce, FootForce]:
    """Forces along the floor and free moments of both feet, given load (T, 2) and centre."""
    arm = centre - com[:, None]  # (T, 2, 3)
    total = vertical.sum(axis=1, keepdims=True)
    share = vertical / np.maximum(total, 1e-9)
    each = np.zeros_like(arm)
    each[..., 2] = vertical
    leg = hips - centre
    each[..., :2] = vertical[..., None] * leg[..., :2] / np.maximum(leg[..., 2:], 0.2)
    rest = np.where(total > 0, force[:, :2] - each[..., :2].sum(axis=1), 0.0)
    each[..., :2] += share[..., None] * rest[:, None]
    spin = moment[:, 2] - np.cross(arm, each)[..., 2].sum(axis=1)
    torque = np.zeros_like(each)
    torque[..., 2] = share * spin[:, None]
    left, right = (
        FootForce(force=each[:, i], point=centre[:, i], torque=torque[:, i]) for i in range(2)
    )
    return left, right


def _into_contact(values: Floats, touching: Bools, fps: float, hz: float) -> Floats:
    """Values (T, n) with what a filter has carried out of contact brought back into it.

    Every frame without contact gives what it has to the frames with contact around it, by the
    filter's own response: sums over time, and so impulses, stay.
    """
    if touching.all() or not touching.any():
        return values
    reach = int(np.ceil(2 * fps / hz))
    impulse = np.zeros(2 * reach + 1)
    impulse[reach] = 1.0
    response = np.abs(smoothed(impulse, fps, hz)) + 1e-9

    room = convolve1d(touching.astype(np.float64), response, mode="constant")
    reached = ~touching & (room > 1e-6)
    given = np.where(reached[:, None], values / np.maximum(room, 1e-9)[:, None], 0.0)
    back = convolve1d(given, response, axis=0, mode="constant")
    brought: Floats = np.where(touching[:, None], values + back, 0.0)
    return brought


def _soles(motion: ActorMotion, phases: Phases) -> tuple[Floats, Floats]:
    """Points (T, 2 n, 3) of the left and the right sole, and how far each may be loaded (0 to 1).

    Heel and ball, each two points as wide as a foot, and the tip of the toes.
    """
    tree, shape = motion.shape.tree(), motion.shape
    pose = kinematics.forward(tree, motion.qpos)
    size = shape.height / 1.75
    points, trust = [], []
    for index, side in enumerate(SIDES):
        foot = SEGMENT[f"{side}_foot"]
        heel, ball = shape.heel[index], shape.tip[foot]
        forward = (ball - heel) / max(float(np.linalg.norm(ball - heel)), 1e-9)
        across = np.cross([0.0, 0.0, 1.0], forward)
        local = np.array(
            [
                *(heel + s * _HEEL_WIDTH * size * across for s in (-1.0, 1.0)),
                *(ball + s * _BALL_WIDTH * size * across for s in (-1.0, 1.0)),
                ball + _TOES * size * forward,
            ]
        )
        segment = np.full(len(local), foot + 1)
        points.append(kinematics.points(pose, segment, local))
        ready = [_loading(phases.of(f"{side}_{part}"), motion.time) for part in ("heel", "toe")]
        trust.append(np.stack([ready[0], ready[0], ready[1], ready[1], ready[1]], axis=1))
    return np.concatenate(points, axis=1), np.concatenate(trust, axis=1)


def _loading(active: Bools, time: Floats) -> Floats:
    """(T,) from 0 to 1 within ``_LOADING`` of touch-down, and back before lift-off."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    ready = np.zeros(len(time))
    for first, last in runs(active):
        inside = slice(first, last + 1)
        since = time[inside] - time[first] if first > 0 else np.full(last - first + 1, _LOADING)
        until = (
            time[last] - time[inside]
            if last < len(time) - 1
            else np.full(last - first + 1, _LOADING)
        )
        ready[inside] = np.clip((np.minimum(since, until) + step) / _LOADING, 1e-3, 1.0) ** 2
    return ready


def _hips(motion: ActorMotion) -> Floats:
    """(T, 2, 3) m, left and right hip joint."""
    pose = kinematics.forward(motion.shape.tree(), motion.qpos)
    thighs = [SEGMENT[f"{side}_thigh"] + 1 for side in SIDES]
    return np.asarray(pose.position[:, thighs])


def _level(points: Floats, trust: Floats) -> Floats:
    """(T,) height of what the feet stand on: the floor, or a box."""
    bearing = trust > 0
    lowest = np.where(bearing, points[..., 2], np.inf).min(axis=1)
    return np.where(np.isfinite(lowest) & (lowest > _RAISED), lowest, 0.0)
