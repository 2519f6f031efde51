"""Where forces may act to explain a frame: points that touch in it, and within reach of its force.

A force between two samples shows in both, and a filter carries it further (see
:mod:`physretarget.ground.response`): what a frame requires is a mean over its neighbours of forces
that acted at the points touching then, with the arms about the CoM that these had then. So any of
them may bear load. What touches in the frame itself is asked first; the rest only where that does
not explain the frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.ground.cones import RHO, fit_forces
from physretarget.ground.contacts import Contacts

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Series = dict[str, NDArray[np.generic]]

# What a force that remains counts against a moment that does: force is explained first. The moment
# that remains is short by one part in so many.
FORCE_FIRST = 1e4
# Moments (BW h) that remain beyond this are looked at again with all points in reach.
_EXPLAINED_BWH = 1e-3
# Frames on each side that are looked at, however far the filter reaches.
_PARTS = 8
# Among forces that explain a frame alike: low points before high ones, what touches now before what
# touched a moment ago, resting ones before sliding ones. Far below 1, so that they decide nothing
# else: at 1 m/s the residual changes by 1e-4.
_PRICE_OF_HEIGHT, _PRICE_OF_ABSENCE, _PRICE_PER_SPEED2 = 9 * RHO, 10 * RHO, 1e-4
_FASTEST = 3.0
# Faster than this along the floor a point slides (m/s), with more than this on it (BW) under load.
SLIDES_M_S, _BEARS_BW = 0.1, 0.01
# Sliding by Coulomb's law may leave so much more unexplained (BW, BW h): what DYN001 warns of.
UNEXPLAINED = 0.1
# Width of a cone of sliding friction, of its lean: directions are known to a tenth.
_THIN, _ROOT2 = 0.1, 2**0.5


@dataclass(frozen=True, eq=False)
class Support:
    """Points (T, n) at which force may act: position world m, ``arm`` m from the CoM, body,
    friction, ``velocity`` (T, n, 2) m/s along the floor.

    ``mask`` says which there are, ``away`` (T, n) how many frames off each touches.
    ``bodies`` (B,) are those that support in any frame. ``within`` (T,) whether anything touches in
    the frame or within reach of its force.
    """

    position: Floats
    arm: Floats
    body: Ints
    friction: Floats
    velocity: Floats
    mask: Bools
    away: Ints
    bodies: Ints
    within: Bools
    floor: float

    @property
    def own(self) -> Bools:
        """(T, n) points that touch in the frame itself."""
        mine: Bools = self.mask & (self.away == 0)
        return mine

    def rows(self, rows: Ints) -> Support:
        """Some of the frames."""
        return Support(
            self.position[rows], self.arm[rows], self.body[rows], self.friction[rows],
            self.velocity[rows], self.mask[rows], self.away[rows], self.bodies, self.within[rows],
            self.floor,
        )  # fmt: skip

    def with_forces(self, other: Support, force: Floats, forces: Floats) -> tuple[Support, Floats]:
        """``other`` in the frames in which it has points, and its ``forces`` (T, m, 3) there."""
        rows = other.mask.any(axis=1)
        width = max(self.mask.shape[1], other.mask.shape[1])

        def merged(mine: NDArray[Any], theirs: NDArray[Any]) -> NDArray[Any]:
            where = rows.reshape(-1, *[1] * (mine.ndim - 1))
            return np.where(where, _wide(theirs, width), _wide(mine, width))

        body, mask = merged(self.body, other.body), merged(self.mask, other.mask)
        both = Support(
            merged(self.position, other.position), merged(self.arm, other.arm), body,
            merged(self.friction, other.friction), merged(self.velocity, other.velocity), mask,
            merged(self.away, other.away), np.unique(body[mask]), self.within, self.floor,
        )  # fmt: skip
        return both, merged(force, forces)


def _wide(values: NDArray[Any], width: int) -> NDArray[Any]:
    """Columns of zeros added, or columns cut off, until there are ``width``."""
    kept = values[:, :width]
    more = [(0, 0), (0, width - kept.shape[1])] + [(0, 0)] * (values.ndim - 2)
    return np.pad(kept, more)


def find_support(
    contacts: Contacts, com: Floats, velocity: Floats, inner: slice, reach: int,
    rows: Bools | None = None,
) -> Support:  # fmt: skip
    """Support of the frames ``inner``; ``contacts``, ``com`` (T, 3) and ``velocity`` (T, n, 2)
    of the contacts' points along the floor come with neighbours.

    Of the frames among them that ``rows`` (len(inner),) marks, all points within ``reach`` frames;
    of others none. Without ``rows``, those of the frames themselves. Forces of a clip's first and
    last frame are those of their neighbours: they reach a frame more.
    """
    frames = np.arange(len(com))[inner]
    within = np.full(len(com), reach)
    if inner.start == 0:
        within[0] += 1
    if inner.stop == len(com):
        within[-1] += 1
    # Points stand in front of their rows, those that stand for the others first.
    number = (contacts.outer if rows is None else contacts.mask).sum(axis=1)
    if rows is None:
        wanted, sources = np.arange(len(frames)), frames[:, None]
    else:
        wanted = np.flatnonzero(rows)
        sources = _sources(number, frames[wanted], within[frames[wanted]])
    seen = np.where(sources >= 0, number[sources], 0)
    row, place, column = np.nonzero(np.arange(int(number.max(initial=0))) < seen[..., None])
    source, row = sources[row, place], wanted[row]
    counts = np.bincount(row, minlength=len(frames))
    at = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    shape = (len(frames), int(counts.max(initial=0)))
    position, arm = np.zeros((*shape, 3)), np.zeros((*shape, 3))
    body, mask = np.zeros(shape, dtype=np.int64), np.zeros(shape, bool)
    away = np.zeros(shape, dtype=np.int64)
    friction, moves = np.ones(shape), np.zeros((*shape, 2))
    position[row, at] = contacts.position[source, column]
    arm[row, at] = contacts.position[source, column] - com[source]
    body[row, at], mask[row, at] = contacts.body[source, column], True
    friction[row, at] = contacts.friction[source, column]
    moves[row, at] = velocity[source, column]
    away[row, at] = np.abs(source - frames[row])
    total = np.cumsum(np.r_[0, number > 0])
    first = np.maximum(frames - within[inner], 0)
    last = np.minimum(frames + within[inner] + 1, len(com))
    return Support(
        position, arm, body, friction, moves, mask, away, np.unique(body[mask]),
        total[last] > total[first], contacts.floor,
    )  # fmt: skip


def _sources(number: Ints, frames: Ints, within: Ints) -> Ints:
    """(F, n) frames in reach of ``frames`` (F,), the frame itself first; -1 for none.

    Of a long reach a few parts on each side, and of each part the frame in which most points touch.
    """
    found = [frames]
    longest = int(within.max(initial=0))
    edges = np.unique(np.round(np.linspace(0, longest, min(_PARTS, longest) + 1)).astype(int))
    for side in (-1, 1):
        for start, stop in pairwise(edges.tolist()):
            steps = np.arange(start + 1, stop + 1)
            others = frames[:, None] + side * steps
            there = (others >= 0) & (others < len(number)) & (steps <= within[:, None])
            count = np.where(there, number[np.clip(others, 0, len(number) - 1)], 0)
            best = count.argmax(axis=1)
            rows = np.arange(len(frames))
            found.append(np.where(count[rows, best] > 0, others[rows, best], -1))
    return np.stack(found, axis=1)


def prices(support: Support, speed: Floats, tolerance: float) -> Floats:
    """(T, n) price of force at a point, which settles what physics leaves open.

    Where several points could bear the load, the kindest reading of the clip is taken: the foot at
    rest stands, the one that passes by does not.
    """
    above = np.clip((support.position[..., 2] - support.floor) / tolerance, 0.0, 1.0)
    pace = np.minimum(speed, _FASTEST)
    price = RHO + _PRICE_OF_HEIGHT * above**2 + _PRICE_PER_SPEED2 * pace**2
    cost: Floats = price + np.where(support.own, 0.0, _PRICE_OF_ABSENCE)
    return cost


@dataclass(frozen=True, eq=False)
class Explained:
    """What the floor can do about a wrench: ``force`` (T, n, 3) BW at the points of ``support``,
    and the ``moment`` (T, 3) BW h that remains when the force is explained as far as it can be.

    ``slides`` (T,) where that takes load from points that slide without being braked: by Coulomb's
    law, friction is then on the edge of its cone and against the motion.
    """

    support: Support
    force: Floats
    moment: Floats
    slides: Bools


def explain(
    contacts: Contacts, com: Floats, inner: slice, reach: int, force: Floats, moment: Floats,
    *, height: float, velocity: Floats,
) -> Explained:  # fmt: skip
    """Contact forces of the frames ``inner`` that explain ``force`` (T, 3) BW first, then
    ``moment`` (T, 3) BW h about the CoM.

    ``velocity`` (T, n, 2) m/s is that of the contacts' points along the floor. What the frame's
    own points at rest explain is done; else all points in reach are asked.
    """
    support = find_support(contacts, com, velocity, inner, reach)
    borne, rest = _fit(support, force, moment, height, contacts.tolerance)
    slides = _slides(support, borne)
    again = support.within & ((np.linalg.norm(rest, axis=1) > _EXPLAINED_BWH) | slides)
    if again.any():
        wide = _without_rests(find_support(contacts, com, velocity, inner, reach, again))
        more, left = _fit(wide, force, moment, height, contacts.tolerance)
        rest = np.where(again[:, None], left, rest)
        support, borne = support.with_forces(wide, borne, more)
        slides = _slides(support, borne)
    rows = np.flatnonzero(slides)
    if len(rows):
        part = support.rows(rows)
        left = _braked(part, force[rows], moment[rows], height, contacts.tolerance)
        allowed = UNEXPLAINED + np.linalg.norm(rest[rows], axis=1)
        taken = left < allowed
        slides[rows[taken]] = False
    left = _untwisted(rest, borne[..., 2], contacts.twist[support.body] / height)
    return Explained(support, borne, left, slides)


def _untwisted(moment: Floats, normal: Floats, twist: Floats) -> Floats:
    """(T, 3) what remains of a moment (T, 3) BW h when points under ``normal`` (T, n) BW resist
    turning on the spot and rolling, with ``twist`` (T, n, 2) h."""
    most = np.einsum("tn,tnk->tk", normal, twist)
    along = np.linalg.norm(moment[:, :2], axis=1)
    rolls = np.maximum(along - most[:, 1], 0.0) / np.where(along > 0, along, 1.0)
    turns = np.maximum(np.abs(moment[:, 2]) - most[:, 0], 0.0) * np.sign(moment[:, 2])
    left: Floats = np.c_[moment[:, :2] * rolls[:, None], turns]
    return left


def _without_rests(support: Support) -> Support:
    """Without the points beyond the neighbouring frames of bodies that slide in the frame.

    A foot that slides now bears no load where it rested, or will rest, further on.
    """
    mask, speed = support.mask.copy(), speeds(support.velocity)
    for body in support.bodies:
        mine = support.mask & (support.body == body)
        now = mine & (support.away == 0)
        slowest = np.where(now, speed, np.inf).min(axis=1, initial=np.inf)
        slides = np.isfinite(slowest) & (slowest > SLIDES_M_S)
        mask &= ~(mine & slides[:, None] & (support.away > 1))
    return replace(support, mask=mask)


def _slides(support: Support, borne: Floats) -> Bools:
    """(T,) where points that slide bear load."""
    fast = speeds(support.velocity) > SLIDES_M_S
    found: Bools = np.where(fast, borne[..., 2], 0.0).sum(axis=1) > _BEARS_BW
    return found


def _fit(
    support: Support, force: Floats, moment: Floats, height: float, tolerance: float
) -> tuple[Floats, Floats]:
    """Forces (T, n, 3) and the moment (T, 3) that remains when the force is explained."""
    fit = fit_forces(
        support.arm / height, support.mask, np.hstack([_target(support, force), moment]),
        friction=support.friction, rho=prices(support, speeds(support.velocity), tolerance),
        force_weight=FORCE_FIRST,
    )  # fmt: skip
    return fit.force, fit.residual[:, 3:]


def _braked(
    support: Support, force: Floats, moment: Floats, height: float, tolerance: float
) -> Floats:
    """(T,) what remains of a wrench when friction of sliding points obeys Coulomb's law.

    Against the motion means within 45 degrees of it: the corner of a pyramid, MuJoCo's default for
    a cone, is as far off. So a point that slides has three thin cones, which may act together.
    """
    speed = speeds(support.velocity)
    # Only what acts between samples: the filter's reach would find a foot at rest for any other.
    near = support.mask & (support.away <= 1)
    fast = near & (speed > SLIDES_M_S)
    back = -support.velocity / np.where(fast, speed, 1.0)[..., None] * support.friction[..., None]
    aside = np.stack([-back[..., 1], back[..., 0]], axis=-1)
    lean = np.concatenate([back, (back + aside) / _ROOT2, (back - aside) / _ROOT2], axis=1)
    lean = np.where(np.concatenate([fast] * 3, axis=1)[..., None], lean, 0.0)
    mask = np.concatenate([near, fast, fast], axis=1)
    thin = np.concatenate([fast, fast, fast], axis=1)
    rough = np.concatenate([support.friction] * 3, axis=1) * np.where(thin, _THIN, 1.0)
    fit = fit_forces(
        np.concatenate([support.arm] * 3, axis=1) / height, mask,
        np.hstack([_target(support, force), moment]), friction=rough, lean=lean,
        rho=np.concatenate([prices(support, np.zeros_like(speed), tolerance)] * 3, axis=1),
    )  # fmt: skip
    left: Floats = np.linalg.norm(fit.residual, axis=1)
    return left


def _target(support: Support, force: Floats) -> Floats:
    """(T, 3) the force nearest to ``force`` that the points of each frame can give."""
    rough = np.where(support.mask, support.friction, 0.0).max(axis=1, initial=0.0)
    nearest = nearest_force(force, rough)
    nearest[~support.mask.any(axis=1)] = 0.0
    return nearest


def speeds(velocity: Floats) -> Floats:
    """Length of vectors (..., 2)."""
    speed: Floats = np.sqrt(velocity[..., 0] ** 2 + velocity[..., 1] ** 2)
    return speed


def nearest_force(force: Floats, friction: Floats) -> Floats:
    """(T, 3) the force in a friction cone that is nearest to ``force`` (T, 3)."""
    along = np.hypot(force[:, 0], force[:, 1])
    up = force[:, 2]
    # On the cone's edge: the projection on the ray (mu, 1) in the plane of the force.
    reach = np.maximum((friction * along + up) / (1 + friction**2), 0.0)
    inside = (up >= 0) & (along <= friction * up)
    shrink = np.where(inside, 1.0, friction * reach / np.where(along > 0, along, 1.0))
    found: Floats = np.c_[force[:, :2] * shrink[:, None], np.where(inside, up, reach)]
    return found
