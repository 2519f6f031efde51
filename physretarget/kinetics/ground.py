"""Ground forces of a capture, per foot, without force plates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget import capture as captures
from physretarget.capture.actor import ActorMotion
from physretarget.capture.mot import GroundForce, write_forces
from physretarget.errors import InputError, UsageError
from physretarget.kinetics.feet import FootForce, shared
from physretarget.kinetics.flight import GRAVITY, WORST
from physretarget.kinetics.wrench import GroundWrench, ground_wrench
from physretarget.options.forces import ForcesOptions

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

DEFAULT_HZ: float = ForcesOptions().lowpass_hz or 0.0

_FEET = 4  # contact points of the actor that are feet, the first ones
_OUTSIDE = 0.03  # m: a centre of pressure so far beside the soles is worth a note
_LOADED = 0.2  # BW: a lighter load has no centre of pressure worth a note
_NAMES = ("r", "l")


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundForces:
    """What the ground applies to both feet over T frames; world axes, z up, floor at z = 0.

    ``time`` (T,) s, from 0; ``contact`` (T, 2) whether the left and the right foot touch;
    ``mass`` kg of the body; ``lowpass_hz`` on the motion, None for none; ``vertical_gain`` and
    ``flights``: how much the fitted centre of mass moved more than flights allow, and how many
    they are (1.0 and 0 without); ``outside_m`` (T,) by how much the centre of pressure that the
    motion asks for lies beside the soles that touch; ``notes`` in one sentence each what was
    guessed or left out. ``start`` s: the capture's own time of the first frame.
    """

    time: Floats
    left: FootForce
    right: FootForce
    contact: Bools
    mass: float
    lowpass_hz: float | None
    vertical_gain: float
    flights: int
    outside_m: Floats
    start: float
    notes: tuple[str, ...]

    @property
    def total(self) -> Floats:
        """(T, 3) N, both feet."""
        return np.asarray(self.left.force + self.right.force)

    @property
    def weight(self) -> float:
        """Of the body, N."""
        return self.mass * GRAVITY

    def write(self, path: str | PathLike[str]) -> None:
        """Write an OpenSim ``.mot`` or a ``.csv``, whichever the name's ending asks for.

        Axes are OpenSim's: y up, x and z along the floor, as in a capture whose up axis is y.
        Columns of the right foot are ``ground_force_r_vx`` … N, ``ground_force_r_px`` … m,
        ``ground_torque_r_x`` … N m, those of the left foot have ``l``. Time is the capture's own.

        Args:
            path: A file that ends in .mot or .csv.

        Raises:
            UsageError: the ending is neither.
            InputError: it cannot be written.
        """
        time = self.time + self.start
        write_forces(
            [
                GroundForce(
                    name=name, time=time, force=foot.force, point=foot.point, torque=foot.torque
                )
                for name, foot in zip(_NAMES, (self.right, self.left), strict=True)
            ],
            Path(path),
        )

    def summary(self) -> str:
        """A few lines for people."""
        lines = [
            f"{len(self.time)} frames, {self.time[-1] - self.time[0]:.2f} s, "
            f"{self.mass:.1f} kg ({self.weight:.0f} N = 1 BW), "
            + (f"low-pass {self.lowpass_hz:g} Hz" if self.lowpass_hz else "not filtered")
        ]
        vertical = self.total[:, 2] / self.weight
        lines.append(f"vertical force: mean {vertical.mean():.2f} BW, peak {vertical.max():.2f} BW")
        for name, foot, on in zip(
            ("left", "right"), (self.left, self.right), self.contact.T, strict=True
        ):
            peak = float(foot.force[:, 2].max()) / self.weight
            lines.append(f"{name + ' foot:':11s} on the floor {on.mean():.0%}, peak {peak:.2f} BW")
        if self.vertical_gain != 1.0:
            lines.append(
                f"{self.flights} flights: the fitted centre of mass moved "
                f"{100 * (self.vertical_gain - 1):+.1f} % against g, which is corrected"
            )
        return "\n".join(lines)


def forces(
    capture: ActorMotion | str | PathLike[str],
    *,
    mass: float | None = None,
    lowpass_hz: float | None = DEFAULT_HZ,
    unit: str | None = None,
    up: str | None = None,
    skeleton: str | Path | None = None,
    map: str | Path | None = None,
) -> GroundForces:
    """Ground force, centre of pressure and free moment under each foot, from motion alone.

    Args:
        capture: a capture file, or a motion fitted already.
        mass: kg of the body; by default from the stature, or the motion's own.
        lowpass_hz: on the joint positions; None filters nothing. Captures below 25 frames per
            second get 0.4 times their rate where the default is higher.
        unit: of the file, as for :func:`physretarget.load_capture`.
        up: likewise.
        skeleton: likewise.
        map: likewise.

    Returns:
        Forces, centres of pressure and free moments of both feet.

    Raises:
        InputError: the file cannot be read, or no foot ever touches the floor.
        UsageError: mass or low-pass are impossible.
    """
    if mass is not None and not (np.isfinite(mass) and mass > 0):
        raise UsageError(f"the mass must be a positive number of kilograms, not {mass:g}")
    if isinstance(capture, ActorMotion):
        motion = capture
        if mass is not None:
            motion = replace(motion, shape=replace(motion.shape, mass=float(mass)))
    else:
        motion = captures.load(
            Path(capture), unit=unit, up=up, skeleton=skeleton, mass=mass, map=map
        )
    notes = list(motion.notes)
    if len(motion.time) < 4:
        raise InputError("forces need at least 4 frames", path=motion.source.path)
    if lowpass_hz == DEFAULT_HZ and lowpass_hz > 0.4 * motion.fps:
        lowpass_hz = 0.4 * motion.fps
        notes.append(f"low-pass at {lowpass_hz:g} Hz, since there are {motion.fps:g} frames/s")
    wrench = ground_wrench(motion, hz=lowpass_hz)
    feet = wrench.phases.active[:, :_FEET]
    contact = np.stack([feet[:, :2].any(axis=1), feet[:, 2:].any(axis=1)], axis=1)
    if not contact.any():
        raise InputError(
            "no foot ever stands on the floor: there is nothing to share forces between",
            path=motion.source.path,
        )
    both = shared(motion, wrench, lowpass_hz)
    outside = both.outside
    notes += _notes(motion, wrench, outside)
    return GroundForces(
        time=motion.time, left=both.left, right=both.right, contact=contact,
        mass=float(motion.shape.mass), lowpass_hz=lowpass_hz, vertical_gain=wrench.flights.gain,
        flights=wrench.flights.count, outside_m=outside, start=motion.source.start,
        notes=tuple(notes),
    )  # fmt: skip


def _notes(motion: ActorMotion, wrench: GroundWrench, outside: Floats) -> list[str]:
    notes = []
    if wrench.belt.any():
        speed = float(np.linalg.norm(wrench.belt))
        notes.append(f"a treadmill: its belt runs at {speed:.2f} m/s")
    fall = wrench.flights.fall
    if abs(fall - 1) > WORST:
        notes.append(
            f"its flights fall at {fall:.2f} g, which no body does: frame rate, unit or a contact "
            "that was not found are in doubt, and nothing was corrected by them"
        )
    other = int(wrench.phases.active[:, _FEET:].any(axis=1).sum())
    if other:
        notes.append(
            f"something else than feet touches the floor in {other} of {len(motion.time)} "
            "frames: what it bears is given to the feet, or to nobody where no foot touches"
        )
    loaded = wrench.force[:, 2] > _LOADED * motion.shape.mass * GRAVITY
    beside = int(np.sum((outside > _OUTSIDE) & loaded))
    if beside:
        furthest = 100 * float(outside[loaded].max())
        notes.append(
            f"in {beside} of {len(loaded)} frames the centre of pressure lies up to "
            f"{furthest:.0f} cm beside the soles that touch: it was put on their edge"
        )
    unknown = int(np.sum(~motion.valid))
    if unknown:
        notes.append(f"{unknown} frames have no pose of their own: do not trust forces there")
    return notes
