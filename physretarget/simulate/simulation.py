"""What a simulation gave: the motion, the torques behind it, how well it follows the clip."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.clip import Clip
from physretarget.files import npz_bytes, write_file
from physretarget.simulate.track import Ending

__all__ = ["Simulation", "SimulationMeasures", "options_text"]

Array = NDArray[np.float64]

_FAIR_SHARE = 0.05
"""Deviation, of the height, that halves the score: what a run may have (docs/validate.md)."""
_FAIR_FORCE = 0.05
"""Assist, BW RMS, that halves the score: residual forces of 5 % (Hicks et al. 2015)."""


_UNITS = {
    "survived_s": "s",
    "tracking_rms_m": "m",
    "tracking_share": "1",
    "assist_force_rms_bw": "BW",
    "assist_moment_rms_bwh": "BW·h",
    "torque_saturated_fraction": "1",
    "joint_limit_excess_max_rad": "rad",
    "trackability": "1",
}


@dataclass(frozen=True, kw_only=True)
class SimulationMeasures:
    """How well a simulation follows its clip.

    Attributes:
        duration_s: of the clip. survived_s: until the body was lost, or the clip's end.
        tracking_rms_m: root-mean-square error of the markers over the time survived.
        tracking_share: the same in heights.
        assist_force_rms_bw, assist_moment_rms_bwh: help on the root, in body weights and body
            weights times the height of the centre of mass; zero without assist.
        torque_saturated_fraction: share of torques, over joints and time, at their limit.
        joint_limit_excess_max_rad: how far a joint went past its limits (rad or m).
    """

    duration_s: float
    survived_s: float
    tracking_rms_m: float
    tracking_share: float
    assist_force_rms_bw: float
    assist_moment_rms_bwh: float
    torque_saturated_fraction: float
    joint_limit_excess_max_rad: float

    @staticmethod
    def units() -> dict[str, str]:
        """Unit of every measure by its public name."""
        return {f"sim_{name}": unit for name, unit in _UNITS.items()}

    def named(self) -> dict[str, tuple[float, str]]:
        """Value and unit of every measure by its public name."""
        return {f"sim_{name}": (getattr(self, name), unit) for name, unit in _UNITS.items()}

    @property
    def trackability(self) -> float:
        """1 for a clip that plays as it is, towards 0 with what it lacks; deviation and assist."""
        share = self.survived_s / self.duration_s
        lack = self.tracking_share / _FAIR_SHARE + self.assist_force_rms_bw / _FAIR_FORCE
        return share / (1.0 + lack)


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation:
    """A simulation and its proof.

    Attributes:
        clip: the motion as simulated, one frame per step.
        timestep: s. qvel0: (nv,) speed at the first frame.
        qfrc_applied: (N, nv) what acted in each step, N m or N; the root's rows are the assist.
        gain: (K, nu, 2 nv) feedback on the controlled degrees of freedom from the departure in
            pose and speed, each held from its ``gain_time`` (K,) s on.
        controls: (nu,) the controlled degrees of freedom.
        torque_limit: (nv,) bound of each torque, infinite for the root.
        options: fields of mjOption by name, JSON text.
        model_xml: what was simulated where it was not the character's file, else empty.
        errors: (K + 1,) marker error at the start and after each torque, m.
        ending: how it ended. lift_m: by which the clip was raised out of the floor.
        measures: numbers of all this. notes: what was assumed or changed, one sentence each.
        cpu_s: CPU-seconds that it took.
    """

    clip: Clip
    timestep: float
    qvel0: Array
    qfrc_applied: Array
    gain: NDArray[np.float32]
    gain_time: Array
    controls: NDArray[np.int64]
    torque_limit: Array
    options: str
    model_xml: str
    errors: Array
    ending: Ending
    lift_m: float
    measures: SimulationMeasures
    notes: tuple[str, ...]
    cpu_s: float

    @property
    def survived(self) -> bool:
        """Whether it came to the clip's end."""
        return self.ending == "end"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write ``SIM.npz``: a clip file with the proof in it, see docs/validate.md.

        Args:
            path: The .npz file.
        """
        proof: dict[str, NDArray[Any]] = {
            "sim_timestep": np.array(self.timestep),
            "sim_qpos0": self.clip.qpos[0],
            "sim_qvel0": self.qvel0,
            "sim_qfrc_applied": self.qfrc_applied,
            "sim_gain": self.gain,
            "sim_gain_time": self.gain_time,
            "sim_controls": self.controls,
            "sim_torque_limit": self.torque_limit,
            "sim_options": np.array(self.options, dtype=np.str_),
            "sim_model_xml": np.array(self.model_xml, dtype=np.str_),
        }
        write_file(path, npz_bytes({**self.clip.arrays(), **proof}))


def options_text(model: mujoco.MjModel) -> str:
    """All fields of a model's mjOption as JSON: numbers and lists of numbers, by name."""
    fields: dict[str, Any] = {}
    for name in dir(model.opt):
        value = getattr(model.opt, name)
        if name.startswith("_") or callable(value):
            continue
        fields[name] = value.tolist() if isinstance(value, np.ndarray) else value
    return json.dumps(fields, sort_keys=True)
