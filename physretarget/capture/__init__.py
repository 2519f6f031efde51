"""Captures: files in, joints or markers over time out, and an actor fitted to them.

:func:`read` gives what a file holds, :func:`load` an actor's motion, whatever the format.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from physretarget.capture.actor import ActorMotion
from physretarget.capture.amc import read_amc
from physretarget.capture.bvh import read_bvh
from physretarget.capture.deepmimic import read_deepmimic
from physretarget.capture.inspection import Inspection, inspect_recording
from physretarget.capture.joints import fit_joints
from physretarget.capture.level import floor_plane, turned
from physretarget.capture.marker_file import markers_of
from physretarget.capture.moving_floor import find_moving_floor, held_still
from physretarget.capture.plausible import doubts
from physretarget.capture.recording import JointRecording, MarkerRecording
from physretarget.errors import InputError, UsageError
from physretarget.options import find, options_of
from physretarget.options.motion import CaptureOptions, Resampling

__all__ = ["FORMATS", "Inspection", "detect_format", "inspect", "load", "read"]

FORMATS = {
    "bvh": "BVH skeleton and motion (.bvh)",
    "c3d": "optical markers (.c3d)",
    "trc": "optical markers as text (.trc)",
    "amc": "Acclaim motion with its .asf skeleton (.amc)",
    "deepmimic": "DeepMimic humanoid3d motion, JSON (.txt, .json)",
}


def detect_format(path: str | Path) -> str:
    """The capture format of a file, by its content first, then by its name's ending."""
    path = Path(path)
    if not path.exists():
        raise InputError("The file does not exist.", path=path)
    if not path.is_file():
        raise InputError("This is a folder or a device, not a file.", path=path)
    with path.open("rb") as file:
        head = file.read(512)
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    ending = path.suffix.lower()
    if ending == ".asf":
        raise InputError("An ASF file is a skeleton alone: give the AMC motion.", path=path)
    if text.upper().startswith(b"HIERARCHY"):
        return "bvh"
    if text.lower().startswith(b"pathfiletype"):
        return "trc"
    if len(head) > 1 and head[1] == 0x50 and ending != ".txt":
        return "c3d"
    if text.startswith(b"{") and ending in (".txt", ".json"):
        return "deepmimic"
    if ending in (".bvh", ".c3d", ".trc", ".amc"):
        return ending[1:]
    if not head:
        raise InputError("The file is empty.", path=path)
    known = "; ".join(FORMATS.values())
    raise InputError(
        f"Unknown capture format {ending or 'without ending'!r}: known are {known}.", path=path
    )


def read(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    skeleton: str | Path | None = None,
    subject: str | None = None,
) -> JointRecording | MarkerRecording:
    """Read a capture: metres, z up; unit and up axis are guessed, and noted, unless told.

    Args:
        path: The capture.
        unit: m, cm, mm, inch, cmu or metres per unit as a number.
        up: x, y, z, -x, -y or -z.
        skeleton: The ASF file of an AMC motion.
        subject: Whom to take where a file holds several people: a name, or a number from 1.

    Raises:
        InputError: The file cannot be used, or nobody of that name is in it.
    """
    kind = detect_format(path)
    if Path(path).stat().st_size == 0:
        raise InputError("The file is empty.", path=path)
    if skeleton is not None and kind != "amc":
        raise UsageError("A skeleton is for AMC motions alone; other captures bring their own.")
    if kind == "bvh":
        return read_bvh(path, unit=unit, up=up, subject=subject)
    if kind in ("trc", "c3d"):
        return _read_markers(path, kind, unit=unit, up=up, subject=subject)
    if subject is not None:
        raise UsageError(f"{kind.upper()} files hold one person; leave the subject out.")
    if kind == "amc":
        return read_amc(path, skeleton=skeleton, unit=unit, up=up)
    return read_deepmimic(path, unit=unit, up=up)


def _read_markers(
    path: str | Path, kind: str, *, unit: str | None, up: str | None, subject: str | None
) -> MarkerRecording:
    if kind == "trc":
        from physretarget.capture.trc import read_trc

        recording = read_trc(path, unit=unit, up=up)
    else:
        from physretarget.capture.c3d import read_c3d  # ezc3d is slow to import

        recording = read_c3d(path, unit=unit, up=up)
    return recording if subject is None else markers_of(recording, subject)


def inspect(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    skeleton: str | Path | None = None,
    mass: float | None = None,
    subject: str | None = None,
    hold_floor: bool = False,
) -> Inspection:
    """Who is which joint or marker of a capture, how well each fits, and what is doubtful.

    Args and Raises as in :func:`load`.
    """
    recording = read(path, unit=unit, up=up, skeleton=skeleton, subject=subject)
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
    hold_floor: bool = False,
    on_doubt: Literal["note", "fail"] = "note",
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
        hold_floor: Take out the motion of a floor that moves (a treadmill's belt, a drift); by
            default it is only told.
        on_doubt: What to do where the motion could not be a human's on a floor: note it, or fail.

    Raises:
        InputError: The file cannot be used, or is doubtful and ``on_doubt`` says fail.
        UsageError: A value is out of its range.
    """
    CaptureOptions(mass=mass, on_doubt=on_doubt)  # refuses what is out of range
    if fps is not None:
        find("fps", options_of(Resampling)).read(fps, "fps")
    recording = read(path, unit=unit, up=up, skeleton=skeleton, subject=subject)
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
