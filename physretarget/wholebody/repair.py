"""Any clip of any model made to stand: stances found in it, put on the floor and kept there.

A body stands where it is near the floor and slow: the clip's own slide, float and sink are
mistakes of less than that. Where nothing is near the floor, yet the centre of mass does not fall,
the lowest body stands, too: nothing else could carry it.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_dilation, binary_opening, uniform_filter1d

from physretarget import kinematics
from physretarget.errors import InputError
from physretarget.ground.contacts import contact_tolerance
from physretarget.ground.undersides import Undersides, undersides
from physretarget.ground.wrench import external_wrench
from physretarget.kinematics import runs
from physretarget.mjcf import Character
from physretarget.wholebody.settings import WholeBodySettings
from physretarget.wholebody.stage import Held, displacement, settle, unexplained
from physretarget.wholebody.support import PRICE_OF_ABSENCE, PRICE_OF_FORCE, Support

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]

FEWEST = 8
"""Frames of a clip: differences need some on each side."""
NEAR, SLOW = 0.04, 0.4
"""A body stands within this share of the height above the floor and below this speed, in leg
lengths (half the height) per second: a walker's swinging foot passes at three times its pace."""
SHORTEST_S, PAUSE_S = 0.1, 0.07
"""Stances last at least so long; shorter pauses in one are none."""
FALLING = 0.5
"""What is pressed to the floor with less than this, BW, may be in the air."""
LEVEL_M = 2e-3
"""A clip that stands this far off the floor throughout is moved onto it as a whole."""
WORTH_M = 2e-3
"""Points that are this far from where they belong are worth moving."""
ALONG_S = 0.15
"""Over so long the whole body takes up what its feet are moved by."""
FLOOR = 1e4
"""Price of depth in the floor: here nothing may stay in it."""
MOST_POINTS = 8
"""Under each body that stands."""


@dataclass(frozen=True, eq=False)
class Repaired:
    """A clip that stands. T frames.

    ``qpos`` (T, nq); ``lifted`` m, by which the whole clip was raised first; ``moved`` (T,) m, RMS
    displacement of the markers from the clip as given, and ``posed`` (T,) without what the whole
    body was moved by; ``stands`` (T,) how many bodies do; ``slid_m``, the farthest that a standing
    point was from where it belongs;
    ``unexplained_before`` and ``unexplained_after`` (T,) BW.
    """

    qpos: Array
    lifted: float
    moved: Array
    posed: Array
    stands: Ints
    slid_m: float
    unexplained_before: Array
    unexplained_after: Array
    status: str
    seconds: float
    notes: tuple[str, ...] = ()


def repair(
    character: Character, qpos: Array, time: Array, *, settings: WholeBodySettings | None = None
) -> Repaired:
    """Mend slide, float, sink and lean of a clip qpos (T, nq) by the least change.

    Raises:
        InputError: no free root, nothing that touches a floor, or too few frames.
        SolverError: a step has no solution.
    """
    began = clock.perf_counter()
    settings = replace(settings or WholeBodySettings(), floor=FLOOR)
    points = undersides(character)
    if not character.has_root:
        raise InputError(f"{character.name} has no free root joint: the world holds it.")
    if not len(points):
        raise InputError(f"{character.name} has no geometry that collides with the floor.")
    if len(qpos) < FEWEST:
        raise InputError(f"the clip has {len(qpos)} frames; at least {FEWEST} are needed")
    step = float(time[-1] - time[0]) / (len(time) - 1)
    heights = _heights(character, points, qpos)
    lift = -float(np.median(heights.min(axis=1)))
    lift = lift if abs(lift) > LEVEL_M else 0.0
    level = qpos.copy()
    level[:, character.root_qpos + 2] += lift
    standing = _standing(character, points, level, heights + lift, step)
    held = _held(character, points, level, standing)
    if held is None:
        still = np.zeros(len(qpos))
        said = "Nothing in the clip stands on the floor: it is left as it is."
        return Repaired(qpos, 0.0, still, still, standing.sum(axis=1), 0.0, still, still,
                        "nothing to mend", clock.perf_counter() - began, (said,))  # fmt: skip
    support = _support(character, held, settings)
    before = unexplained(character, level, time, support)
    level[:, character.root_qpos : character.root_qpos + 3] += _carried(
        character, level, held, step
    )
    there = kinematics.trajectories(character.tree, level, held.body, held.local)
    off = np.linalg.norm(held.place - there, axis=-1)
    far = np.where(held.stand, off, 0.0).max(axis=1)
    trouble = np.maximum(before, np.where(far > WORTH_M, 1.0, 0.0))
    moved, iterations, status = settle(character, level, time, held, support, trouble, settings)
    return Repaired(
        qpos=moved if iterations else level,
        lifted=lift,
        moved=displacement(character, qpos, moved),
        posed=displacement(character, level, moved),
        stands=standing.sum(axis=1),
        slid_m=float(far.max()),
        unexplained_before=before,
        unexplained_after=unexplained(character, moved, time, support),
        status=status if iterations else "nothing to mend",
        seconds=clock.perf_counter() - began,
    )


def _heights(character: Character, points: Undersides, qpos: Array) -> Array:
    """(T, B) m of the lowest point of each body that can touch."""
    pose = kinematics.forward(character.tree, qpos)
    each = [points.of_body(int(b)).heights(pose).min(axis=1) for b in points.bodies]
    return np.stack(each, axis=1) - character.floor_height


def _standing(
    character: Character, points: Undersides, qpos: Array, heights: Array, step: float
) -> Flags:
    """(T, B) which bodies stand."""
    pose = kinematics.forward(character.tree, qpos)
    speed = np.empty_like(heights)
    for k, body in enumerate(points.bodies):
        low = points.of_body(int(body))
        middle = kinematics.points(pose, [int(body)], low.local.mean(axis=0)[None])[:, 0]
        speed[:, k] = np.linalg.norm(np.gradient(middle, step, axis=0), axis=1)
    slow = speed < SLOW * 0.5 * character.height
    # How far off the floor the clip stands at that time: what is as low as the lowest touches.
    lowest = heights.min(axis=1, keepdims=True)
    low = heights < lowest + contact_tolerance(character.com_height)
    near = lowest < NEAR * character.height
    pressed = external_wrench(character, pose, step).force[:, 2]
    carried = uniform_filter1d(pressed, 2 * max(1, round(0.05 / step)) + 1) > FALLING
    stands = slow & low & (near | carried[:, None])
    close, keep = max(1, round(PAUSE_S / step)), max(2, round(SHORTEST_S / step))
    pads = ((close + keep, close + keep), (0, 0))
    wide = np.pad(stands, pads, mode="edge")
    wide = binary_closing(wide, np.ones((close, 1), bool))
    wide = binary_opening(wide, np.ones((keep, 1), bool))
    found: Flags = wide[close + keep : len(wide) - close - keep]
    return found


def _held(character: Character, points: Undersides, qpos: Array, standing: Flags) -> Held | None:
    """Points under the bodies that stand, each where it stands on average, on the floor."""
    body: list[int] = []
    local, place, stand = [], [], []
    pose = kinematics.forward(character.tree, qpos)
    for k, b in enumerate(points.bodies):
        if not standing[:, k].any():
            continue
        sole = _sole(
            points.of_body(int(b)), pose, standing[:, k], contact_tolerance(character.com_height)
        )
        there = kinematics.points(pose, [int(b)] * len(sole), sole)
        body += [int(b)] * len(sole)
        local.append(sole)
        stand.append(np.repeat(standing[:, k, None], len(sole), axis=1))
        place.append(_places(there, standing[:, k], character.floor_height))
    if not body:
        return None
    return Held(
        np.array(body, dtype=np.int64), np.concatenate(local), np.concatenate(place, axis=1),
        np.concatenate(stand, axis=1), sunk=False,
    )  # fmt: skip


def _sole(points: Undersides, pose: kinematics.Pose, stands: Flags, tolerance: float) -> Array:
    """(n, 3) what is lowest under a body where it lies most level in its stances."""
    frames = np.flatnonzero(stands)
    some = kinematics.Pose(pose.position[frames], pose.rotation[frames])
    low = points.lowest(some)
    above = low[..., 2] - low[..., 2].min(axis=1, keepdims=True)
    level = int(np.argmax((above < tolerance).sum(axis=1)))
    under = low[level, above[level] < tolerance]
    angle = (np.arange(MOST_POINTS) + 0.25) * 2 * np.pi / MOST_POINTS
    along = under[:, :2] @ np.stack([np.cos(angle), np.sin(angle)])
    outer = under[np.unique(along.argmax(axis=0))]
    body = int(points.body[0])
    found: Array = (outer - some.position[level, body]) @ some.rotation[level, body]
    return found


def _places(there: Array, stands: Flags, floor: float) -> Array:
    """(T, n, 3) where points (T, n, 3) belong: at rest on the floor in a stance, and in between
    off their own way by what the stances before and after are."""
    shift = np.zeros_like(there)
    for first, last in runs(stands):
        own = there[first : last + 1]
        goal = own.mean(axis=0)
        goal[:, 2] = floor
        shift[first : last + 1] = goal - own
    frames, known = np.arange(len(there)), np.flatnonzero(stands)
    flat = shift.reshape(len(there), -1)
    for c in range(flat.shape[1]):
        flat[:, c] = np.interp(frames, known, flat[known, c])
    placed: Array = there + flat.reshape(there.shape)
    placed[..., 2] = np.maximum(placed[..., 2], floor)  # nothing belongs in the floor
    return placed


def _carried(character: Character, qpos: Array, held: Held, step: float) -> Array:
    """(T, 3) by which the whole body goes along with what it stands on."""
    there = kinematics.trajectories(character.tree, qpos, held.body, held.local)
    weight = np.maximum(held.stand.astype(np.float64), 1e-3)[..., None]
    shift: Array = (weight * (held.place - there)).sum(axis=1) / weight.sum(axis=1)
    width = 2 * max(1, round(ALONG_S / step)) + 1
    for _ in range(2):
        shift = np.asarray(uniform_filter1d(shift, width, axis=0, mode="nearest"))
    return shift


def _support(character: Character, held: Held, settings: WholeBodySettings) -> Support:
    reach = np.ones((2 * settings.reach + 1, 1), dtype=bool)
    on = binary_dilation(held.stand, reach)
    count = np.maximum(on.sum(axis=1), 1)[:, None]
    middle = np.where(on[..., None], held.place, 0.0).sum(axis=1) / count
    place = held.place + settings.inset * (middle[:, None] - held.place)
    price = np.where(held.stand, PRICE_OF_FORCE, PRICE_OF_ABSENCE)
    return Support(place, on, price, settings.friction * character.foot_friction)
