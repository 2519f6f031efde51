"""The stage: a clip in, the clip that the floor can bear out, window by window."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from physretarget import kinematics
from physretarget.contact.carry import joint_weights
from physretarget.errors import InputError
from physretarget.ground.undersides import lowest_heights, solids
from physretarget.ground.wrench import external_wrench
from physretarget.keyposes.face import face_of
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character
from physretarget.wholebody.problem import Window
from physretarget.wholebody.settings import WholeBodySettings
from physretarget.wholebody.solve import solve
from physretarget.wholebody.support import (
    CHUNK,
    Support,
    completed_stances,
    firmness,
    residual,
    support_of,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

FEWEST = 5
"""Frames below which there is nothing to mend."""
CONTEXT = 2
"""Frames that differences reach beyond what moves."""
SLACK, DEEPEST = 1e-3, 8e-3
"""A part of the body may sink by so much (m) below where the clip has it, and so deep into the
floor: with room to the centimetre that a reproduction allows."""


@dataclass(frozen=True, eq=False)
class WholeBody:
    """A clip that the floor can bear. T frames.

    ``qpos`` (T, nq); ``active`` (T, P) contact points that stand, completed by rigid body;
    ``moved`` (T,) m, RMS displacement of the markers. ``unexplained_before`` and
    ``unexplained_after`` (T,): length of the wrench that no force in the friction cones of the
    support explains, in body weights (moments over the height of the centre of mass). ``status`` of
    the search, its ``iterations`` in all, ``seconds`` of wall time.
    """

    qpos: Array
    active: Flags
    moved: Array
    unexplained_before: Array
    unexplained_after: Array
    status: str
    iterations: int
    seconds: float
    notes: tuple[str, ...] = ()


def balance(
    character: Character,
    qpos: Array,
    time: Array,
    active: Flags,
    *,
    settings: WholeBodySettings | None = None,
    keep: Flags | None = None,
    strength: float = 1.0,
) -> WholeBody:
    """Move a clip qpos (T, nq) as little as possible so that the floor can bear it.

    ``active`` (T, P): contact points that stand; they stay where they are. A clip that the
    floor explains already comes back as it was. ``keep`` (T,): frames that stay as they are, and
    around which the others are moved; ``strength``: how much of the move that is found is made.

    Raises:
        InputError: the character has no free root, or ``active`` does not fit.
        SolverError: a step has no solution.
    """
    began = clock.perf_counter()
    settings = settings or WholeBodySettings()
    _check(character, qpos, active)
    stands = completed_stances(character, active)
    still = np.zeros(len(qpos))
    if len(qpos) < FEWEST or not len(character.contacts):
        return WholeBody(qpos, stands, still, still, still, "nothing to mend", 0, 0.0)
    support = support_of(character, qpos, stands, settings)
    before = unexplained(character, qpos, time, support)
    contacts = character.contacts
    place = kinematics.trajectories(character.tree, qpos, contacts.body, contacts.local)
    held = Held(contacts.body, contacts.local, place, stands, sunk=True)
    moved, iterations, status = settle(character, qpos, time, held, support, before, settings, keep)
    if strength != 1.0:
        tree = character.tree
        change = kinematics.difference(tree, qpos, moved)
        moved = kinematics.integrate(tree, qpos, strength * change)
    return WholeBody(
        qpos=moved,
        active=stands,
        moved=displacement(character, qpos, moved),
        unexplained_before=before,
        unexplained_after=unexplained(character, moved, time, support) if iterations else before,
        status=status if iterations else "nothing to mend",
        iterations=iterations,
        seconds=clock.perf_counter() - began,
    )


@dataclass(frozen=True, eq=False)
class Held:
    """Points of bodies (P,) at ``local`` (P, 3) that belong to ``place`` (T, P, 3), firmly while
    they ``stand`` (T, P). ``sunk``: what the clip has in the floor may stay there."""

    body: Ints
    local: Array
    place: Array
    stand: Flags
    sunk: bool


def settle(
    character: Character,
    qpos: Array,
    time: Array,
    held: Held,
    support: Support,
    trouble: Array,
    settings: WholeBodySettings,
    keep: Flags | None = None,
) -> tuple[Array, int, str]:
    """The clip moved near frames of more than quiet ``trouble`` (T,), iterations and status."""
    if keep is not None:
        trouble = np.where(keep, 0.0, trouble)
    moved, iterations, status = qpos.copy(), 0, "converged"
    for window in _windows(time, trouble, settings):
        task = _task(character, qpos, time, held, support, window, settings)
        if keep is not None:
            task = replace(task, fixed=task.fixed | keep[window.seen])
            if task.fixed.all():
                continue
        outcome = solve(task, moved[window.seen])
        moved[window.seen][~task.fixed] = outcome.state.qpos[~task.fixed]
        iterations += outcome.iterations
        status = outcome.status if outcome.status != "converged" else status
    return _within_limits(character, qpos, moved), iterations, status


def unexplained(character: Character, qpos: Array, time: Array, support: Support) -> Array:
    """(T,) length of the wrench that no force at the support explains, BW."""
    step, frames = float(time[-1] - time[0]) / (len(time) - 1), len(qpos)
    length = np.empty(frames)
    for at in range(0, frames, CHUNK):
        first, last = at, min(at + CHUNK, frames)
        seen = slice(max(min(first, frames - 2) - 1, 0), min(max(last, 2) + 1, frames))
        pose = kinematics.forward(character.tree, qpos[seen])
        required = external_wrench(character, pose, step)
        wrench = np.concatenate([required.force, required.moment], axis=1)
        rest, _ = residual(support.of(seen), required.com, wrench, character.com_height)
        length[first:last] = np.linalg.norm(rest, axis=1)[first - seen.start :][: last - first]
    return length


def _check(character: Character, qpos: Array, active: Flags) -> None:
    if not character.has_root:
        raise InputError(f"{character.name} has no free root joint; it cannot lose its balance.")
    if active.shape != (len(qpos), len(character.contacts)):
        raise InputError(
            f"contact phases have shape {active.shape}, "
            f"not ({len(qpos)}, {len(character.contacts)}) as needed"
        )


@dataclass(frozen=True)
class _Window:
    """Frames ``seen`` at once, of which ``free`` ones move: what comes before is done, and what
    comes after the next window's first frame is solved again with that."""

    seen: slice
    free: slice


def _windows(time: Array, left: Array, settings: WholeBodySettings) -> list[_Window]:
    """Parts of the clip near something unexplained, ``left`` (T,)."""
    frames, step = len(time), float(time[-1] - time[0]) / (len(time) - 1)
    size = max(round(settings.window / step), 2 * FEWEST)
    more = max(round(settings.overlap / step), FEWEST)
    near = np.zeros(frames, dtype=bool)
    if (left > settings.quiet).any():
        near = distance_transform_edt(left <= settings.quiet) <= more
    edges = np.flatnonzero(np.diff(np.concatenate(([0], near.astype(np.int8), [0]))))
    found = []
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        count = max(1, round((end - begin) / size))
        cuts = np.linspace(begin, end, count + 1).round().astype(int).tolist()
        for first, last in pairwise(cuts):
            after = min(last + more, end)
            seen = slice(max(first - CONTEXT, 0), min(after + CONTEXT, frames))
            found.append(_Window(seen, slice(first, after)))
    return found


def whole_window(
    character: Character, qpos: Array, time: Array, stands: Flags, settings: WholeBodySettings
) -> Window:
    """A clip as one window in which all frames move."""
    contacts = character.contacts
    place = kinematics.trajectories(character.tree, qpos, contacts.body, contacts.local)
    held = Held(contacts.body, contacts.local, place, stands, sunk=True)
    support = support_of(character, qpos, stands, settings)
    every = slice(0, len(qpos))
    return _task(character, qpos, time, held, support, _Window(every, every), settings)


def _task(
    character: Character,
    qpos: Array,
    time: Array,
    held: Held,
    support: Support,
    window: _Window,
    settings: WholeBodySettings,
) -> Window:
    """What the solver needs to know of a window."""
    part = window.seen
    poses, markers, tree = qpos[part], character.markers, character.tree
    step = float(time[-1] - time[0]) / (len(time) - 1)
    pose = kinematics.forward(tree, poses)
    body = np.concatenate([markers.body, held.body])
    local = np.concatenate([markers.local, held.local])
    place = held.place[part]
    target = np.concatenate([kinematics.points(pose, markers.body, markers.local), place], axis=1)
    height = (place[..., 2] - character.floor_height) / character.height
    firm = firmness(held.stand[part], height, step, settings)
    ones = np.ones((len(poses), len(markers)))
    metric = kinematics.stiffness(tree, poses, pose, markers.body, markers.local, ones)
    joint = joint_weights(character, settings.joint)
    index = np.arange(tree.nv)
    metric[:, index, index] += joint
    root = character.root_dof + np.arange(3, 6)
    metric[:, root, root] += settings.turn * character.height**2
    size = len(markers) * character.height**2
    shapes = solids(character)
    low, floor = lowest_heights(shapes, pose), character.floor_height
    if not held.sunk:
        low = np.full_like(low, floor)
    face = face_of(character)
    looks = (character.root_body, character.front) if face is None else (face[0], face[2])
    frame = np.arange(part.start, part.stop)
    share = np.ones(len(frame))
    share[0], share[-1] = part.start == 0, part.stop == len(qpos)
    tau = np.sqrt(character.com_height * character.mass / character.weight)
    middle = 0.5 * (time[part][1:] + time[part][:-1])
    since = np.minimum(middle - time[0], time[-1] - middle)
    return Window(
        character=character,
        settings=settings,
        original=poses,
        time=time[part],
        fixed=(frame < window.free.start) | (frame >= window.free.stop),
        targets=PointTargets(body, local, target, np.concatenate([ones, firm], axis=1)),
        support=support.of(part),
        metric=metric / size,
        joint=joint / size,
        solids=shapes,
        deepest=np.minimum(low, np.maximum(np.minimum(low, floor) - SLACK, floor - DEEPEST)),
        face=looks,
        gaze=pose.rotation[:, looks[0]] @ looks[1],
        share=share,
        slowness=settings.velocity + settings.ends * np.exp(-((since / tau) ** 2)),
    )


def _within_limits(character: Character, before: Array, moved: Array) -> Array:
    """The clip ``moved``, no joint farther beyond its range than in ``before``."""
    at = character.tree.scalars[0]
    within = moved.copy()
    lower, upper = character.lower[at], character.upper[at]
    within[:, at] = np.clip(
        moved[:, at], np.minimum(lower, before[:, at]), np.maximum(upper, before[:, at])
    )
    return within


def displacement(character: Character, before: Array, after: Array) -> Array:
    """(T,) RMS displacement of the markers, m."""
    markers = character.markers
    one, other = (
        kinematics.trajectories(character.tree, qpos, markers.body, markers.local)
        for qpos in (before, after)
    )
    distance: Array = np.sqrt(np.mean(np.sum((other - one) ** 2, axis=-1), axis=1))
    return distance
