"""Captures: files in, joints or markers over time out, and an actor fitted to them.

:func:`read` gives what a file holds, :func:`load` an actor's motion, whatever the format.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from physretarget.capture.actor import ActorMotion
from physretarget.capture.inspection import Inspection, inspect_recording
from physretarget.capture.joints import fit_joints
from physretarget.capture.level import floor_plane, turned
from physretarget.capture.moving_floor import find_moving_floor, held_still
from physretarget.capture.name_map import load_map
from physretarget.capture.plausible import doubts
from physretarget.capture.reader import READERS, ReadOptions, find_reader
from physretarget.capture.recording import JointRecording, MarkerRecording
from physretarget.errors import InputError, UsageError
from physretarget.options import find, options_of
from physretarget.options.motion import CaptureOptions, Resampling

__all__ = ["READERS", "Inspection", "find_reader", "inspect", "load", "read"]


def read(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    skeleton: str | Path | None = None,
    subject: str | None = None,
    rate: float | None = None,
    map: str | Path | None = None,
) -> JointRecording | MarkerRecording:
    """Read a capture: metres, z up; unit and up axis are guessed, and noted, unless told.

    Args:
        path: The capture; its format is known by its content, then by its name's ending.
        unit: m, cm, mm, inch, cmu or metres per unit as a number.
        up: x, y, z, -x, -y or -z.
        skeleton: The ASF file of an AMC motion.
        subject: Whom to take where a file holds several people: a name, or a number from 1.
        rate: Frames per second of a file that does not say.
        map: A TOML file that says which joint or marker is which part of the body.

    Returns:
        Joints or markers over time, metres, z up.

    Raises:
        InputError: The file cannot be used, or nobody of that name is in it.
        MissingExtraError: A library for this format is not installed.
    """
    names = None if map is None else load_map(map)
    options = ReadOptions(
        unit=unit, up=up, skeleton=skeleton, subject=subject, rate=rate, names=names
    )
    return find_reader(path).read(path, options)


def inspect(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    skeleton: str | Path | None = None,
    mass: float | None = None,
    subject: str | None = None,
    rate: float | None = None,
    hold_floor: bool = False,
    map: str | Path | None = None,
) -> Inspection:
    """Who is which joint or marker of a capture, how well each fits, and what is doubtful.

    Args and Raises as in :func:`load`.

    Args:
        path: The capture.
        unit: m, cm, mm, inch, cmu or metres per unit.
        up: x, y, z, -x, -y or -z.
        skeleton: The ASF file of an AMC motion.
        mass: Of the actor, kg.
        subject: Whom to take of several people.
        rate: Frames per second of a file that does not say.
        hold_floor: Take out the motion of a moving floor.
        map: See :func:`read`.

    Returns:
        Who is what, residuals in m, guesses and doubts.
    """
    recording = read(path, unit=unit, up=up, skeleton=skeleton, subject=subject, rate=rate, map=map)
    return inspect_recording(*_actor_in(recording, mass, hold_floor=hold_floor))


def load(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    skeleton: str | Path | None = None,
    mass: float | None = None,
    fps: float | None = None,
    max_seconds: float | None = None,
    subject: str | None = None,
    rate: float | None = None,
    hold_floor: bool = False,
    on_doubt: Literal["note", "fail"] = "note",
    map: str | Path | None = None,
) -> ActorMotion:
    """Read a capture and fit the actor to it.

    A floor that is tilted in the file is levelled. The motion's ``notes`` say what was guessed or
    repaired, and what is doubtful.

    Args:
        path: The capture.
        unit: See :func:`read`, as for ``up`` and ``skeleton``.
        up: The file's up axis.
        skeleton: The ASF file of an AMC motion.
        mass: The actor's mass in kg; by default from the height.
        fps: Frames per second to resample to.
        max_seconds: How much of the take's start to keep, s.
        subject: See :func:`read`.
        rate: See :func:`read`.
        hold_floor: Take out the motion of a floor that moves (a treadmill's belt, a drift); by
            default it is only told.
        on_doubt: What to do where the motion could not be a human's on a floor: note it, or fail.
        map: See :func:`read`.

    Returns:
        The actor's motion, z up, in metres and seconds.

    Raises:
        InputError: The file cannot be used, or is doubtful and ``on_doubt`` says fail.
        UsageError: A value is out of its range.
    """
    CaptureOptions(mass=mass, rate=rate, on_doubt=on_doubt)  # refuses what is out of range
    if fps is not None:
        find("fps", options_of(Resampling)).read(fps, "fps")
    recording = read(path, unit=unit, up=up, skeleton=skeleton, subject=subject, rate=rate, map=map)
    if max_seconds is not None:
        recording = _start(recording, max_seconds)
    _, motion = _actor_in(recording, mass, hold_floor=hold_floor)
    if motion.doubts and on_doubt == "fail":
        raise InputError("; ".join(motion.doubts), path=path)
    return motion.resampled(fps) if fps is not None else motion


def _refuse_nan(recording: JointRecording) -> None:
    """A skeleton file has no gaps as markers have: a NaN in it is damage, which is named."""
    pose = np.concatenate([recording.position[..., None], recording.rotation], axis=3)
    bad = np.isnan(pose.sum(axis=(2, 3)))
    if bad.any():
        frame, joint = (int(i) for i in np.argwhere(bad)[0])
        raise InputError(
            f"joint {recording.names[joint]!r} is not a number; "
            f"{len(np.unique(np.argwhere(bad)[:, 0]))} of {len(bad)} frames are damaged so.",
            path=recording.source.path,
            frame=frame,
        )


def _kept(time: np.ndarray[tuple[int, ...], np.dtype[np.float64]], seconds: float) -> int:
    if not seconds > 0:
        raise UsageError(f"At most {seconds:g} seconds were asked for; that keeps nothing.")
    return max(1, int(np.searchsorted(time, seconds + 1e-9)))


def _actor_in(
    recording: JointRecording | MarkerRecording, mass: float | None, *, hold_floor: bool
) -> tuple[JointRecording | MarkerRecording, ActorMotion]:
    """The recording on a level floor that keeps still as far as asked for, and the actor in it."""
    if isinstance(recording, JointRecording):
        _refuse_nan(recording)
    motion, said = _fit(recording, mass), []
    plane = floor_plane(motion)
    if plane is not None and plane.leans:
        recording = turned(recording, plane.normal)
        motion = _fit(recording, mass)
        said.append(
            f"the floor is tilted by {np.degrees(plane.tilt):.1f} degrees in the file: levelled"
        )
    moving = find_moving_floor(motion)
    if moving is not None and hold_floor:
        recording = held_still(recording, moving.velocity)
        motion = _fit(recording, mass)
        said.append(f"{moving.sentence}: taken out")
        moving = None
    found = doubts(motion, plane, moving)
    return recording, replace(motion, notes=(*motion.notes, *said, *found), doubts=found)


def _fit(recording: JointRecording | MarkerRecording, mass: float | None) -> ActorMotion:
    if isinstance(recording, JointRecording):
        return fit_joints(recording, mass=mass)
    from physretarget.capture.markers import fit_markers

    return fit_markers(recording, mass=mass)


def _start(
    recording: JointRecording | MarkerRecording, seconds: float
) -> JointRecording | MarkerRecording:
    n = _kept(recording.time, seconds)
    cut = replace(recording, time=recording.time[:n], position=recording.position[:n])
    if isinstance(cut, JointRecording):
        cut = replace(cut, rotation=cut.rotation[:n])
    return cut
