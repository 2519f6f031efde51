"""Contact phases found in an actor's motion: low and slow, with hysteresis.

The paper set them by hand and named the automatic way as an option (Yamane 2010, section
5.2). Heights and speeds are in m and m/s for a leg of 0.9 m and scale with the actor, times
are in s, so that neither the frame rate nor the actor's size changes the outcome.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from physretarget import kinematics
from physretarget.capture.actor import CONTACT_POINTS, ActorMotion
from physretarget.contact.phases import Phases
from physretarget.kinematics import runs

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

FEET = ("left_heel", "left_toe", "right_heel", "right_toe")
_LEG = 0.9  # m, hip to floor of the actor that the thresholds are stated for


@dataclass(frozen=True, kw_only=True)
class DetectionSettings:
    """Thresholds for a leg of 0.9 m.

    A point is planted from ``height_on`` (m over its rest height) and ``speed_on`` (m/s)
    down, and stays so up to ``height_off`` and ``speed_off``; below ``height_on`` it may even
    slide at ``speed_slide``, since feet do in many captures. Pauses shorter than
    ``min_pause`` s are closed, then phases shorter than ``min_phase`` s dropped. Positions
    are low-passed at ``lowpass_hz`` before speeds are taken. ``points`` to look at;
    ``floor_m`` the height of the floor, found from the feet if None; ``rest_spread`` how far
    a foot point's own rest height may lie from the floor, m.

    Feet also stand on steps and platforms: where nothing touches the floor, a foot that stays
    below ``speed_still`` for ``min_still`` s and has the pelvis ``upright`` m or more above it
    bears the body; so does one that rests beside it at the same height.
    """

    height_on: float = 0.04
    height_off: float = 0.07
    speed_on: float = 0.6
    speed_off: float = 1.0
    speed_slide: float = 1.2
    min_phase: float = 0.07
    min_pause: float = 0.07
    lowpass_hz: float = 12.0
    points: tuple[str, ...] = CONTACT_POINTS
    floor_m: float | None = None
    rest_spread: float = 0.06
    speed_still: float = 0.3
    min_still: float = 0.12
    upright: float = 0.55


def detect_phases(motion: ActorMotion, *, settings: DetectionSettings | None = None) -> Phases:
    """When each contact point of the actor stands on the floor.

    Frames that the capture could not give (``motion.valid`` False) have no contact.

    Args:
        motion: The actor's motion.
        settings: Thresholds, the defaults if None.

    Returns:
        When which of the actor's points stands.
    """
    settings = settings or DetectionSettings()
    segment, local = motion.shape.contact_points()
    wanted = [CONTACT_POINTS.index(name) for name in settings.points]
    position = kinematics.trajectories(
        motion.shape.tree(), motion.qpos, segment[wanted] + 1, local[wanted]
    )
    scale = motion.shape.leg_length / _LEG
    active = detect(position, motion.time, settings.points, scale=scale, settings=settings)
    return Phases(settings.points, active & motion.valid[:, None], motion.time)


def detect(
    position: Floats,
    time: Floats,
    names: tuple[str, ...],
    *,
    scale: float = 1.0,
    settings: DetectionSettings | None = None,
) -> Bools:
    """(T, n) when points at ``position`` (T, n, 3) stand; ``scale`` is leg length / 0.9 m."""
    settings = settings or DetectionSettings()
    if len(time) < 4:
        return np.zeros(position.shape[:2], dtype=bool)
    known = np.asarray(np.isfinite(position).all(axis=-1), dtype=np.bool_)
    position = _filled(position, known, time)
    step = float(np.median(np.diff(time)))
    smooth = _lowpassed(position, 1.0 / step, settings.lowpass_hz)
    speed = np.linalg.norm(np.gradient(smooth, time, axis=0), axis=-1)
    speed = speed / scale**0.5  # Froude: speeds scale like the square root of a length
    rest = rest_heights(smooth[..., 2], speed < settings.speed_off, names, scale, settings)
    height = (smooth[..., 2] - rest) / scale
    low = height < settings.height_on
    on = low & (speed < settings.speed_on)
    hold = (height < settings.height_off) & (speed < settings.speed_off)
    hold |= low & (speed < settings.speed_slide)
    found: Bools = np.zeros(on.shape, dtype=np.bool_)
    for k in range(on.shape[1]):
        found[:, k] = _steadied(on[:, k], hold[:, k], time, step, settings)
    found &= known
    found |= _on_steps(smooth, speed, found, time, names, scale, settings) & known
    return found


def _on_steps(
    position: Floats,
    speed: Floats,
    found: Bools,
    time: Floats,
    names: tuple[str, ...],
    scale: float,
    settings: DetectionSettings,
) -> Bools:
    """Feet that stand on something above the floor (T, n), as ``DetectionSettings`` has it."""
    standing = np.zeros_like(found)
    if "pelvis" not in names:
        return standing
    pelvis = position[:, names.index("pelvis"), 2]
    feet = [k for k, name in enumerate(names) if name in FEET]
    rests: list[tuple[int, float, Bools]] = []  # foot point, its height, frames
    for k in feet:
        for first, last in runs((speed[:, k] < settings.speed_still) & ~found[:, k]):
            if time[last] - time[first] < settings.min_still:
                continue
            level = float(np.median(position[first : last + 1, k, 2]))
            above = float(np.median(pelvis[first : last + 1])) - level
            if above >= settings.upright * scale:
                rests.append((k, level, _around(position, speed, k, level, first, scale, settings)))
    for alone in (True, False):
        for k, level, frames in rests:
            beside = [
                other
                for j, height, other in rests
                if j != k and abs(height - level) < settings.height_on * scale
                if standing[other, j].any() and (other & frames).any()
            ]
            unborne = frames & ~found.any(axis=1)
            span = float(unborne.sum()) * float(np.median(np.diff(time)))
            if (alone and span >= settings.min_still) or (not alone and beside):
                standing[frames, k] = True
    return standing


def _around(
    position: Floats,
    speed: Floats,
    k: int,
    level: float,
    frame: int,
    scale: float,
    settings: DetectionSettings,
) -> Bools:
    """(T,) the frames around one in which a point stays near its height and slow."""
    near = np.abs(position[:, k, 2] - level) < settings.height_on * scale
    near &= speed[:, k] < settings.speed_on
    inside = np.zeros(len(near), dtype=np.bool_)
    for first, last in runs(near):
        if first <= frame <= last:
            inside[first : last + 1] = True
    return inside


def _filled(position: Floats, known: Bools, time: Floats) -> Floats:
    """Gaps bridged by straight lines, so that the filter passes; a point never seen is far off."""
    if known.all():
        return position
    filled = position.copy()
    for k in range(position.shape[1]):
        seen = known[:, k]
        for axis in range(3):
            if seen.any():
                filled[:, k, axis] = np.interp(time, time[seen], position[seen, k, axis])
            else:
                filled[:, k, axis] = 1e3
    return filled


def rest_heights(
    height: Floats,
    slow: Bools,
    names: tuple[str, ...],
    scale: float,
    settings: DetectionSettings,
) -> Floats:
    """(n,) the height at which each point rests on the floor.

    The floor of a capture is rarely at zero and the soles of a fitted actor are a few cm
    off, heel and toe differently: feet rest at their own lowest slow height, as long as that
    is near the lowest one of all. Other points rest on the floor.
    """
    feet = [k for k, name in enumerate(names) if name in FEET]
    own: dict[int, float] = {}
    for k in feet:
        if slow[:, k].sum() >= 3:
            own[k] = float(np.quantile(height[slow[:, k], k], 0.1))
    floor = settings.floor_m
    if floor is None:
        floor = min(own.values(), default=float(np.quantile(height[:, feet or slice(None)], 0.1)))
    rest = np.full(len(names), floor)
    for k, value in own.items():
        if abs(value - floor) < settings.rest_spread * scale:
            rest[k] = value
    return rest


def _steadied(
    on: Bools, hold: Bools, time: Floats, step: float, settings: DetectionSettings
) -> Bools:
    """Hysteresis: runs of ``hold`` that are ``on`` somewhere; then flicker removed."""
    phases = [run for run in runs(hold) if on[run[0] : run[1] + 1].any()]
    closed: list[tuple[int, int]] = []
    for first, last in phases:
        if closed and time[first] - time[closed[-1][1]] - step < settings.min_pause:
            closed[-1] = (closed[-1][0], last)
        else:
            closed.append((first, last))
    found = np.zeros(len(on), dtype=bool)
    for first, last in closed:
        if time[last] - time[first] + step >= settings.min_phase:
            found[first : last + 1] = True
    return found


def _lowpassed(position: Floats, fps: float, hz: float) -> Floats:
    """Zero-lag 4th order Butterworth (2nd order, forwards and back); none above 0.45 fps."""
    if hz >= 0.45 * fps or len(position) < 16:
        return position
    smooth: Floats = sosfiltfilt(butter(2, hz, fs=fps, output="sos"), position, axis=0)
    return smooth
