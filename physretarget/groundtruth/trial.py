"""A trial: a motion fitted to markers and the ground forces measured with it, on one clock."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget import capture, mjcf
from physretarget.capture.actor import ActorMotion
from physretarget.capture.mot import GroundForce, read_mot
from physretarget.capture.recording import MarkerRecording
from physretarget.errors import InputError, UsageError
from physretarget.mjcf import Character, actor_character

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

GRAVITY = 9.81  # m/s², MuJoCo's and this package's
_STEADY = 0.02  # a standing body's total force varies by less than this share


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """``motion`` stands on z = 0; ``forces`` are on its clock, their points on z = 0 too.

    ``weight`` N of the body is the unit of every force.
    """

    name: str
    motion: ActorMotion
    forces: tuple[GroundForce, ...]
    weight: float

    @cached_property
    def character(self) -> Character:
        """The fitted actor with its masses."""
        return actor_character(self.motion.shape)

    @property
    def known(self) -> Bools:
        """(T,) frames for which every force column has a value."""
        first = max(force.time[0] for force in self.forces)
        last = min(force.time[-1] for force in self.forces)
        time = self.motion.time
        known: Bools = (time >= first - 1e-6) & (time <= last + 1e-6)
        return known

    def measured(self, hz: float | None) -> tuple[Floats, Floats]:
        """Total force (T, 3) N and its moment about the world's origin (T, 3) N m.

        Filtered at the plates' own rate by the filter that the motion gets, then sampled at
        the motion's frames. Both are linear in what the plates measure; a centre of pressure
        is not, so it is never filtered.
        """
        total, about_origin = np.zeros((2, len(self.motion.time), 3))
        for force in self.forces:
            moment = np.cross(force.point, force.force) + force.torque
            for into, values in ((total, force.force), (about_origin, moment)):
                smooth = smoothed(values, force.time, hz)
                for axis in range(3):
                    into[:, axis] += np.interp(self.motion.time, force.time, smooth[:, axis])
        return total, about_origin


def smoothed(values: Floats, time: Floats, hz: float | None) -> Floats:
    """The filter of ``mjcf.lowpass`` for plain columns (T, n); None filters nothing."""
    if hz is None or len(values) < 3:
        return values
    fps = float((len(time) - 1) / (time[-1] - time[0]))
    if not 0 < hz < 0.5 * fps:
        raise UsageError(f"a low-pass of {hz:g} Hz is not possible at {fps:g} per second")
    return mjcf.smoothed(values, fps, hz)


def standing_weight(path: str | Path) -> float:
    """Body weight in N from the forces (.mot) of a trial in which somebody stands still.

    Raises InputError where the total vertical force is not steady.
    """
    vertical = np.sum([force.force[:, 2] for force in read_mot(path)], axis=0)
    weight = float(vertical.mean())
    if not weight > 0 or float(vertical.std()) > _STEADY * weight:
        raise InputError("nobody stands still on the plates: the force is not steady", path=path)
    return weight


def load_trial(markers: str | Path, forces: str | Path, *, weight: float) -> Trial:
    """Fit an actor of ``weight`` N to the markers and put the forces on the motion's clock.

    Both files must share one clock and one set of axes, as OpenSim's pairs do. The feet were
    put on z = 0 by the fit, so the centres of pressure are put there as well.
    """
    motion = capture.load(markers, mass=float(weight) / GRAVITY)
    placed = []
    for force in read_mot(forces, up=motion.source.up):
        point = force.point.copy()
        point[:, 2] = 0.0
        placed.append(replace(force, time=force.time - motion.source.start, point=point))
    trial = Trial(
        name=Path(markers).stem, motion=motion, forces=tuple(placed), weight=float(weight)
    )
    if not trial.known.any():
        raise InputError("markers and forces have no time in common", path=forces)
    return trial


def load_plate_trial(path: str | Path, *, weight: float) -> Trial:
    """The trial of a file (.c3d) that holds its force plates beside the markers.

    Raises InputError for a file without plates.
    """
    recording = capture.read(path)
    plates = recording.plates if isinstance(recording, MarkerRecording) else ()
    if not plates:
        raise InputError("the file holds no force plates", path=path)
    forces = []
    for plate in plates:
        point = np.nan_to_num(plate.point)  # no point where there is no force
        point[:, 2] = 0.0
        forces.append(
            GroundForce(
                name=plate.name,
                time=plate.time,
                force=np.nan_to_num(plate.force),
                point=point,
                torque=np.nan_to_num(plate.free_moment),
            )
        )
    motion = capture.load(path, mass=float(weight) / GRAVITY)
    return Trial(name=Path(path).stem, motion=motion, forces=tuple(forces), weight=float(weight))


def load_trials(folder: str | Path, *, weight: float | None = None) -> tuple[Trial, ...]:
    """All pairs NAME.trc and NAME_grf.mot of a folder, by name.

    ``weight`` N; without it the trial named ``static…`` gives it. Raises InputError where
    there are no pairs, or no such trial.
    """
    folder = Path(folder)
    pairs = [(path, path.with_name(f"{path.stem}_grf.mot")) for path in folder.glob("*.trc")]
    pairs = sorted(pair for pair in pairs if pair[1].exists())
    if not pairs:
        raise InputError("there is no pair of NAME.trc and NAME_grf.mot", path=folder)
    if weight is None:
        static = [forces for markers, forces in pairs if markers.stem.startswith("static")]
        if not static:
            raise InputError("no trial is named static…: tell the body weight", path=folder)
        weight = standing_weight(static[0])
    return tuple(load_trial(markers, forces, weight=weight) for markers, forces in pairs)
