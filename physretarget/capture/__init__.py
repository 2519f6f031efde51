"""Captures: files in, joints or markers over time out, and an actor fitted to them.

:func:`read` gives what a file holds, :func:`load` an actor's motion, whatever the format.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from physretarget.capture.actor import ActorMotion
from physretarget.capture.amc import read_amc
from physretarget.capture.bvh import read_bvh
from physretarget.capture.deepmimic import read_deepmimic
from physretarget.capture.joints import fit_joints
from physretarget.capture.plausible import doubts
from physretarget.capture.recording import JointRecording, MarkerRecording
from physretarget.errors import InputError, UsageError

__all__ = ["FORMATS", "detect_format", "load", "read"]

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
) -> JointRecording | MarkerRecording:
    """Read a capture: metres, z up; unit and up axis are guessed, and noted, unless told.

    ``unit`` is m, cm, mm, inch, cmu or metres per unit as a number; ``up`` is x, y, z, -x, -y
    or -z; ``skeleton`` is the ASF file of an AMC motion. InputError for what cannot be used.
    """
    kind = detect_format(path)
    if Path(path).stat().st_size == 0:
        raise InputError("The file is empty.", path=path)
    if skeleton is not None and kind != "amc":
        raise UsageError("A skeleton is for AMC motions alone; other captures bring their own.")
    if kind == "bvh":
        return read_bvh(path, unit=unit, up=up)
    if kind == "amc":
        return read_amc(path, skeleton=skeleton, unit=unit, up=up)
    if kind == "deepmimic":
        return read_deepmimic(path, unit=unit, up=up)
    if kind == "trc":
        from physretarget.capture.trc import read_trc

        return read_trc(path, unit=unit, up=up)
    from physretarget.capture.c3d import read_c3d  # ezc3d is slow to import

    return read_c3d(path, unit=unit, up=up)


def load(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    skeleton: str | Path | None = None,
    mass: float | None = None,
    fps: float | None = None,
    max_seconds: float | None = None,
) -> ActorMotion:
    """Read a capture and fit the actor to it.

    ``mass`` in kg (70 unless told), ``fps`` resamples, ``max_seconds`` keeps the clip's start;
    for the others see :func:`read`. The motion's ``notes`` say what was guessed or repaired.
    """
    if mass is not None and not 5 <= mass <= 500:
        raise UsageError(f"The mass is {mass:g} kg; it must lie between 5 and 500 kg.")
    if fps is not None and not 1 <= fps <= 1000:
        raise UsageError(f"The frame rate is {fps:g}; it must lie between 1 and 1000 per second.")
    recording = read(path, unit=unit, up=up, skeleton=skeleton)
    if isinstance(recording, JointRecording):
        _refuse_nan(recording)
        if max_seconds is not None:
            recording = _start_of_joints(recording, max_seconds)
        motion = fit_joints(recording, mass=mass)
    else:
        from physretarget.capture.markers import fit_markers

        if max_seconds is not None:
            recording = _start_of_markers(recording, max_seconds)
        motion = fit_markers(recording, mass=mass)
    motion = replace(motion, notes=motion.notes + doubts(motion))
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


def _start_of_joints(recording: JointRecording, seconds: float) -> JointRecording:
    n = _kept(recording.time, seconds)
    return replace(
        recording,
        time=recording.time[:n],
        position=recording.position[:n],
        rotation=recording.rotation[:n],
    )


def _start_of_markers(recording: MarkerRecording, seconds: float) -> MarkerRecording:
    n = _kept(recording.time, seconds)
    return replace(recording, time=recording.time[:n], position=recording.position[:n])
