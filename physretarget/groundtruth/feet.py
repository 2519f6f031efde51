"""What ``physretarget forces`` gives per foot against what plates measured under it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physretarget.groundtruth.compare import heading
from physretarget.groundtruth.coverage import Coverage, loads
from physretarget.groundtruth.trial import Floats, Trial
from physretarget.kinetics import DEFAULT_HZ, forces

_CENTRED = 0.1  # BW: a lighter load has no centre worth comparing


@dataclass(frozen=True, kw_only=True)
class FootAgreement:
    """Over the judged frames of both feet, against unfiltered plates; None without any load.

    ``vertical``, ``forward``, ``left``: RMS error in BW of one foot's force; ``total`` that of
    both feet's vertical force. ``centre_forward``, ``centre_left``: RMS error of the centre of
    pressure in m, ``centre_bias`` (2,) its mean, under feet that bear more than 0.1 BW. ``torque``
    and ``no_torque``: RMS error of the free moment in N m, and that of calling it zero.
    ``gain`` and ``flights``: as :class:`physretarget.kinetics.GroundForces` has them.
    """

    total: float
    vertical: float
    forward: float
    left: float
    centre_forward: float
    centre_left: float
    centre_bias: tuple[float, float]
    torque: float
    no_torque: float
    gain: float
    flights: int


def foot_agreement(
    trial: Trial, covered: Coverage, *, hz: float = DEFAULT_HZ
) -> FootAgreement | None:
    """Compare foot by foot, at the low-pass that ``forces`` has by default."""
    frames = covered.judged
    force, point, torque = _measured(trial)
    loaded = (force[..., 2] > _CENTRED * trial.weight) & frames[:, None]
    if not loaded.any():
        return None
    found = forces(trial.motion, lowpass_hz=hz)
    both = (found.left, found.right)
    turn = heading(trial, frames)
    wrong = np.stack([foot.force for foot in both], axis=1) - force
    away = np.stack([foot.point for foot in both], axis=1) - point
    apart = (np.stack([foot.torque for foot in both], axis=1) - torque)[..., 2]
    each = _rms((wrong @ turn.T)[frames].reshape(-1, 3)) / trial.weight
    centre = (away @ turn.T)[loaded]
    bias = centre.mean(axis=0)
    return FootAgreement(
        total=float(_rms(wrong[frames].sum(axis=1))[2]) / trial.weight,
        forward=float(each[0]),
        left=float(each[1]),
        vertical=float(each[2]),
        centre_forward=float(_rms(centre)[0]),
        centre_left=float(_rms(centre)[1]),
        centre_bias=(float(bias[0]), float(bias[1])),
        torque=float(_rms(apart[loaded][:, None])[0]),
        no_torque=float(_rms(torque[loaded][:, 2:])[0]),
        gain=found.vertical_gain,
        flights=found.flights,
    )


def _measured(trial: Trial) -> tuple[Floats, Floats, Floats]:
    """Force, point and torque (T, 2, 3) under left and right foot, at the motion's frames."""
    force, point, torque = np.zeros((3, len(trial.motion.time), 2, 3))
    for plate, foot, frames in loads(trial):
        time = trial.motion.time[frames]
        some = [
            np.stack([np.interp(time, plate.time, column) for column in values.T], axis=1)
            for values in (plate.force, plate.point, plate.torque)
        ]
        force[frames, foot] += some[0]
        point[frames, foot] += some[0][:, 2:] * some[1]
        torque[frames, foot] += some[2]
    point /= np.maximum(force[..., 2:], 1e-9)
    return force, point, torque


def _rms(values: Floats) -> Floats:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
