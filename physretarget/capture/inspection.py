"""What a capture holds and how it is understood: who is which joint or marker, and how well."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from physretarget.capture.actor import SEGMENT, SEGMENTS, ActorMotion
from physretarget.capture.marker_worn import landmarks_of
from physretarget.capture.names import recognise
from physretarget.capture.recording import Floats, JointRecording, MarkerRecording
from physretarget.kinematics import forward

__all__ = ["Inspection", "Part", "inspect_recording"]

# Roles of joints (names.py) that are not segments of the actor by the same name.
_SEGMENT_OF = {"hips": "pelvis", "left_toe": "left_foot", "right_toe": "right_foot"}


@dataclass(frozen=True, kw_only=True)
class Part:
    """One label or joint of a file: what it is taken for (None: nothing), and how well it fits.

    ``residual_m`` is the RMS distance (m) from the place on the actor where it sits on average,
    None where it is not used; ``seen`` the share of frames that show it.
    """

    name: str
    meaning: str | None
    segment: str | None
    residual_m: float | None
    seen: float


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """A capture as it was understood."""

    path: str
    format: str
    kind: str
    frames: int
    fps: float
    duration_s: float
    valid_frames: int
    unit: str
    up: str
    height_m: float
    mass_kg: float
    marker_error_m: float | None
    facing_degrees: float
    travel_m: float
    parts: tuple[Part, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "schema": "physretarget/capture/1",
            **{name: value for name, value in vars(self).items() if name != "parts"},
            "parts": [vars(part) for part in self.parts],
            "notes": list(self.notes),
            "doubts": list(self.doubts),
        }


def inspect_recording(
    recording: JointRecording | MarkerRecording, motion: ActorMotion
) -> Inspection:
    """Everything about a capture that a person needs to see whether it was read rightly.

    Args:
        recording: The capture as read.
        motion: The actor fitted to it, at the capture's own rate.
    """
    source, pose = motion.source, forward(motion.shape.tree(), motion.qpos)
    root = motion.qpos[motion.valid, :3]
    ahead = pose.rotation[motion.valid, 1, :2, 0].mean(axis=0)
    if isinstance(recording, JointRecording):
        parts = _joints(recording, motion)
    else:
        parts = _markers(recording, motion)
    return Inspection(
        path=Path(source.path).name,
        format=source.format,
        kind="joints" if isinstance(recording, JointRecording) else "markers",
        frames=source.frames,
        fps=source.fps,
        duration_s=float(recording.time[-1]) if len(recording.time) else 0.0,
        valid_frames=int(motion.valid.sum()),
        unit=source.unit,
        up=source.up,
        height_m=float(motion.shape.height),
        mass_kg=float(motion.shape.mass),
        marker_error_m=motion.marker_error_rms,
        facing_degrees=float(np.degrees(np.arctan2(ahead[1], ahead[0]))),
        travel_m=float(np.linalg.norm(np.diff(root[:, :2], axis=0), axis=1).sum()),
        parts=parts,
        notes=tuple(note for note in motion.notes if note not in motion.doubts),
        doubts=motion.doubts,
    )


def _joints(recording: JointRecording, motion: ActorMotion) -> tuple[Part, ...]:
    body = recognise(recording.names, recording.parents)
    meaning = dict.fromkeys(body.spine, "spine") | {j: r for r, j in body.roles.items()}
    parts = []
    for joint, name in enumerate(recording.names):
        role = meaning.get(joint)
        segment = _SEGMENT_OF.get(role or "", role)
        segment = segment if segment in SEGMENT else None
        place = recording.position[:, joint]
        parts.append(
            Part(
                name=name,
                meaning=role,
                segment=segment,
                residual_m=_residual(place, motion, segment),
                seen=_seen(place),
            )
        )
    return tuple(parts)


def _markers(recording: MarkerRecording, motion: ActorMotion) -> tuple[Part, ...]:
    parts = []
    for column, mark in enumerate(landmarks_of(recording)):
        place = recording.position[:, column]
        segment = None if mark is None else SEGMENTS[mark.segment]
        parts.append(
            Part(
                name=recording.labels[column],
                meaning=None if mark is None else mark.name,
                segment=segment,
                residual_m=_residual(place, motion, segment),
                seen=_seen(place),
            )
        )
    return tuple(parts)


def _seen(place: Floats) -> float:
    return float(np.isfinite(place).all(axis=-1).mean())


def _residual(place: Floats, motion: ActorMotion, segment: str | None) -> float | None:
    """RMS distance (m) of a point (T, 3) from where it sits on a segment on average.

    The actor stands on z = 0 and the file may not: the height between them is solved for along with
    the place on the segment.
    """
    if segment is None:
        return None
    good = motion.valid & np.isfinite(place).all(axis=-1)
    if good.sum() < 2:
        return None
    pose, body = forward(motion.shape.tree(), motion.qpos[good]), 1 + SEGMENT[segment]
    off = place[good] - pose.position[:, body]
    local = np.einsum("tji,tj->ti", pose.rotation[:, body], off)
    up = pose.rotation[:, body, 2]  # world z in the segment's frame
    lean, rest = up - up.mean(axis=0), local - local.mean(axis=0)
    spread = float(np.sum(lean**2))
    raised = float(np.sum(lean * rest)) / spread if spread > 1e-6 else 0.0
    return float(np.sqrt(np.mean(np.sum((rest - raised * lean) ** 2, axis=1))))
