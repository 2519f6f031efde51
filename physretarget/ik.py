"""Inverse kinematics: mapped features → poses of the character.

The mapper predicts where the virtual markers are in the local frame; here the joints are
found that bring them there, as weighted least squares within the joint limits (Yamane
2010, section 4.1 and 5.2 use the same for contacts). All frames are solved at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.errors import InputError
from physretarget.features import frame_of
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class IkSettings:
    """How the markers are followed.

    iterations: the most Levenberg–Marquardt steps per frame. tolerance: a frame is done when
    its step is below this (rad or m). prior: how much a joint that no marker determines is
    held to the start pose, in m² per rad² of the sum of squared marker distances.

    Features far from every key pose belong to no pose; the best fit then leaps between far
    apart ones. Around frames that leap by more than ``leap`` rad (or m) and miss their markers
    by more than ``doubt`` of the height, and around those that leap by more than ``flip`` (the
    other side of a singular shoulder), poses are chosen that follow each other:
    ``steadiness`` is what a step between frames costs, per rad², in mean squared marker
    distance over the height squared. Zero switches that off.
    """

    iterations: int = 15
    tolerance: float = 3e-4
    prior: float = 1e-6
    leap: float = 0.3
    flip: float = 0.9
    doubt: float = 0.015
    steadiness: float = 0.01


@dataclass(frozen=True, eq=False)
class IkResult:
    """Poses that follow the features.

    ``qpos`` (T, nq) with root x = y = 0 and heading 0; ``residual_rms`` (T,) m, root mean
    square distance of the markers to where the features put them.
    """

    qpos: Floats
    residual_rms: Floats


def solve(
    character: Character,
    features: Floats,
    *,
    start: Floats | None = None,
    settings: IkSettings | None = None,
) -> IkResult:
    """Find the pose of every frame of ``features``.

    Args:
        character: whose ``markers`` the features describe.
        features: (T, 3K) stacked marker coordinates in the local frame, m.
        start: (T, nq) or (nq,) where to begin, e.g. the nearest key pose; the reference pose
            if None.
        settings: defaults if None.

    Raises:
        InputError: the features have another width than the markers, or are not finite.
    """
    settings = settings or IkSettings()
    features = np.atleast_2d(np.asarray(features, dtype=np.float64))
    target = _targets(character, features)
    begin = np.array(
        np.broadcast_to(
            character.reference_qpos if start is None else start,
            (len(features), character.tree.nq),
        )
    )
    locked = np.zeros(character.tree.nv, dtype=bool)
    if character.has_root:
        # In the local frame the root stands over the origin (its height and tilt are free).
        begin[:, character.root_qpos : character.root_qpos + 2] = 0.0
        locked[character.root_dof : character.root_dof + 2] = True
    problem = _Problem(character, target, locked, settings)
    qpos, rms = problem.solved(begin, np.arange(len(begin)))
    if settings.steadiness > 0.0:
        qpos, rms = _steadied(problem, qpos, rms)
    return IkResult(continuous_qpos(character, facing_forward(character, qpos)), rms)


@dataclass(frozen=True, eq=False)
class _Problem:
    """A clip's marker targets (T, K, 3) and what must not move (nv,)."""

    character: Character
    target: Floats
    locked: NDArray[np.bool_]
    settings: IkSettings

    def solved(
        self,
        start: Floats,
        frames: Ints,
        *,
        prior: Floats | None = None,
        weight: float = 0.0,
        iterations: int | None = None,
    ) -> tuple[Floats, Floats]:
        """Poses (n, nq) of some frames and their residual (n,), held to ``prior`` by ``weight``."""
        character = self.character
        markers = character.markers
        found = kinematics.solve(
            character.tree,
            start,
            [PointTargets(markers.body, markers.local, self.target[frames])],
            lower=character.lower,
            upper=character.upper,
            locked=self.locked,
            prior=prior,
            prior_weight=self.settings.prior + weight,
            iterations=iterations or self.settings.iterations,
            tolerance=self.settings.tolerance,
        )
        return found.qpos, np.sqrt(np.mean(found.residual**2, axis=1))


REACH = 8
"""Frames to each side of a leap that are reconsidered."""


def _steadied(problem: _Problem, qpos: Floats, rms: Floats) -> tuple[Floats, Floats]:
    """Poses that follow each other where the best fits leap, and their residuals.

    From each leap on the pose before it is followed onwards and the one after it backwards;
    of the best fits and these two the path with the least cost is found by dynamic programming
    and then smoothed.
    """
    character, settings = problem.character, problem.settings
    leap = np.abs(kinematics.difference(character.tree, qpos[:-1], qpos[1:])).max(axis=1)
    doubtful = rms > settings.doubt * character.height
    near = (leap > settings.leap) & (doubtful[:-1] | doubtful[1:])
    leaps = np.flatnonzero(near | (leap > settings.flip))
    if not len(leaps):
        return qpos, rms
    reach = leaps[:, None] + np.arange(1 - REACH, REACH + 1)
    frames = np.unique(np.clip(reach, 0, len(qpos) - 1))
    tried = [(qpos, rms), *_swept(problem, qpos, leaps)]
    choices = np.stack([t[0][frames] for t in tried], axis=1)  # (n, candidates, nq)
    misses = np.stack([t[1][frames] for t in tried], axis=1)
    price = settings.steadiness * character.height**2
    best = _cheapest_path(character, frames, choices, misses, price)
    qpos, rms = qpos.copy(), rms.copy()
    each = np.arange(len(frames))
    qpos[frames], rms[frames] = choices[each, best], misses[each, best]
    inner = frames[(frames > 0) & (frames < len(qpos) - 1)]
    weight = 2.0 * price * problem.target.shape[1]  # the solver's cost sums over markers
    for _ in range(4):
        before, after = qpos[inner - 1], qpos[inner + 1]
        half = 0.5 * kinematics.difference(character.tree, before, after)
        between = kinematics.integrate(character.tree, before, half)
        qpos[inner], rms[inner] = problem.solved(
            qpos[inner], inner, prior=between, weight=weight, iterations=4
        )
    return qpos, rms


def _swept(problem: _Problem, qpos: Floats, leaps: Ints) -> list[tuple[Floats, Floats]]:
    """Poses followed frame by frame across each leap, onwards and backwards, with residuals.

    A step costs what it costs on the path that is sought. Frames that are not reached have
    residual infinity; where two leaps reach a frame the nearer one has it.
    """
    weight = problem.settings.steadiness * problem.character.height**2 * problem.target.shape[1]
    swept = [(qpos.copy(), np.full(len(qpos), np.inf)) for _ in range(2)]
    at = np.concatenate([leaps, leaps + 1])
    way = np.repeat([1, -1], len(leaps))
    now = qpos[at]
    for _ in range(REACH):
        at = at + way
        inside = (at >= 0) & (at < len(qpos))
        at, way, now = at[inside], way[inside], now[inside]
        now, rms = problem.solved(now, at, weight=weight, iterations=3)
        for (poses, miss), towards in zip(swept, (1, -1), strict=True):
            fresh = (way == towards) & np.isinf(miss[at])
            poses[at[fresh]], miss[at[fresh]] = now[fresh], rms[fresh]
    return swept


def _cheapest_path(
    character: Character, frames: Ints, choices: Floats, misses: Floats, price: float
) -> Ints:
    """Which candidate (n,) to take in each of n frames; ``choices`` (n, m, nq)."""
    size, count = choices.shape[:2]
    before = np.repeat(choices[:-1], count, axis=1).reshape(-1, choices.shape[2])
    after = np.tile(choices[1:], (1, count, 1)).reshape(-1, choices.shape[2])
    step = kinematics.difference(character.tree, before, after)
    cost = price * np.sum(step * step, axis=1).reshape(size - 1, count, count)
    cost[np.diff(frames) != 1] = 0.0  # another stretch begins
    total = misses[0] ** 2
    came_from = np.zeros((size, count), dtype=np.int64)
    for t in range(1, size):
        way = total[:, None] + cost[t - 1]
        came_from[t] = np.argmin(way, axis=0)
        total = way.min(axis=0) + misses[t] ** 2
    path = np.zeros(len(frames), dtype=np.int64)
    path[-1] = np.argmin(total)
    for t in range(len(frames) - 1, 0, -1):
        path[t - 1] = came_from[t, path[t]]
    return path


def _targets(character: Character, features: Floats) -> Floats:
    markers = len(character.markers.names)
    if features.shape[1] != 3 * markers:
        raise InputError(
            f"the features have {features.shape[1]} columns; {character.name} has {markers} "
            f"markers and needs {3 * markers}."
        )
    broken = ~np.isfinite(features).all(axis=1)
    if broken.any():
        raise InputError("the features are not finite.", frame=int(np.argmax(broken)))
    return features.reshape(len(features), markers, 3)


def facing_forward(character: Character, qpos: Floats) -> Floats:
    """Turn the root about the vertical until the heading is zero; features stay as they are.

    Features have heading zero by construction, but predicted ones are no exact pose and
    the best fit may face a fraction of a degree aside.
    """
    if not character.has_root:
        return qpos
    half = -0.5 * frame_of(character, qpos).yaw
    turn = np.zeros((len(qpos), 4))
    turn[:, 0], turn[:, 3] = np.cos(half), np.sin(half)
    turned = qpos.copy()
    quat = slice(character.root_qpos + 3, character.root_qpos + 7)
    turned[:, quat] = kinematics.quat_multiply(turn, qpos[:, quat])
    return turned


def continuous_qpos(character: Character, qpos: Floats) -> Floats:
    """The same poses with quaternion signs that do not flip from frame to frame."""
    smooth = qpos.copy()
    for joint in character.tree.joints:
        if joint.kind in ("free", "ball"):
            first = joint.qpos + (3 if joint.kind == "free" else 0)
            part = slice(first, first + 4)
            smooth[:, part] = kinematics.continuous(qpos[:, part])
    return smooth
