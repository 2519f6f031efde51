"""The rigid path of one body over a clip: standing, rolling over its edges, flying.

The paper corrects each contact point on its own (Yamane 2010, eq. (9)). Points of one rigid
body cannot be corrected apart from each other, so the same blend is applied here to the
body's rigid placement: position, heading and tilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.phases import any_point
from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole, SoleMotion, allowed_tilt, rolled, yaw_quat
from physretarget.contact.stances import Footing
from physretarget.kinematics import runs

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Array = TypeVar("Array", Floats, Bools)
Height = TypeVar("Height", float, Floats)


@dataclass(frozen=True, eq=False)
class Track:
    """Where a sole shall be.

    ``centre`` (T, 3) and ``rotation`` (T, 3, 3) of the body, world; ``target`` (T, n, 3) where
    each point belongs while the body stands, NaN in flight; ``planted`` (T, n) the points that
    bear it by the timetable; ``away`` (T,) s to the nearest stance, 0 within one.
    """

    centre: Floats
    rotation: Floats
    target: Floats
    planted: Bools
    away: Floats

    @property
    def standing(self) -> Bools:
        """(T,) whether the body stands."""
        return any_point(self.planted)

    def differs(self, other: Track) -> Bools:
        """(T,) in which frames another path of the same sole is not exactly the same."""
        same = (self.centre == other.centre).all(axis=1) & (self.away == other.away)
        same &= (self.rotation == other.rotation).all(axis=(1, 2))
        changed: Bools = np.logical_not(same)
        return changed

    def points(self, sole: Sole) -> Floats:
        """(T, n, 3) where the track puts the sole's points."""
        return self._at(sole, sole.local)

    def undersides(self, sole: Sole) -> Floats:
        """(T, m, 3) where the track puts the rest of the sole's underside."""
        return self._at(sole, sole.under)

    def _at(self, sole: Sole, local: Floats) -> Floats:
        arm = local - sole.centre
        points: Floats = self.centre[:, None] + np.einsum("tij,nj->tni", self.rotation, arm)
        return points


def stand(
    sole: Sole,
    motion: SoleMotion,
    footings: Sequence[Footing],
    active: Bools,
    time: Floats,
    floor: float,
    settings: ContactSettings,
) -> Track:
    """Put the body on its footings; in flight it is still where the motion had it."""
    centre, rotation = motion.centre.copy(), motion.rotation.copy()
    target = np.full((*active.shape, 3), np.nan)
    planted = np.zeros_like(active)
    for footing in footings:
        part = slice(footing.first, footing.last + 1)
        bearing = footing.planted(sole, active)
        turn = kinematics.quat_to_matrix(yaw_quat(footing.place[2]))
        print_ = np.append(footing.place[:2], floor - sole.foot[:, 2].min()) + sole.foot @ turn.T
        # The motion leans the same way in the world, whatever the heading of the stance.
        aside = yaw_quat(motion.yaw[part] - footing.place[2])
        wanted = kinematics.quat_rotate(aside, motion.tilt[part])
        tilt = _tilt_on_floor(sole, wanted, bearing, time, settings)
        if sole.two_sided:
            hops = (footing.first > 0, footing.last < len(time) - 1)
            tilt *= level_ends(time[part], hops, settings)[:, None]
        lean = kinematics.quat_to_matrix(kinematics.rotvec_to_quat(tilt))
        if len(sole.local) > 1:
            rotation[part] = turn @ lean @ sole.flat
        pivot = np.argmax(bearing, axis=1)
        arm = np.einsum("tij,tj->ti", rotation[part], (sole.local - sole.centre)[pivot])
        centre[part] = print_[pivot] - arm
        target[part], planted[part] = print_, bearing
    return Track(centre, rotation, target, planted, _away(any_point(planted), time))


def _tilt_on_floor(
    sole: Sole, tilt: Floats, planted: Bools, time: Floats, settings: ContactSettings
) -> Floats:
    """The body's tilt (F, 3) over a stance: as mapped, as far as the planted points allow.

    Allowed tilts are convex cones, so an average over neighbours of tilts that each obey the
    constraints of all their neighbours obeys its own: smooth, and no point sinks.
    """
    wanted = tilt + waddle(sole, planted, time[: len(tilt)], settings)
    if sole.two_sided:
        size = np.linalg.norm(wanted, axis=1, keepdims=True)
        wanted *= np.minimum(1.0, settings.max_tilt / np.maximum(size, 1e-9))
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    reach = min(round(settings.settle / step), len(tilt))
    offsets = range(-reach, reach + 1)
    spread = np.zeros_like(planted)
    for offset in offsets:
        spread |= _shifted(planted, offset)
    possible = allowed_tilt(sole, wanted, spread)
    total, weights = np.zeros_like(tilt), np.zeros((len(tilt), 1))
    for offset in offsets:
        weight = 1.0 + np.cos(np.pi * offset / (reach + 1))
        total += weight * _shifted(possible, offset)
        weights += weight * _shifted(np.ones((len(tilt), 1)), offset)
    mean: Floats = total / weights
    return mean


def waddle(sole: Sole, planted: Bools, time: Floats, settings: ContactSettings) -> Floats:
    """The roll (F, 3) onto the side that stands alone: up and down like a rocking block's.

    A block that rocks on its edge falls back under gravity, so its angle is a parabola in
    time; a longer stance holds the angle in between.
    """
    roll = np.zeros((len(planted), 3))
    if not sole.two_sided or settings.waddle <= 0:
        return roll
    for side in dict.fromkeys(sole.sides):
        mine = np.array([s == side for s in sole.sides])
        alone = any_point(planted[:, mine]) & ~any_point(planted[:, ~mine])
        for first, last in runs(alone):
            inside = time[first : last + 1]
            flank = min(0.5 * (inside[-1] - inside[0]), settings.rock)
            edge = np.minimum(inside - inside[0], inside[-1] - inside)
            share = 1.0 - np.clip(edge / max(flank, 1e-9), 0.0, 1.0)
            full = rolled(sole, mine, settings.waddle)
            roll[first : last + 1] = (1.0 - share * share)[:, None] * full
    return roll


def level_ends(time: Floats, hops: tuple[bool, bool], settings: ContactSettings) -> Floats:
    """(F,) from 0 where a stance begins or ends with a hop to 1 within ``rock`` s.

    A base that lands on one edge tips over. Scaling keeps a tilt within its cone, and a parabola is
    how a rocking block comes to lie flat. Who stands for a shorter time tilts less.
    """
    share = np.zeros(len(time))
    for hop, since in zip(hops, (time - time[0], time[-1] - time), strict=True):
        if hop:
            share = np.maximum(share, 1.0 - np.minimum(since / settings.rock, 1.0))
    return 1.0 - share * share


def _shifted(rows: Array, offset: int) -> Array:
    """Row t becomes row t + offset; zeros where there is none."""
    out = np.zeros_like(rows)
    if offset > 0:
        out[:-offset] = rows[offset:]
    elif offset < 0:
        out[-offset:] = rows[:offset]
    else:
        out[:] = rows
    return out


def _away(standing: Bools, time: Floats) -> Floats:
    """(T,) s to the nearest standing frame, infinite where there is none at all."""
    frames = np.flatnonzero(standing)
    if not len(frames):
        return np.full(len(time), np.inf)
    after = np.searchsorted(frames, np.arange(len(time)))
    later = time[frames[np.minimum(after, len(frames) - 1)]]
    earlier = time[frames[np.maximum(after - 1, 0)]]
    nearest: Floats = np.minimum(np.abs(later - time), np.abs(time - earlier))
    return np.where(standing, 0.0, nearest)


def fly(
    sole: Sole,
    motion: SoleMotion,
    track: Track,
    footings: Sequence[Footing],
    grounded: Bools,
    arc: Floats,
    time: Floats,
    floor: float,
    height: float,
    settings: ContactSettings,
    *,
    way: Floats | None = None,
) -> Track:
    """Blend the corrections of the stances before and after over each flight, eq. (9).

    What is blended is how far they are from ``way`` (T, 3), the correction of the trunk on which
    the foot hangs, zero by default: a foot in flight goes where its trunk goes. Before the first
    stance and after the last one its own correction holds; on a trunk, that difference is gone
    ``settings.settle_down`` s away. ``grounded`` (T,)
    tells whether anything bears the character: a flight during which nothing does is a hop of
    the whole and rises like a thrown stone, by ``arc`` (T,) m; otherwise a foot swings, and is
    thrown with the rest while nothing bears.
    """
    if not footings:
        return track
    centre, rotation = track.centre.copy(), track.rotation.copy()
    hangs = way is not None
    way = np.zeros_like(centre) if way is None else way
    ends = [None, *footings, None]
    for before, after in pairwise(ends):
        first = before.last + 1 if before else 0
        last = after.first - 1 if after else len(time) - 1
        if last < first:
            continue
        inner = slice(first, last + 1)
        t0 = float(time[before.last]) if before else float(time[first])
        t1 = float(time[after.first]) if after else float(time[last])
        share = (time[inner] - t0) / max(t1 - t0, 1e-9)
        start = _correction(sole, motion, track, before.last, way) if before else None
        end = _correction(sole, motion, track, after.first, way) if after else None
        thrown = not grounded[inner].any() and t1 - t0 <= settings.longest_flight
        linear = thrown and settings.blend == "ballistic"
        weight = share if linear else share * share * (3.0 - 2.0 * share)  # eq. (9)
        shift, yaw, tilt = _blended(start, end, weight)
        if hangs and not (before and after):
            since = np.abs(time[inner] - (t0 if before else t1)) / settings.settle_down
            near = np.maximum(1.0 - since, 0.0)
            shift = shift * (near * near * (3.0 - 2.0 * near))[:, None]
        centre[inner] += shift + way[inner]
        if len(sole.local) > 1:
            turn = kinematics.quat_multiply(kinematics.rotvec_to_quat(tilt), yaw_quat(yaw))
            rotation[inner] = kinematics.quat_to_matrix(turn) @ rotation[inner]
        whole = np.concatenate([sole.local, sole.under]) - sole.centre
        arm = np.einsum("tij,nj->tni", rotation[inner], whole)
        low = (centre[inner, None] + arm)[..., 2].min(axis=1) - floor
        if before and after:
            rise = lowest_rise(before, after, t1 - t0, height, settings)
            swing = 4.0 * rise * share * (1.0 - share)
            centre[inner, 2] += raised(low, np.maximum(arc[inner], swing)) - low
        else:
            # Smoothly no lower than the floor, exactly untouched next to the stance.
            ramp = np.minimum(np.abs(time[inner] - (t0 if before else t1)) / 0.2, 1.0)
            soft = 0.02 * height * ramp
            centre[inner, 2] += 0.5 * (low + np.sqrt(low * low + soft * soft)) - low
    return Track(centre, rotation, track.target, track.planted, track.away)


def lowest_rise(
    before: Footing, after: Footing, duration: float, height: float, settings: ContactSettings
) -> float:
    """How high a foot swings at least, m: low where it is only set down anew."""
    travel = float(np.linalg.norm(after.place[:2] - before.place[:2]))
    step = max(settings.shuffle_height * height, settings.swing_share * travel)
    return min(settings.gravity * duration**2 / 8.0, settings.swing_height * height, step)


def raised(low: Height, arc: Height) -> Height:
    """A smooth maximum of the path's height and the arc; equal to both where they are zero."""
    soft = 0.2 * arc
    between: Height = np.sqrt((low - arc) ** 2 + soft * soft)
    return 0.5 * (low + arc + between)


_Correction = tuple[Floats, float, Floats]


def _correction(
    sole: Sole, motion: SoleMotion, track: Track, frame: int, way: Floats
) -> _Correction:
    """What takes the motion, moved by ``way``, to the track at a frame.

    Shift (3,), yaw, world tilt vector (3,).
    """
    there = kinematics.matrix_to_quat(track.rotation[frame] @ sole.flat.T)
    yaw = 2.0 * float(np.arctan2(there[3], there[0])) - float(motion.yaw[frame])
    yaw = float((yaw + np.pi) % (2.0 * np.pi) - np.pi)
    turned = kinematics.quat_to_matrix(yaw_quat(np.array(yaw))) @ motion.rotation[frame]
    rest = kinematics.matrix_to_quat(track.rotation[frame] @ turned.T)
    shift = track.centre[frame] - motion.centre[frame] - way[frame]
    return shift, yaw, kinematics.quat_to_rotvec(rest)


def _blended(
    start: _Correction | None, end: _Correction | None, weight: Floats
) -> tuple[Floats, Floats, Floats]:
    """Corrections over a flight; ``weight`` goes from 0 at the start to 1 at the end."""
    if start is None:
        start = end
    if end is None:
        end = start
    assert start is not None
    assert end is not None
    turn = (end[1] - start[1] + np.pi) % (2.0 * np.pi) - np.pi
    shift = start[0] + weight[:, None] * (end[0] - start[0])
    tilt = start[2] + weight[:, None] * (end[2] - start[2])
    return shift, start[1] + weight * turn, tilt
