"""Whether a clip runs at the speed that gravity asks for.

Two clocks are in every motion. In flight the centre of mass falls at g. On the ground the point
where the floor must press is, with the CoM at c, its height above the floor z and its acceleration
a,

    p = c - z a / (g + a_z),

and lies within what touches. A clip that is played k times too slow shows accelerations k^2 times
too small: its flights float, and a body that leans on its way seems to hang beside its feet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from physretarget import kinematics
from physretarget.ground.undersides import bearing_solids
from physretarget.kinematics import runs
from physretarget.mjcf import Character
from physretarget.validation.evidence import Evidence, Floats

# How many times too slow (above 1) or too fast a clip is thought to be played: frame rates from 24
# to 240 for one another.
FACTORS = np.array([0.125, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.25, 5 / 3, 2.0, 2.5, 10 / 3,
                    4.0, 5.0, 8.0])  # fmt: skip
_MOST_FRAMES = 3000
# Accelerations are those of cubics over so many frames.
_WINDOW = 7
_DIRECTIONS = 16
# Flights that are looked at: so many frames long, and so high above the floor in CoM heights.
_FLIGHT_FRAMES, _CLEAR = 6, 0.02
# Of what a factor mends, what another may leave that is as good.
_AS_GOOD = 0.1
_PARABOLA = 0.05  # share of its rise by which a flight may stray from a parabola


@dataclass(frozen=True)
class Timing:
    """By how much a clip is too slow: ``factor`` its true rate over the given one.

    ``outside`` m: how far the floor would have to press outside what touches, on average, as it is
    and with the factor; ``flights`` how many flights agree, 0 where none was looked at.
    """

    factor: float
    outside: tuple[float, float]
    flights: int


def timing(
    character: Character, poses: Callable[[int, int], Floats], frames: int, fps: float
) -> Timing | None:
    """The clip's true speed as far as it can be told; None where nothing tells."""
    qpos = poses(0, min(frames, _MOST_FRAMES))
    if len(qpos) < 2 * _WINDOW or fps <= 0:
        return None
    pose = kinematics.forward(character.tree, qpos)
    com = _com(character, pose)
    gravity = float(np.linalg.norm(character.model.opt.gravity))
    lowest, reach, way = _reach(character, pose)
    flown = _flown(com, lowest, character, fps, gravity)
    if flown:
        return Timing(float(np.median(flown)), (0.0, 0.0), len(flown))
    acceleration = savgol_filter(com, _WINDOW, 3, deriv=2, delta=1 / fps, axis=0)
    standing = np.asarray(np.isfinite(reach).all(axis=1), dtype=np.bool_)
    standing[: _WINDOW // 2] = standing[len(standing) - _WINDOW // 2 :] = False
    if standing.sum() < _WINDOW:
        return None
    com, acceleration, reach = com[standing], acceleration[standing], reach[standing]
    height = com[:, 2] - character.floor_height
    outside = np.array([
        _outside(com, height, factor**2 * acceleration, reach, way, gravity) for factor in FACTORS
    ])  # fmt: skip
    # Statics explains a slow clip as well: of the factors nearly as good the nearest to 1 is meant.
    given = float(outside[FACTORS == 1][0])
    good = outside <= outside.min() + _AS_GOOD * (given - outside.min())
    best = int(np.flatnonzero(good)[np.abs(np.log(FACTORS[good])).argmin()])
    return Timing(float(FACTORS[best]), (given, float(outside[best])), 0)


def _com(character: Character, pose: kinematics.Pose) -> Floats:
    bodies = list(character.bodies)
    mass = character.model.body_mass[bodies]
    local = character.model.body_ipos[bodies]
    place = pose.position[:, bodies] + np.einsum("tbij,bj->tbi", pose.rotation[:, bodies], local)
    com: Floats = np.einsum("b,tbi->ti", mass, place) / mass.sum()
    return com


def _reach(character: Character, pose: kinematics.Pose) -> tuple[Floats, Floats, Floats]:
    """(T,) m above the floor of the lowest point; (T, n) how far what touches reaches along (n, 2).

    -inf where nothing touches; what is within 3 % of the CoM height of where the body stands
    touches. What stands above the model's floor has its floor there; what lies in a soft floor
    does not fly when it comes back up to it.
    """
    angle = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    every = bearing_solids(character)
    heights = [solid.heights(pose) for solid in every]
    lowest = np.min([h.min(axis=1) for h in heights], axis=0)
    base = np.quantile(lowest, 0.2)
    near = 0.03 * max(character.com_height, 1e-3)
    reach = np.full((len(lowest), _DIRECTIONS), -np.inf)
    for solid, height in zip(every, heights, strict=True):
        touches = height < base + near
        if not touches.any():
            continue
        turn = pose.rotation[:, solid.body]
        points = pose.position[:, solid.body, None] + solid.points @ turn.transpose(0, 2, 1)
        far = points[..., :2] @ way.T + solid.axes.max()
        reach = np.maximum(reach, np.where(touches[..., None], far, -np.inf).max(axis=1))
    return lowest - max(base, character.floor_height), reach, way


def _flown(
    com: Floats, lowest: Floats, character: Character, fps: float, gravity: float
) -> list[float]:
    """Of each flight that is a parabola, how many times too slow it is."""
    found = []
    for first, last in runs(lowest > _CLEAR * character.com_height):
        # The frames beside contact belong to it in part.
        first, last = first + 1, last - 1
        if last - first + 1 < _FLIGHT_FRAMES:
            continue
        time = np.arange(last - first + 1) / fps
        height = com[first : last + 1, 2]
        fit = np.polynomial.Polynomial.fit(time, height, 2).convert()
        sag = -float(fit.coef[2]) if len(fit.coef) > 2 else 0.0
        bow = abs(sag) * (time[-1] / 2) ** 2
        stray = float(np.abs(fit(time) - height).max())
        if sag > 0 and bow > 0.01 * character.com_height and stray < _PARABOLA * bow:
            found.append(float(np.sqrt(gravity / (2 * sag))))
    return found


def _outside(
    com: Floats, height: Floats, acceleration: Floats, reach: Floats, way: Floats, gravity: float
) -> float:
    """m by which the floor would have to press outside what touches, on average.

    Where it would have to pull, as far as the body is high.
    """
    press = gravity + acceleration[:, 2]
    bears = press > 0.1 * gravity
    lever = height / np.where(bears, press, gravity)
    at = com[:, :2] - lever[:, None] * acceleration[:, :2]
    out = np.maximum((at @ way.T - reach).max(axis=1), 0.0)
    return float(np.where(bears, np.minimum(out, height), height).mean())


# Walkers' steps: their length in leg lengths over their rate in units of sqrt(g / leg).
LEISURE = 1.5
_FEWEST_STANCES = 6
_STANDS = 0.2  # of the speed of a fall from the CoM's height


@dataclass(frozen=True)
class Walk:
    """Steps of a walk: ``length`` in leg lengths, ``rate`` in steps per sqrt(leg / g)."""

    length: float
    rate: float


# Of a walker's steps the body goes along with all: half says that it walks.
_CARRIES = 0.5


def cadence(character: Character, seen: Evidence, qpos: Floats) -> Walk | None:
    """The steps of a walker, None of what does not walk."""
    pose = kinematics.forward(character.tree, qpos)
    leg = float(np.median(pose.position[:, character.root_body, 2]))
    leg -= character.floor_height + seen.offset
    if leg <= 0.1 * seen.height:
        return None
    slow = np.linalg.norm(seen.slip[:, :2], axis=1) < _STANDS * seen.step * np.sqrt(
        9.81 * seen.height
    )
    low = np.abs(seen.lowest - seen.offset)[:-1] < 0.03 * seen.height
    stances: list[tuple[int, int, int]] = []
    for body in np.unique(seen.body):
        stances += [(a, b, int(body)) for a, b in runs(slow & low & (seen.body[:-1] == body))]
    stances = _joined(sorted(s for s in stances if s[1] > s[0]))
    if len(stances) < _FEWEST_STANCES:
        return None
    middle = [(a + b) // 2 for a, b, _ in stances]
    place = np.array([pose.position[t, s[2], :2] for t, s in zip(middle, stances, strict=True)])
    length = float(np.median(np.linalg.norm(place[2:] - place[:-2], axis=1))) / 2
    root = pose.position[middle, character.root_body, :2]
    travel = float(np.median(np.linalg.norm(root[2:] - root[:-2], axis=1))) / 2
    if travel < _CARRIES * length:
        return None  # the load goes from foot to foot, the body stays
    seconds = float(np.median(np.diff(middle))) * seen.step
    return Walk(length / leg, float(np.sqrt(leg / 9.81)) / seconds)


def _joined(stances: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Stances of one body that follow one another made one."""
    joined: list[tuple[int, int, int]] = []
    for first, last, body in stances:
        if joined and joined[-1][2] == body:
            joined[-1] = (joined[-1][0], last, body)
        else:
            joined.append((first, last, body))
    return joined
