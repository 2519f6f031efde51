"""What the three screens show: figures with their motion, forces, contacts and findings.

A :class:`Scene` is plain data (NumPy and strings), cut loose from the model files: whoever draws
it needs neither the character nor the clip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError, UsageError
from physretarget.replay.clock import Clock

Array = NDArray[np.float64]
Color = tuple[float, float, float]
ShapeKind = Literal["box", "sphere", "ellipsoid", "capsule", "cylinder", "mesh"]
Severity = Literal["error", "warning", "info"]


@dataclass(frozen=True, eq=False)
class Shape:
    """One rigid visible piece of a body.

    ``size`` (3,) m is MuJoCo's (half sizes; radius and half length); ``position`` (3,) and
    ``rotation`` (4,) wxyz place it in its body; ``vertices`` (V, 3) m and ``faces`` (F, 3) for
    meshes, else None. ``declared`` says whether the model gave it a colour of its own.
    """

    kind: ShapeKind
    body: int
    size: Array
    position: Array
    rotation: Array
    rgba: tuple[float, float, float, float]
    declared: bool = True
    emission: float = 0.0
    gloss: float = 0.4
    vertices: NDArray[np.float32] | None = None
    faces: NDArray[np.int32] | None = None


@dataclass(frozen=True, eq=False)
class Light:
    """A spot light carried by a body (MJCF ``light``): position and direction in the body."""

    body: int
    position: Array
    direction: Array
    color: Color


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contact points of a figure and when they stand.

    ``body`` (K,) and ``local`` (K, 3) m place them; ``active`` (T, K) or None when not known.
    """

    names: tuple[str, ...]
    body: NDArray[np.int64]
    local: Array
    active: NDArray[np.bool_] | None


@dataclass(frozen=True, eq=False)
class Forces:
    """Force arrows: ``origin`` (T, K, 3) m world, ``vector`` (T, K, 3) in body weights.

    NaN or zero where there is nothing to draw.
    """

    origin: Array
    vector: Array
    label: str = "contact force"

    def __post_init__(self) -> None:
        if self.origin.shape != self.vector.shape or self.origin.ndim != 3:
            raise UsageError(
                f"force origins {self.origin.shape} and vectors {self.vector.shape} "
                "must both be (frames, arrows, 3)."
            )


@dataclass(frozen=True, eq=False)
class Figure:
    """An actor or character in motion.

    ``position`` (T, nb, 3) m and ``rotation`` (T, nb, 4) wxyz are its bodies' world poses on the
    scene's clock, quaternion signs continuous; ``com`` (T, 3) m its centre of mass; ``offset``
    (3,) where it stands in the side-by-side view; ``height`` m scales the camera. ``tint``
    recolours what the model left without a colour, or everything with ``repaint``.
    """

    name: str
    shapes: tuple[Shape, ...]
    position: Array
    rotation: Array
    com: Array
    height: float
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tint: Color | None = None
    repaint: bool = False
    opacity: float = 1.0
    hidden: bool = False
    lights: tuple[Light, ...] = ()
    contacts: Contacts | None = None
    forces: Forces | None = None


@dataclass(frozen=True)
class Mark:
    """A finding on the clock: frames are inclusive and count from 0; ``frame`` is the worst."""

    code: str
    severity: Severity
    message: str
    frame_first: int
    frame_last: int
    frame: int | None = None

    @property
    def look_at(self) -> int:
        """The frame to jump to: the worst one, or the first."""
        return self.frame_first if self.frame is None else self.frame


class FindingLike(Protocol):
    """What a validation finding offers (see physretarget.validation)."""

    @property
    def code(self) -> str: ...  # noqa: D102
    @property
    def message(self) -> str: ...  # noqa: D102
    @property
    def frame_first(self) -> int | None: ...  # noqa: D102
    @property
    def frame_last(self) -> int | None: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything on stage: ``time`` (T,) s shared by all figures, findings, a title."""

    title: str
    time: Array
    figures: tuple[Figure, ...]
    marks: tuple[Mark, ...] = ()
    floor: bool = True
    layout: Literal["stage", "split", "overlay"] = "stage"
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        if len(self.time) < 1 or not self.figures:
            raise UsageError("a scene needs at least one frame and one figure.")
        for figure in self.figures:
            if len(figure.position) != len(self.time):
                raise UsageError(
                    f"figure {figure.name!r} has {len(figure.position)} frames, "
                    f"the scene's clock {len(self.time)}."
                )

    @property
    def clock(self) -> Clock:
        """The clock that every screen follows."""
        return Clock(self.time)


def marks(findings: Sequence[FindingLike]) -> tuple[Mark, ...]:
    """Findings that have a place in time, as marks on the clock, in order of time.

    Args:
        findings: A report's findings.

    Returns:
        The marks.
    """
    found = []
    for finding in findings:
        if finding.frame_first is None:
            continue
        last = finding.frame_first if finding.frame_last is None else finding.frame_last
        severity: Any = str(getattr(finding, "severity", "warning"))
        severity = severity.rsplit(".", 1)[-1].lower()
        found.append(
            Mark(
                code=finding.code,
                severity=severity if severity in ("error", "warning", "info") else "warning",
                message=finding.message,
                frame_first=int(finding.frame_first),
                frame_last=int(last),
                frame=getattr(finding, "frame", None),
            )
        )
    return tuple(sorted(found, key=lambda mark: (mark.frame_first, mark.code)))


def with_marks(scene: Scene, findings: Sequence[FindingLike]) -> Scene:
    """The scene with a report's findings on its clock.

    Args:
        scene: A scene.
        findings: A report's findings.

    Returns:
        A copy with the marks.
    """
    return replace(scene, marks=marks(findings))


def check_frames(name: str, frames: int, wanted: int) -> None:
    """Raise InputError unless a track has as many frames as the clip."""
    if frames != wanted:
        raise InputError(f"{name} has {frames} frames, the motion {wanted}.")
