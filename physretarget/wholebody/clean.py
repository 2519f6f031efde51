"""What is wrong with a clip as data: frames that are off, jumps of the root, noise, limits.

Mended before anything is asked of the floor: a spike is no motion, and noise hides who stands.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from physretarget import kinematics
from physretarget.kinematics import Tree
from physretarget.mjcf import Character
from physretarget.mjcf.dynamics import lowpass

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

OFF = np.radians(3.0)
"""A frame is off by more than this from the middle of its neighbours, rad, or 3 % of the height."""
OFF_M = 0.03
UNLIKE = 6.0
"""And by so many times the median around it."""
AROUND_S = 0.5
NOISE, NOISE_M = np.radians(0.3), 0.001
"""White noise (standard deviation, rad, and over the height) above which a clip is filtered."""
CUTOFF_HZ = 6.0
"""Biomechanics' standard low-pass (Winter 2009)."""


def cleaned(character: Character, qpos: Array, time: Array) -> tuple[Array, tuple[str, ...]]:
    """The clip (T, nq) without spikes, jumps, noise and angles beyond limits, and what was done."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    found, notes = qpos.copy(), []
    found, count = _without_spikes(character, found, step)
    if count:
        notes.append(f"{_frames(count)} off for a moment, put between their neighbours.")
    found, count = _without_jumps(character, found, step)
    if count:
        notes.append(f"Jumps of the root ({count}): what follows is moved back.")
    noise = noise_of(character, found)
    if noise > 1.0:
        found = lowpass(character, found, 1.0 / step, CUTOFF_HZ)
        notes.append(f"The clip shakes: low-passed at {CUTOFF_HZ:g} Hz.")
    at = character.tree.scalars[0]
    inside = np.clip(found[:, at], character.lower[at], character.upper[at])
    beyond = int((inside != found[:, at]).any(axis=1).sum())
    if beyond:
        found[:, at] = inside
        notes.append(f"{_frames(beyond)} beyond joint limits, put on them.")
    return found, tuple(notes)


def noise_of(character: Character, qpos: Array) -> float:
    """White noise in the noisiest coordinate, in units of what is tolerated.

    Of fourth differences, in which noise is √70 times itself and motion is little: their median,
    so that a few sharp moments do not count.
    """
    if len(qpos) < 9:
        return 0.0
    velocity = kinematics.difference(character.tree, qpos[:-1], qpos[1:])
    fourth = np.diff(velocity, 3, axis=0)
    deviation = np.median(np.abs(fourth), axis=0) / (0.6745 * np.sqrt(70.0))
    return float((deviation / _units(character, NOISE, NOISE_M)).max(initial=0.0))


def _units(character: Character, angle: float, share: float) -> Array:
    """(nv,) a length for what slides, an angle for what turns."""
    turns = character.tree.tables.dof_turns.astype(bool)
    units: Array = np.where(turns, angle, share * character.height)
    return units


def _frames(count: int) -> str:
    return "1 frame is" if count == 1 else f"{count} frames are"


def _without_spikes(character: Character, qpos: Array, step: float) -> tuple[Array, int]:
    """Single frames off their neighbours, coordinate by coordinate."""
    tree = character.tree
    middle = _middle(tree, qpos)
    off = kinematics.difference(tree, middle, qpos[1:-1])
    size = np.abs(off)
    quiet = UNLIKE * _around(size, step) + _units(character, OFF, OFF_M)
    beside = np.pad(size, ((1, 1), (0, 0)))
    alone = size > 1.5 * np.maximum(beside[:-2], beside[2:])
    spike = alone & (size > quiet)
    back = np.where(spike, -off, 0.0)
    found = qpos.copy()
    found[1:-1] = kinematics.integrate(tree, qpos[1:-1], back)
    return found, int(spike.any(axis=1).sum())


def _without_jumps(character: Character, qpos: Array, step: float) -> tuple[Array, int]:
    """Steps of the root along the floor that are none of the motion's: the rest goes along."""
    plane = slice(character.root_qpos, character.root_qpos + 2)
    way = np.diff(qpos[:, plane], axis=0)
    usual = way.copy()
    usual[1:-1] = 0.5 * (way[:-2] + way[2:])
    excess = np.linalg.norm(way - usual, axis=1)
    quiet = UNLIKE * _around(excess[:, None], step)[:, 0] + OFF_M * character.height
    beside = np.pad(excess, 1)
    jump = (excess > quiet) & (excess > 1.5 * np.maximum(beside[:-2], beside[2:]))
    back = np.where(jump[:, None], usual - way, 0.0)
    found = qpos.copy()
    found[1:, plane] += np.cumsum(back, axis=0)
    return found, int(jump.sum())


def _middle(tree: Tree, qpos: Array) -> Array:
    """(T - 2, nq) half way between the frame before and the one after."""
    before, after = qpos[:-2], qpos[2:]
    half: Array = kinematics.integrate(
        tree, before, 0.5 * kinematics.difference(tree, before, after)
    )
    return half


def _around(size: Array, step: float) -> Array:
    """Median over :data:`AROUND_S` on either side."""
    width = 2 * max(2, round(AROUND_S / step)) + 1
    found: Array = median_filter(size, size=(width, 1), mode="nearest")
    return found
