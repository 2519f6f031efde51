"""Loaded bodies that move along the floor, and the forces that are drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.ground.contacts import Contacts
from physretarget.ground.support import Support, speeds
from physretarget.kinematics import Pose

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

# Sliding counts of bodies that bear more than this share of body weight and of all that is borne.
LOADED_BW, LOADED_SHARE = 0.1, 0.25
_ARROWS = 4
# A point that rises or sinks more than this per way along the floor, and more than the noise of
# captures, does not slide: it lands or lifts, or rolls on to the next.
_STEEP, _UNEVEN_M = 0.25, 0.002
# Sliding is seen over this long, or a frame where that is longer: a limit on height makes sense
# only beside a time, and a clip of 120 frames/s must slide like one of 30.
SLIDE_SPAN_S = 1 / 30


@dataclass(frozen=True, eq=False)
class Skate:
    """Sliding of loaded bodies.

    Attributes:
        speed: (T,) m/s of the fastest; a body is as fast as its slowest loaded point.
        free: (T,) m/s, the part of it that friction does not brake.
        body: (T,) which body that is.
    """

    speed: Floats
    free: Floats
    body: Ints


@dataclass(frozen=True, eq=False)
class Arrows:
    """The four largest forces on bodies, to be drawn; zero where fewer bodies bear load.

    Attributes:
        origin: (T, 4, 3) m, where they act.
        force: (T, 4, 3) BW.
    """

    origin: Floats
    force: Floats


def sliding(
    contacts: Contacts, here: Pose, poses: tuple[Pose, ...], start: int, step: float
) -> Floats:
    """(T, n, 2) tangential velocity of points between frames in both of which they touch, m/s.

    A point slides from one frame to the next only if that material point is within ``near`` (m)
    of the floor in both, and stays at its height. Where it does before and after, the slower
    counts: a force shows in a frame that acted on either side. So differences are one-sided where a
    contact begins or ends, no flight is taken for sliding, and a contact of one frame does not
    slide. ``poses`` are the clip as filtered and as given: what only one of them shows is the
    filter's, or noise, and the slower counts.
    """
    row, column = np.nonzero(contacts.mask)
    body = contacts.body[row, column]
    arm = contacts.position[row, column] - here.position[row, body]
    local = np.einsum("pij,pi->pj", here.rotation[row, body], arm)
    slowest: Floats | None = None
    for pose in poses:
        velocity = _one_sided(
            contacts.floor, pose, row + start, body, local, step, contacts.tolerance
        )
        if slowest is not None:
            faster = speeds(velocity) > speeds(slowest)
            velocity = np.where(faster[:, None], slowest, velocity)
        slowest = velocity
    assert slowest is not None
    sliding = np.zeros((*contacts.body.shape, 2))
    sliding[row, column] = slowest
    return sliding


def _one_sided(
    floor: float,
    pose: Pose,
    frame: Ints,
    body: Ints,
    local: Floats,
    step: float,
    near: float,
) -> Floats:
    """(P, 2) velocities of points (P,) at ``local`` (P, 3) of bodies, each in its frame."""
    now = _place(pose, frame, body, local)
    touches = now[:, 2] - floor < near
    slower = np.full((len(frame), 2), np.inf)
    span = max(1, round(SLIDE_SPAN_S / step))
    for side in (-1, 1):
        other = np.clip(frame + side * span, 0, len(pose.position) - 1)
        then = _place(pose, other, body, local)
        moved = then - now
        along = np.hypot(moved[:, 0], moved[:, 1])
        level = np.abs(moved[:, 2]) <= _STEEP * along + _UNEVEN_M
        both = touches & (other != frame) & (then[:, 2] - floor < near) & level
        less = both & (along < np.hypot(slower[:, 0], slower[:, 1]))
        slower[less] = side * moved[less, :2]
    velocity: Floats = np.where(np.isfinite(slower), slower, 0.0) / (span * step)
    return velocity


def _place(pose: Pose, frame: Ints, body: Ints, local: Floats) -> Floats:
    place: Floats = np.einsum("pij,pj->pi", pose.rotation[frame, body], local)
    place += pose.position[frame, body]
    return place


def skate(support: Support, force: Floats, free: Bools) -> Skate:
    """Sliding of loaded bodies.

    A body slides as fast as its slowest loaded point, so that rolling over the toes or turning
    about the heel is no sliding. Bodies that slide must together bear enough. In frames that are
    not ``free`` (T,) friction brakes them: a body that skids to a halt with its force on the edge
    of the cone, against the motion, does what physics asks of it.
    """
    speed = speeds(support.velocity)
    total = force[..., 2].sum(axis=1)
    loads, slides = (np.zeros((len(force), len(support.bodies))) for _ in range(2))
    for k, candidate in enumerate(support.bodies):
        mine = support.own & (support.body == candidate)
        normal = np.where(mine, force[..., 2], 0.0)
        loads[:, k] = load = normal.sum(axis=1)
        bearing = mine & (normal > 0.01 * load[:, None])
        slowest = np.where(bearing, speed, np.inf).min(axis=1, initial=np.inf)
        slides[:, k] = np.where(np.isfinite(slowest), slowest, 0.0)
    enough = np.maximum(LOADED_BW, LOADED_SHARE * total)
    worst, column = _fastest_bearing(slides, loads, enough)
    body = support.bodies[column] if len(support.bodies) else np.zeros(len(force), dtype=np.int64)
    return Skate(worst, np.where(free, worst, 0.0), np.where(worst > 0, body, 0))


def _fastest_bearing(speed: Floats, load: Floats, enough: Floats) -> tuple[Floats, Ints]:
    """(T,) the highest speed that bodies (T, B) reach which together bear ``enough`` (T,), and
    the column of the body that has it.

    One foot that bears a quarter of the weight, or four of a snake's links with a tenth each.
    """
    if speed.shape[1] == 0:
        return np.zeros(len(speed)), np.zeros(len(speed), dtype=np.int64)
    order = np.argsort(-speed, axis=1, kind="stable")
    rows = np.arange(len(speed))
    borne = np.cumsum(np.take_along_axis(load, order, axis=1), axis=1)
    reached = borne > enough[:, None]
    column = order[rows, reached.argmax(axis=1)]
    return np.where(reached.any(axis=1), speed[rows, column], 0.0), column


def arrows(support: Support, force: Floats) -> Arrows:
    """The four largest of the contact forces (T, n, 3) BW at ``support``, summed per body."""
    frames = len(force)
    place = np.zeros((frames, max(len(support.bodies), _ARROWS), 3))
    size = np.zeros_like(place)
    for k, body in enumerate(support.bodies):
        own = np.where((support.mask & (support.body == body))[..., None], force, 0.0)
        size[:, k] = own.sum(axis=1)
        load = own[..., 2]
        total = load.sum(axis=1, keepdims=True)
        share = load / np.where(total > 0, total, 1.0)
        place[:, k] = np.einsum("tn,tni->ti", share, support.position)
    order = np.argsort(-size[..., 2], axis=1, kind="stable")[:, :_ARROWS]
    rows = np.arange(frames)[:, None]
    return Arrows(place[rows, order], size[rows, order])
