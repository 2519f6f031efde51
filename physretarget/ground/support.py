"""Where forces may act to explain a frame: points that touch in it, and within reach of its force.

A force between two samples shows in both, and a filter carries it further (see
:mod:`physretarget.ground.response`): what a frame requires is a mean over its neighbours of forces
that acted at the points touching then, with the arms about the CoM that these had then. So any of
them may bear load. What touches in the frame itself is asked first; the rest only where that does
not explain the frame.
"""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True, eq=False)
class Support:
    """Points (T, n) at which force may act: position world m, ``arm`` m from the CoM, body,
    friction.

    ``own`` are those that touch in the frame itself, ``mask`` adds those of neighbouring frames.
    ``bodies`` (B,) are those that support in any frame. ``within`` (T,) whether anything touches in
    the frame or within reach of its force.
    """

    position: Floats
    arm: Floats
    body: Ints
    friction: Floats
    mask: Bools
    own: Bools
    bodies: Ints
    within: Bools
    floor: float

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
            merged(self.friction, other.friction), mask, merged(self.own, other.own),
            np.unique(body[mask]), self.within, self.floor,
        )  # fmt: skip
        return both, merged(force, forces)


def _wide(values: NDArray[Any], width: int) -> NDArray[Any]:
    """Columns of zeros added, or columns cut off, until there are ``width``."""
    kept = values[:, :width]
    more = [(0, 0), (0, width - kept.shape[1])] + [(0, 0)] * (values.ndim - 2)
    return np.pad(kept, more)


def find_support(
    contacts: Contacts, com: Floats, inner: slice, reach: int, rows: Bools | None = None
) -> Support:
    """Support of the frames ``inner``; ``contacts`` and ``com`` (T, 3) come with neighbours.

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
    body, mask, own = np.zeros(shape, dtype=np.int64), np.zeros(shape, bool), np.zeros(shape, bool)
    friction = np.ones(shape)
    position[row, at] = contacts.position[source, column]
    arm[row, at] = contacts.position[source, column] - com[source]
    body[row, at], mask[row, at] = contacts.body[source, column], True
    friction[row, at] = contacts.friction[source, column]
    own[row, at] = source == frames[row]
    total = np.cumsum(np.r_[0, number > 0])
    first = np.maximum(frames - within[inner], 0)
    last = np.minimum(frames + within[inner] + 1, len(com))
    return Support(
        position, arm, body, friction, mask, own, np.unique(body[mask]),
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
    pace = np.where(support.own, np.minimum(speed, _FASTEST), 0.0)
    price = RHO + _PRICE_OF_HEIGHT * above**2 + _PRICE_PER_SPEED2 * pace**2
    cost: Floats = price + np.where(support.own, 0.0, _PRICE_OF_ABSENCE)
    return cost


@dataclass(frozen=True, eq=False)
class Explained:
    """What the floor can do about a wrench: ``force`` (T, n, 3) BW at the points of ``support``,
    and the ``moment`` (T, 3) BW h that remains when the force is explained as far as it can be."""

    support: Support
    force: Floats
    moment: Floats


def explain(
    contacts: Contacts, com: Floats, inner: slice, reach: int, force: Floats, moment: Floats,
    *, height: float, speed: Floats | None = None,
) -> Explained:  # fmt: skip
    """Contact forces of the frames ``inner`` that explain ``force`` (T, 3) BW first, then
    ``moment`` (T, 3) BW h about the CoM.

    ``speed`` (T, n) m/s is that of the frames' own points along the floor.
    """
    support = find_support(contacts, com, inner, reach)
    own, rest = _fit(support, force, moment, speed, height, contacts.tolerance)
    again = support.within & (np.linalg.norm(rest, axis=1) > _EXPLAINED_BWH)
    if not again.any():
        return Explained(support, own, rest)
    wide = find_support(contacts, com, inner, reach, again)
    # The frame's own points come first among all in reach: so do their speeds.
    pace = None if speed is None else _wide(speed, wide.mask.shape[1])
    more, left = _fit(wide, force, moment, pace, height, contacts.tolerance)
    rest = np.where(again[:, None], left, rest)
    merged, both = support.with_forces(wide, own, more)
    return Explained(merged, both, rest)


def _fit(
    support: Support, force: Floats, moment: Floats, speed: Floats | None, height: float,
    tolerance: float,
) -> tuple[Floats, Floats]:  # fmt: skip
    pace = np.zeros(support.mask.shape) if speed is None else speed
    rough = np.where(support.mask, support.friction, 0.0).max(axis=1, initial=0.0)
    nearest = nearest_force(force, rough)
    nearest[~support.mask.any(axis=1)] = 0.0
    fit = fit_forces(
        support.arm / height, support.mask, np.hstack([nearest, moment]),
        friction=support.friction, rho=prices(support, pace, tolerance), force_weight=FORCE_FIRST,
    )  # fmt: skip
    return fit.force, fit.residual[:, 3:]


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
