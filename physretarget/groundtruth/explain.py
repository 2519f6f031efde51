"""What no ground force explains, with the plates' forces and with fitted ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physretarget.clip import Clip
from physretarget.groundtruth.coverage import Coverage
from physretarget.groundtruth.trial import Bools, Floats, Trial
from physretarget.mjcf import derivatives, lowpass, required_wrench
from physretarget.validation import Settings, validate


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Required wrench minus ground forces over the judged frames, moments about the CoM.

    RMS and peak in BW and BW h (h: CoM height of the reference pose). ``force_share`` and
    ``moment_share``: the peaks over the peak external force, and over that times h, to be read
    against 5 % and 1 % (Hicks et al. 2015).
    """

    force_rms: float
    force_peak: float
    moment_rms: float
    moment_peak: float
    force_share: float
    moment_share: float


def by_measured_forces(trial: Trial, covered: Coverage, *, hz: float) -> Unexplained:
    """With the plates' forces at their own centres of pressure and their free moments."""
    motion, character = trial.motion, trial.character
    qpos = lowpass(character, motion.qpos, motion.fps, hz)
    wrench = required_wrench(character, qpos, *derivatives(character, qpos, motion.time))
    force, about_origin = trial.measured(hz)
    required = wrench.moment + np.cross(wrench.root - wrench.com, wrench.force)
    moment = required - (about_origin - np.cross(wrench.com, force))
    return _summary(trial, covered.judged, wrench.force - force, moment, force)


def by_fitted_forces(trial: Trial, covered: Coverage, *, hz: float) -> Unexplained:
    """With the forces that the validator fits inside friction cones: nothing is measured."""
    settings = Settings(lowpass_hz=hz, select=("DYN001", "DYN002"))
    clip = Clip(qpos=trial.motion.qpos, time=trial.motion.time, model_name=trial.name)
    series = validate(clip, trial.character, settings=settings).series
    height = trial.character.com_height
    force = series["unexplained_force_bw"].astype(np.float64) * trial.weight
    moment = series["unexplained_moment_bwh"].astype(np.float64) * trial.weight * height
    measured = trial.measured(hz)[0]
    return _summary(trial, covered.judged, force[:, None], moment[:, None], measured)


def _summary(
    trial: Trial, frames: Bools, force: Floats, moment: Floats, measured: Floats
) -> Unexplained:
    if not frames.any():
        nothing = float("nan")
        return Unexplained(
            force_rms=nothing, force_peak=nothing, moment_rms=nothing,
            moment_peak=nothing, force_share=nothing, moment_share=nothing,
        )  # fmt: skip
    sizes = [np.linalg.norm(values[frames], axis=1) for values in (force, moment, measured)]
    force_bw = sizes[0] / trial.weight
    moment_bwh = sizes[1] / (trial.weight * trial.character.com_height)
    peak = float(sizes[2].max()) / trial.weight
    return Unexplained(
        force_rms=float(np.sqrt(np.mean(force_bw**2))),
        force_peak=float(force_bw.max()),
        moment_rms=float(np.sqrt(np.mean(moment_bwh**2))),
        moment_peak=float(moment_bwh.max()),
        force_share=float(force_bw.max()) / peak,
        moment_share=float(moment_bwh.max()) / peak,
    )
