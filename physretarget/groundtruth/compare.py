"""Ground force predicted from motion alone against what the plates measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from physretarget.errors import InputError
from physretarget.groundtruth.coverage import Coverage, coverage
from physretarget.groundtruth.trial import GRAVITY, Bools, Floats, Trial
from physretarget.kinematics import forward, runs
from physretarget.kinetics import ground_wrench
from physretarget.mjcf import derivatives, lowpass, momentum

_LONGEST_DELAY = 0.05  # s
_FLAT = 0.02  # BW: a measured force that varies less has no shape to correlate with


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Of one component over the judged frames, in BW: predicted minus measured.

    ``r`` is Pearson's; ``slope`` how much the measured force changes per change of the
    predicted one (least squares). Both are None where the measured force is flat.
    """

    rmse: float
    bias: float
    r: float | None
    slope: float | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """One trial at one filter.

    ``predicted`` and ``measured`` (T, 3) BW: forward, to the left, up, as the actor faces on
    average; both filtered at ``hz``. ``raw`` the same, unfiltered. ``frames`` (T,) are those
    judged. ``impulse_ratio``: what the plates measured over the longest judged stretch,
    divided by weight plus change of momentum of the fitted actor, which needs no
    acceleration; None below half a second. ``delay`` s by which the measured vertical force
    would have to come earlier to agree best; None where it is flat.
    """

    name: str
    hz: float
    time: Floats
    predicted: Floats
    measured: Floats
    raw: Floats
    frames: Bools
    forward: Agreement
    left: Agreement
    vertical: Agreement
    vertical_to_raw: Agreement
    impulse_ratio: float | None
    delay: float | None


def compare(trial: Trial, covered: Coverage, *, hz: float) -> Comparison:
    """Predict the total ground force at a low-pass of ``hz`` and compare it, component-wise."""
    motion, character = trial.motion, trial.character
    qpos = lowpass(character, motion.qpos, motion.fps, hz)
    qvel, _ = derivatives(character, qpos, motion.time)
    turn = heading(trial, covered.judged) / trial.weight
    predicted = ground_wrench(motion, hz=hz, character=character).force @ turn.T
    measured = trial.measured(hz)[0] @ turn.T
    raw = trial.measured(None)[0] @ turn.T
    speed = momentum(character, qpos, qvel).linear[:, 2] / character.mass
    frames = covered.judged
    each = [_agreement(predicted[frames, i], measured[frames, i]) for i in range(3)]
    return Comparison(
        name=trial.name,
        hz=hz,
        time=motion.time,
        predicted=predicted,
        measured=measured,
        raw=raw,
        frames=frames,
        forward=each[0],
        left=each[1],
        vertical=each[2],
        vertical_to_raw=_agreement(predicted[frames, 2], raw[frames, 2]),
        impulse_ratio=_impulse_ratio(motion.time, raw[:, 2], speed, frames),
        delay=_delay(motion.time, predicted[:, 2], measured[:, 2], frames),
    )


def with_weight_of_impulse(trial: Trial, *, hz: float) -> Trial:
    """The trial with the weight that makes ``impulse_ratio`` 1.

    For trials in which nobody stood still on the plates. Weight so found says nothing about
    the mean force any more; the force's course is judged as before. Raises InputError where
    less than half a second is covered.
    """
    ratio = compare(trial, coverage(trial), hz=hz).impulse_ratio
    if ratio is None:
        raise InputError(f"{trial.name}: the plates cover too little to tell the body's weight")
    weight = trial.weight * ratio
    shape = replace(trial.motion.shape, mass=weight / GRAVITY)
    return replace(trial, weight=weight, motion=replace(trial.motion, shape=shape))


def heading(trial: Trial, frames: Bools) -> Floats:
    """Rows: forward, left, up; forward is where the pelvis faces on average."""
    chosen = frames if frames.any() else np.ones_like(frames)
    pose = forward(trial.motion.shape.tree(), trial.motion.qpos[chosen])
    x, y = pose.rotation[:, 1, :2, 0].mean(axis=0)
    size = float(np.hypot(x, y))
    return np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, size]]) / size


def _agreement(predicted: Floats, measured: Floats) -> Agreement:
    if not len(measured):
        return Agreement(rmse=float("nan"), bias=float("nan"), r=None, slope=None)
    error = predicted - measured
    shaped = predicted.std() > 0 and measured.std() > _FLAT
    return Agreement(
        rmse=float(np.sqrt(np.mean(error**2))),
        bias=float(error.mean()),
        r=float(np.corrcoef(predicted, measured)[0, 1]) if shaped else None,
        slope=float(np.polyfit(predicted, measured, 1)[0]) if shaped else None,
    )


def _impulse_ratio(time: Floats, raw: Floats, speed: Floats, frames: Bools) -> float | None:
    stretches = runs(frames)
    if not stretches:
        return None
    first, last = max(stretches, key=lambda run: run[1] - run[0])
    duration = float(time[last] - time[first])
    if duration < 0.5:
        return None
    needed = duration + (speed[last] - speed[first]) / GRAVITY
    return float(np.trapezoid(raw[first : last + 1], time[first : last + 1]) / needed)


def _delay(time: Floats, predicted: Floats, measured: Floats, frames: Bools) -> float | None:
    """Of shifts within 50 ms, the one with the least scatter; found between frames by a parabola.

    The scatter about the mean, not the RMSE: a constant offset must not pass for a delay.
    """
    at = np.flatnonzero(frames)
    if not len(at) or measured[at].std() <= _FLAT:
        return None
    step = float(time[1] - time[0])
    reach = max(1, round(_LONGEST_DELAY / step))
    at = at[(at >= reach) & (at < len(time) - reach)]
    shifts = np.arange(-reach, reach + 1)
    scatter = np.array([np.var(measured[at + k] - predicted[at]) for k in shifts])
    best = int(np.argmin(scatter))
    if best in (0, len(shifts) - 1):
        return float(shifts[best] * step)
    before, here, after = scatter[best - 1 : best + 2]
    between = 0.5 * (before - after) / (before - 2 * here + after)
    return float((shifts[best] + between) * step)
