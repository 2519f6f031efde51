"""The stage: measure what the motion requires, ask the programme, move the joints, again."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import binary_dilation, distance_transform_edt, gaussian_filter1d

from physretarget import kinematics
from physretarget.balance.follow import followed, raised
from physretarget.balance.hold import CHUNK, Hold, held
from physretarget.balance.metric import metric
from physretarget.balance.settings import BalanceSettings
from physretarget.errors import InputError
from physretarget.mjcf import Character
from physretarget.mjcf.dynamics import derivatives, required_wrench
from physretarget.ocp.balance import Programme, Support, minimise, unexplained
from physretarget.ocp.basis import differences

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

FEWEST = 5
"""Frames below which there is nothing to balance."""
TOUCHED = 1e-6
"""Changes below this (rad or m) in all joints of a frame are none."""
EDGE, PINNED = 2, 1e2
"""Where the clip goes on as it was, so many frames are so much dearer to move."""
BETTER = 0.99
"""A round is taken if it leaves less than this share of what the best before it left."""
SPREAD = 3.0
"""Frames over which a joint's stop fades in and out."""


@dataclass(frozen=True, eq=False)
class Balanced:
    """A clip led to where the floor can bear it. T frames.

    ``qpos`` (T, nq); ``moved`` (T,) m, RMS displacement of the markers; ``shift`` (T, 3) m of
    the centre of mass. ``unexplained_before`` and ``unexplained_after`` (T,): length of the
    wrench that no force in the friction cones of the contact points explains, in body weights
    (moments over the height of the centre of mass). ``rounds`` taken, ``seconds`` of wall time.
    """

    qpos: Array
    moved: Array
    shift: Array
    unexplained_before: Array
    unexplained_after: Array
    rounds: int
    seconds: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Task:
    """What stays the same from round to round."""

    character: Character
    original: Array
    time: Array
    step: float
    hold: Hold
    place: Array  # (T, P, 3) where a contact point bears load: at its nearest stance
    on: Flags  # (T, P) may bear load
    second: sparse.csr_array  # (T, T) times τ²
    first: sparse.csr_array  # (T, T) times τ, fading from both ends
    settings: BalanceSettings


@dataclass(frozen=True)
class _Window:
    """Frames ``core`` that are taken from what is solved over ``part``.

    ``joined``: whether the clip goes on, as it was, before the part and after it.
    """

    core: slice
    part: slice
    joined: tuple[bool, bool]


def balance(
    character: Character,
    qpos: Array,
    time: Array,
    active: Flags,
    *,
    settings: BalanceSettings | None = None,
) -> Balanced:
    """Move a clip qpos (T, nq) as little as possible so that the floor can bear it.

    ``active`` (T, P): contact points that stand; they stay where they are. A clip that the
    floor explains already comes back as it was.

    Raises:
        InputError: the character has no free root, or ``active`` does not fit.
        SolverError: a convex programme fails.
    """
    began = clock.perf_counter()
    settings = settings or BalanceSettings()
    _check(character, qpos, active)
    still = np.zeros(len(qpos))
    if len(qpos) < FEWEST or not len(character.contacts):
        return Balanced(qpos, still, np.zeros((len(qpos), 3)), still, still, 0, 0.0)
    task = _task(character, qpos, time, active, settings)
    wrench, com = _required(task, qpos)
    before = _unexplained(task, wrench, com)
    if before.max() <= settings.quiet:
        spent = clock.perf_counter() - began
        return Balanced(qpos, still, np.zeros((len(qpos), 3)), before, before, 0, spent)
    windows = _windows(task, before)
    best, found = qpos, _worth(before, settings)
    after, centre, start = before, com, com
    moved, patience = qpos, np.ones(len(qpos))
    stops = np.zeros((len(qpos), character.tree.nv))
    for turn in range(settings.rounds):
        moved, patience, stops = _round(
            task, windows, moved, wrench, patience, stops, first=turn == 0
        )
        wrench, com = _required(task, moved)
        left = _unexplained(task, wrench, com)
        if (worth := _worth(left, settings)) < BETTER * found:
            best, found, after, centre = moved, worth, left, com
        if left.max() <= settings.quiet:
            break
    return Balanced(
        qpos=best,
        moved=_displaced(character, qpos, best),
        shift=centre - start,
        unexplained_before=before,
        unexplained_after=after,
        rounds=turn + 1,
        seconds=clock.perf_counter() - began,
        notes=() if best is not qpos else ("Balance: no lean makes the clip more feasible.",),
    )


def _check(character: Character, qpos: Array, active: Flags) -> None:
    if not character.has_root:
        raise InputError(f"{character.name} has no free root joint; it cannot lose its balance.")
    if active.shape != (len(qpos), len(character.contacts)):
        raise InputError(
            f"contact phases have shape {active.shape}, "
            f"not ({len(qpos)}, {len(character.contacts)}) as needed"
        )


def _task(
    character: Character, qpos: Array, time: Array, active: Flags, settings: BalanceSettings
) -> _Task:
    step = float(time[-1] - time[0]) / (len(time) - 1)
    hold = held(character, qpos, active, step, settings)
    place = hold.place[:, : active.shape[1]].copy()
    for k in np.flatnonzero(active.any(axis=0)):
        nearest = distance_transform_edt(
            ~active[:, k], return_distances=False, return_indices=True
        )[0]
        place[:, k] = place[nearest, k]
    reach = np.ones((2 * settings.reach + 1, 1), dtype=bool)
    gravity = character.weight / character.mass
    quick = character.com_height / gravity
    rate, second = differences(len(qpos), step)
    since = np.minimum(time - time[0], time[-1] - time) / np.sqrt(quick)
    ends = sparse.diags_array(np.exp(-0.5 * since**2))
    return _Task(
        character=character,
        original=qpos,
        time=time,
        step=step,
        hold=hold,
        place=place,
        on=binary_dilation(active, reach),
        second=sparse.csr_array(second * quick),
        first=sparse.csr_array(ends @ rate * np.sqrt(quick)),
        settings=settings,
    )


def _required(task: _Task, qpos: Array) -> tuple[Array, Array]:
    """Required wrench about the centre of mass (T, 6), body weights, and that centre (T, 3)."""
    character = task.character
    found = required_wrench(character, qpos, *derivatives(character, qpos, task.time))
    moment = found.moment - np.cross(found.com - found.root, found.force)
    wrench = np.concatenate([found.force, moment / character.com_height], axis=1)
    return wrench / character.weight, found.com


def _support(task: _Task, com: Array, frames: slice, inset: float, friction: float) -> Support:
    """Where the floor pushes in some frames, pulled in by ``inset`` towards the middle."""
    on, place = task.on[frames], task.place[frames]
    middle = (
        np.where(on[..., None], place, 0.0).sum(axis=1) / np.maximum(on.sum(axis=1), 1)[:, None]
    )
    points = place + inset * (middle[:, None] - place)
    arm = (points - com[:, None]) / task.character.com_height
    return Support(arm, on, friction * task.character.friction)


def _unexplained(task: _Task, wrench: Array, com: Array) -> Array:
    """(T,) what no force at the contact points explains, with all friction there is."""
    rest: Array = np.linalg.norm(wrench, axis=1)
    for at in range(0, len(wrench), CHUNK):
        part = slice(at, at + CHUNK)
        borne = np.flatnonzero(task.on[part].any(axis=1))
        if len(borne):
            support = _support(task, com[part], part, 0.0, 1.0).of(borne)
            rest[at + borne] = unexplained(wrench[at + borne], support)
    return rest


def _worth(left: Array, settings: BalanceSettings) -> float:
    """What is unexplained, hopeless frames counted as such."""
    return float(np.minimum(left, settings.hopeless).sum())


def _windows(task: _Task, left: Array) -> list[_Window]:
    """Parts of the clip near something unexplained, ``left`` (T,), and what is solved with each.

    Neighbours overlap so far that they agree where they meet.
    """
    frames, settings = len(task.time), task.settings
    size = max(round(settings.window / task.step), 2 * FEWEST)
    more = max(round(settings.overlap / task.step), FEWEST)
    near = distance_transform_edt(left <= settings.quiet) <= more
    edges = np.flatnonzero(np.diff(np.concatenate(([0], near.astype(np.int8), [0]))))
    found = []
    for first, after in zip(edges[::2], edges[1::2], strict=True):
        count = max(1, round((after - first) / size))
        cuts = np.linspace(first, after, count + 1).round().astype(int)
        for a, b in pairwise(cuts):
            wide = slice(max(int(a) - more, int(first)), min(int(b) + more, int(after)))
            joined = (0 < wide.start == first, frames > wide.stop == after)
            found.append(_Window(slice(int(a), int(b)), wide, joined))
    return found


def _round(
    task: _Task,
    windows: list[_Window],
    qpos: Array,
    wrench: Array,
    patience: Array,
    stops: Array,
    *,
    first: bool,
) -> tuple[Array, Array, Array]:
    """One programme and one inverse kinematics: poses, patience and stops of the next round."""
    tree = task.character.tree
    since = kinematics.difference(tree, task.original, qpos)
    change, patient = -since, patience.copy()
    for window in windows:
        core, part = window.core, window.part
        step, left = _window(task, qpos, wrench, patience, stops, since, window, first=first)
        inside = slice(core.start - part.start, core.stop - part.start)
        change[core], patient[core] = step[inside], left[inside]
    wanted = kinematics.integrate(tree, qpos, change)
    some = np.concatenate([np.arange(w.core.start, w.core.stop) for w in windows])
    moved = task.original.copy()
    for begin in range(0, len(some), CHUNK):
        now = some[begin : begin + CHUNK]
        moved[now] = followed(
            task.character, task.original, wanted[now], task.hold, now, task.settings
        )
    moved = raised(task.character, task.original, moved, some, task.step)
    at, dof = tree.scalars
    stopped = np.zeros_like(stops)
    lower, upper = task.character.lower[at], task.character.upper[at]
    beyond = (wanted[:, at] < lower - TOUCHED) | (wanted[:, at] > upper + TOUCHED)
    stopped[:, dof] = gaussian_filter1d(beyond.astype(np.float64), SPREAD, axis=0)
    stops = stops + task.settings.stop * task.character.height**2 * stopped
    same = np.abs(kinematics.difference(tree, task.original, moved)).max(axis=1) < TOUCHED
    moved[same] = task.original[same]
    return moved, patient, stops


def _window(
    task: _Task,
    qpos: Array,
    wrench: Array,
    patience: Array,
    stops: Array,
    since: Array,
    window: _Window,
    *,
    first: bool,
) -> tuple[Array, Array]:
    """Change of joints (t, nv) from ``qpos`` in the frames of a window, and their patience."""
    character, settings, part = task.character, task.settings, window.part
    known = metric(character, qpos, task.hold, stops, part, settings)
    cost = known.cost.copy()
    for edge, joined in zip((slice(0, EDGE), slice(-EDGE, None)), window.joined, strict=True):
        if joined:
            cost[edge] *= PINNED
    now = np.einsum("tij,tj->ti", known.matrix, since[part])
    rows, second = _inner(task.second, part)
    support = _support(task, known.com, part, settings.inset, settings.friction).of(rows)
    patient = patience[part].copy()
    for _ in range(2 if first else 1):  # who is hopeless shows only after a first attempt
        programme = Programme(
            wrench=wrench[part][rows],
            support=support,
            patience=patient[rows],
            second=second,
            columns=rows,
            first=sparse.csr_array(task.first[part, part]),
            excursion=now,
            cost=cost,
        )
        found = minimise(programme, settings)
        left = np.linalg.norm(found.residual, axis=1)
        patient[rows] = 1.0 / (1.0 + (left / settings.hopeless) ** 2)
        if left.max(initial=0.0) < settings.hopeless / 5.0:
            break
    change = np.einsum("tij,tj->ti", known.change, found.excursion) - since[part]
    return change, patient


def _inner(second: sparse.csr_array, part: slice) -> tuple[NDArray[np.int64], sparse.csr_array]:
    """Frames of ``part`` whose second differences lie inside it, and those differences."""
    some = sparse.csr_array(second[part])
    outside = (some.indices < part.start) | (some.indices >= part.stop)
    counts = np.diff(some.indptr)
    frame = np.repeat(np.arange(len(counts)), counts)
    inner = np.setdiff1d(np.arange(len(counts)), frame[outside])
    return inner, sparse.csr_array(some[inner][:, part])


def _displaced(character: Character, before: Array, after: Array) -> Array:
    """(T,) RMS displacement of the markers, m."""
    markers = character.markers
    one, other = (
        kinematics.trajectories(character.tree, qpos, markers.body, markers.local)
        for qpos in (before, after)
    )
    distance: Array = np.sqrt(np.mean(np.sum((other - one) ** 2, axis=-1), axis=1))
    return distance
