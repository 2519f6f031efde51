"""Where forces may act to explain a frame: the touching points, and those just before or after.

A body that touches a frame or two earlier or later (see :mod:`physretarget.validation.smear`)
may bear load: differences and filter spread its force over these frames. It acts where it acted
then, with the arm about the CoM that it had then. So may further points of a body that touches
already: toes that follow the heel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import Pose
from physretarget.validation.cones import RHO, ConeFit, fit_forces
from physretarget.validation.contacts import Touch

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Series = dict[str, NDArray[np.generic]]

# Sliding counts of bodies that bear more than this share of body weight and of all that is borne.
LOADED_BW, LOADED_SHARE = 0.1, 0.25
# Sliding is braked when friction takes this share of the power that the cone allows.
BRAKED = 0.7
_ARROWS = 4
# The fit prefers resting points. The price of force grows with the square of the speed beyond
# the slowest touching point's: 1e-3 at 0.1 m/s, 0.1 at 1 m/s, where 1 would halve the force.
_PRICE_PER_SPEED2 = 0.1
_DEAREST = 1.0
# Frames of which the fit leaves more than this (BW, BW h) are looked at again for bodies that
# skid. Points whose price rose by this (0.1 m/s) count as sliding, and friction brakes them where
# it takes a third of the power that the cone allows: a blow that ends the sliding needs no more.
_WITHHELD_BW, _PRICE_OF_SLIDING, _BRAKED_BY_A_BLOW = 0.1, 1e-3, 1 / 3
_GAIN_BW = 0.05
# What touches now comes before what touched a moment ago.
_PRICE_OF_ABSENCE = 10 * RHO
# A point that rises or sinks more than this per way along the floor, and more than the noise of
# captures, does not slide.
_STEEP, _UNEVEN_M = 0.25, 0.002
# Sliding is seen over this long, or a frame where that is longer: a limit on height makes sense
# only beside a time, and a clip of 120 frames/s must slide like one of 30.
SLIDE_SPAN_S = 1 / 30
_NEVER = 1 << 40


@dataclass(frozen=True, eq=False)
class Support:
    """Points (T, n) at which force may act: position world m, ``arm`` m from the CoM, body.

    ``own`` are those that touch in the frame itself, ``mask`` adds those of neighbouring
    frames. ``late`` are those of them that are asked only where the others do not explain the
    frame. ``bodies`` (B,) are those that support in any frame.
    """

    position: Floats
    arm: Floats
    body: Ints
    mask: Bools
    own: Bools
    late: Bools
    bodies: Ints
    floor: float

    def series(self) -> Series:
        """The per-frame results that are kept."""
        return {"supported": np.asarray(self.mask.any(axis=1), dtype=np.bool_)}


def find_support(touch: Touch, com: Floats, inner: slice, reach: int) -> Support:
    """Support of the frames ``inner``; ``touch`` and ``com`` (T, 3) come with neighbours.

    Forces of a clip's first and last frame are those of their neighbours: they reach a frame more.
    """
    frames = np.arange(len(com))[inner]
    within = np.full((len(com), 1), reach)
    if inner.start == 0:
        within[0] += 1
    if inner.stop == len(com):
        within[-1] += 1
    row, column = np.nonzero(touch.mask[inner])
    found = [(row, frames[row], column, np.zeros(len(row), dtype=np.bool_))]
    neighbours = _neighbours(touch.on, within)
    for nearest in neighbours:
        for index in np.flatnonzero((nearest[inner] >= 0).any(axis=0)):
            source = nearest[inner, index]
            air = np.flatnonzero(source >= 0)
            mine = touch.mask[source[air]] & (touch.body[source[air]] == touch.bodies[index])
            row, column = np.nonzero(mine)
            found.append((air[row], source[air][row], column, np.zeros(len(row), dtype=np.bool_)))
    for which in range(len(touch.bodies)):
        closest = (neighbours[0][:, which], neighbours[1][:, which])
        found += _further(touch, com, frames, which, within[inner, 0], closest)
    row, source, column, later = (np.concatenate(part) for part in zip(*found, strict=True))
    order = np.argsort(row, kind="stable")
    row, source, column, later = row[order], source[order], column[order], later[order]
    counts = np.bincount(row, minlength=len(frames))
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    shape = (len(frames), int(counts.max(initial=0)))
    position, arm = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    body, mask, own = np.zeros(shape, dtype=np.int64), np.zeros(shape, bool), np.zeros(shape, bool)
    position[row, place] = touch.position[source, column]
    arm[row, place] = touch.position[source, column] - com[source]
    body[row, place], mask[row, place] = touch.body[source, column], True
    own[row, place] = source == frames[row]
    late = np.zeros(shape, dtype=bool)
    late[row, place] = later
    return Support(position, arm, body, mask, own, late, np.unique(body[mask]), touch.floor)


def _neighbours(on: Bools, reach: Ints) -> tuple[Ints, Ints]:
    """(T, B) the last frame before, and the first after, in which a body touches; else -1.

    -1 also where the body touches in the frame itself or not within ``reach`` (T, 1) frames.
    """
    index = np.arange(len(on))[:, None]
    before = np.maximum.accumulate(np.where(on, index, -_NEVER), axis=0)
    after = np.minimum.accumulate(np.where(on, index, _NEVER)[::-1], axis=0)[::-1]
    return (
        np.where(~on & (index - before <= reach), before, -1),
        np.where(~on & (after - index <= reach), after, -1),
    )


def _further(
    touch: Touch, com: Floats, frames: Ints, index: int, reach: Ints, nearest: tuple[Ints, Ints]
) -> list[tuple[Ints, Ints, Ints, Bools]]:
    """Points at which a body will touch, or has touched, within reach, beyond those at hand.

    A heel strikes before the toes, a box on an edge before it lies: the blow of the second contact
    is smeared like that of the first. At hand are the points of the frame itself, or of the
    ``nearest`` (T,) frames before and after in which a body in the air touches. Returns (frame,
    frame it comes from, column, late) of points that are apart from all of these, on the floor
    and as seen from the CoM: what stands has moved only as seen from the CoM, what rolls only on
    the floor.
    """
    body, on = int(touch.bodies[index]), touch.on[:, index]
    if not on.any():
        return []
    mine = touch.mask & (touch.body == body)
    number = mine.sum(axis=1)
    found: list[tuple[Ints, Ints, Ints, Bools]] = []
    steps = np.arange(1, int(reach.max(initial=0)) + 1)
    for side, near in zip((-1, 1), nearest, strict=True):
        if len(steps) == 0:
            break
        at_hand = np.where(on[frames], frames, near[frames])
        others = frames[:, None] + side * steps
        there = (others >= 0) & (others < len(com)) & (steps <= reach[:, None])
        others = np.clip(others, 0, len(com) - 1)
        counts = np.where(there, number[others], 0)
        few, any_there = number[at_hand], (counts > 0).any(axis=1) & (at_hand >= 0)
        # Of the frames in reach on one side the nearest in which most points touch. A sole that
        # stands keeps its points but for a corner, what is round has one or two.
        fullest = counts.argmax(axis=1)
        fuller = (2 * counts.max(axis=1) >= 3 * few) | (few <= 2)
        # What stands on a point or an edge may tumble on to another: the farthest frame as well.
        last = len(steps) - 1 - (counts > 0)[:, ::-1].argmax(axis=1)
        tumbles = (few <= 2) & (last != fullest)
        for pick, wanted in ((fullest, fuller), (last, tumbles)):
            source = others[np.arange(len(frames)), pick]
            rows = np.flatnonzero(any_there & wanted & (source != at_hand))
            if len(rows) == 0:
                continue
            now, then = at_hand[rows], source[rows]
            columns = np.argsort(~mine[then], axis=1, kind="stable")[:, : int(number[then].max())]
            present = np.take_along_axis(mine[then], columns, axis=1)
            apart = _apart(touch, mine, com, now, then, columns)
            row, place = np.nonzero(present & (apart > touch.tolerance))
            late = ~on[frames[rows]] | (pick is last)
            found.append((rows[row], then[row], columns[row, place], late[row]))
    return found


def _apart(touch: Touch, mine: Bools, com: Floats, now: Ints, then: Ints, columns: Ints) -> Floats:
    """(R, m) m from some points (R, m) of the frames ``then`` to the nearest of a body's points in
    the frames ``now``, in the world or as seen from the CoM, whichever is less."""
    present = np.argsort(~mine[now], axis=1, kind="stable")[:, : int(mine[now].sum(axis=1).max())]
    # Components first and frames last, which NumPy runs through fastest.
    here = np.moveaxis(touch.position[now[:, None], present], 0, -1)
    there = np.moveaxis(touch.position[then[:, None], columns], 0, -1)
    here, there = np.ascontiguousarray(here), np.ascontiguousarray(there)
    fallen = (com[then] - com[now]).T
    world = np.zeros((len(there), len(here), len(now)))
    seen = np.zeros_like(world)
    for axis in range(3):
        way = there[:, None, axis] - here[None, :, axis]
        world += way * way
        way -= fallen[axis]
        seen += way * way
    near = np.minimum(world, seen)
    absent = ~np.take_along_axis(mine[now], present, axis=1).T
    near[:, absent] = np.inf
    nearest: Floats = np.sqrt(near.min(axis=1)).T
    return nearest


def sliding(
    support: Support,
    here: Pose,
    poses: tuple[Pose, ...],
    keep: slice,
    step: float,
    near: float,
    stands: Bools | None = None,
) -> Floats:
    """(T, n, 2) tangential velocity of points between frames in both of which they touch, m/s.

    A point slides from one frame to the next only if that material point is within ``near`` (m)
    of the floor in both, and stays at its height: what moves along steeply is still landing, or
    lifting already. So differences are one-sided where a contact begins or ends, no flight is
    taken for sliding, and a contact of one frame does not slide. ``poses`` are the clip as
    filtered and as given: what only one of them shows is smear, or noise, and the slower counts.
    ``stands`` (T, nb) which bodies the clip says to stand: from a frame in which it stands to one
    in which it does not, a body has lifted.
    """
    row, column = np.nonzero(support.own)
    body = support.body[row, column]
    arm = support.position[row, column] - here.position[row, body]
    local = np.einsum("pij,pi->pj", here.rotation[row, body], arm)
    slowest: Floats | None = None
    for pose in poses:
        frame = row + np.arange(len(pose.position))[keep.start]
        velocity = _one_sided(support.floor, pose, frame, body, local, step, near, stands)
        if slowest is not None:
            faster = speeds(velocity) > speeds(slowest)
            velocity = np.where(faster[:, None], slowest, velocity)
        slowest = velocity
    assert slowest is not None
    sliding = np.zeros((*support.body.shape, 2))
    sliding[row, column] = slowest
    return sliding


def speeds(velocity: Floats) -> Floats:
    """Length of vectors (..., 2)."""
    speed: Floats = np.sqrt(velocity[..., 0] ** 2 + velocity[..., 1] ** 2)
    return speed


def _one_sided(
    floor: float,
    pose: Pose,
    frame: Ints,
    body: Ints,
    local: Floats,
    step: float,
    near: float,
    stands: Bools | None,
) -> Floats:
    """(P, 2) velocities of points (P,) at ``local`` (P, 3) of bodies, each in its frame."""
    now = _place(pose, frame, body, local)
    touches = now[:, 2] - floor < near
    total, sides = np.zeros((len(frame), 2)), np.zeros(len(frame))
    span = max(1, round(SLIDE_SPAN_S / step))
    for side in (-1, 1):
        other = np.clip(frame + side * span, 0, len(pose.position) - 1)
        then = _place(pose, other, body, local)
        moved = then - now
        along = np.hypot(moved[:, 0], moved[:, 1])
        level = np.abs(moved[:, 2]) <= _STEEP * along + _UNEVEN_M
        both = touches & (other != frame) & (then[:, 2] - floor < near) & level
        if stands is not None:
            both &= stands[frame, body] == stands[other, body]
        total += np.where(both[:, None], side * moved[:, :2], 0.0)
        sides += both
    velocity: Floats = total / (np.maximum(sides, 1) * span * step)[:, None]
    return velocity


def _place(pose: Pose, frame: Ints, body: Ints, local: Floats) -> Floats:
    place: Floats = np.einsum("pij,pj->pi", pose.rotation[frame, body], local)
    place += pose.position[frame, body]
    return place


def prices(support: Support, speed: Floats, tolerance: float) -> Floats:
    """(T, n) price of force at a point: resting points on the floor come first.

    Where several points could bear the load, the kindest reading of the clip is taken: the
    foot at rest stands, the one that passes by does not. Speed counts relative to the slowest
    point of the frame, so that a body sliding as a whole is explained like one at rest.
    """
    above = np.clip((support.position[..., 2] - support.floor) / tolerance, 0.0, 1.0)
    slowest = np.where(support.own, speed, np.inf).min(axis=1, keepdims=True, initial=np.inf)
    beyond = np.where(support.own, speed - slowest, 0.0)
    price = RHO * (1 + 9 * above**2) + _PRICE_PER_SPEED2 * beyond**2
    return np.minimum(price + np.where(support.own, 0.0, _PRICE_OF_ABSENCE), _DEAREST)


def fit_support(
    support: Support,
    wrench: Floats,
    velocity: Floats,
    *,
    friction: float,
    height: float,
    tolerance: float,
) -> ConeFit:
    """Contact forces that explain the wrench (T, 6), in BW and BW h, resting points first.

    The price of sliding withholds force from a body that lands while it slides along and another
    one is at rest. Where the frame is explained better without it, and friction brakes what slides,
    that is what physics has happen, and it is taken.
    """
    arm, speed = support.arm / height, speeds(velocity)
    dear = prices(support, speed, tolerance)
    first = support.mask & ~support.late
    fit = fit_forces(arm, first, wrench, friction=friction, rho=dear)
    cheap = prices(support, np.zeros_like(speed), tolerance)
    left = np.linalg.norm(fit.residual, axis=1)
    slides = dear - cheap > _PRICE_OF_SLIDING
    # Force at a point can lessen what is left only along this: its residual, seen at the point.
    seen = fit.residual[:, None, :3] + np.cross(fit.residual[:, None, 3:], arm)
    gain = seen[..., 2] + friction * speeds(seen)
    open_ = (slides | support.late) & support.mask & (gain > _GAIN_BW)
    again = np.flatnonzero((left > _WITHHELD_BW) & open_.any(axis=1))
    if len(again) == 0:
        return fit
    other = fit_forces(
        arm[again], support.mask[again], wrench[again], friction=friction, rho=cheap[again]
    )
    mine, along = np.where(slides[again, :, None], other.force, 0.0), velocity[again]
    power = (mine[..., :2] * along).sum(axis=(1, 2))
    most = friction * (mine[..., 2] * speed[again]).sum(axis=1)
    better = np.linalg.norm(other.residual, axis=1) < left[again]
    taken = np.flatnonzero(better & (power <= -_BRAKED_BY_A_BLOW * most))
    force, residual = fit.force.copy(), fit.residual.copy()
    force[again[taken]], residual[again[taken]] = other.force[taken], other.residual[taken]
    return replace(fit, force=force, residual=residual)


def skate(support: Support, force: Floats, velocity: Floats, friction: float) -> Series:
    """Sliding of loaded bodies: ``skate`` (T,) m/s of the fastest, and ``skate_body``.

    A body slides as fast as its slowest loaded point, so that rolling over the toes or turning
    about the heel is no sliding. Bodies that slide must together bear enough. ``skate_free`` counts
    only sliding that friction does not brake: a body that skids to a halt with its force on the
    edge of the cone, against the motion, does what physics asks of it.
    """
    speed = speeds(velocity)
    total = force[..., 2].sum(axis=1)
    loads, slides, frees = (np.zeros((len(force), len(support.bodies))) for _ in range(3))
    for k, candidate in enumerate(support.bodies):
        mine = support.own & (support.body == candidate)
        normal = np.where(mine, force[..., 2], 0.0)
        loads[:, k] = load = normal.sum(axis=1)
        bearing = mine & (normal > 0.01 * load[:, None])
        slowest = np.where(bearing, speed, np.inf).min(axis=1, initial=np.inf)
        slides[:, k] = np.where(np.isfinite(slowest), slowest, 0.0)
        power = np.where(mine[..., None], force[..., :2] * velocity, 0.0).sum(axis=(1, 2))
        most = friction * (normal * speed).sum(axis=1)
        frees[:, k] = np.where(power < -BRAKED * most, 0.0, slides[:, k])
    enough = np.maximum(LOADED_BW, LOADED_SHARE * total)
    worst, column = _fastest_bearing(slides, loads, enough)
    free, _ = _fastest_bearing(frees, loads, enough)
    body = support.bodies[column] if len(support.bodies) else np.zeros(len(force), dtype=np.int64)
    return {"skate": worst, "skate_free": free, "skate_body": np.where(worst > 0, body, 0)}


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


def arrows(support: Support, force: Floats) -> Series:
    """The four largest forces on bodies: where they act (T, 4, 3) m and their size (T, 4, 3) BW.

    Zero where fewer bodies bear load.
    """
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
    # Drawn, not computed with: single precision keeps an hour's clip small.
    return {
        "arrow_origin": place[rows, order].astype(np.float32),
        "arrow_force": size[rows, order].astype(np.float32),
    }
