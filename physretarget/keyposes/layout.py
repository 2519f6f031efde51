"""Poses as tables of joints and back: degrees and metres, as an animator reads them.

A free root is ``{height, roll, pitch}``: height in metres, roll and pitch the two horizontal
components, in degrees, of the smallest rotation that takes the vertical to the root's up axis.
Heading and horizontal position are zero by definition and have no place in the table. A hinge
is one number in degrees, a slide one in metres, a ball joint a rotation vector in degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from physretarget.capture.actor import NQ, SEGMENTS
from physretarget.errors import InputError
from physretarget.kinematics import Joint
from physretarget.mjcf import Character

__all__ = ["ACTOR_LAYOUT", "JointError", "Layout", "layout_of"]

Array = NDArray[np.float64]
ROOT_KEYS = ("height", "roll", "pitch")
DEGREES, METRES = 3, 5  # decimals kept: 0.001 degrees and 0.01 mm


class JointError(InputError):
    """An entry of a pose that cannot be used; ``joint`` says which, None if it is missing."""

    def __init__(self, message: str, joint: str | None) -> None:
        super().__init__(message)
        self.joint = joint


@dataclass(frozen=True, eq=False)
class Layout:
    """Where joints live in qpos.

    ``aligned`` is the rotation of the root whose front is +x and whose up is +z.
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    addresses: tuple[int, ...]
    rest: Array
    aligned: Rotation

    def table(self, qpos: Array) -> dict[str, object]:
        """The pose (nq,) as a table.

        Raises:
            InputError: its heading or horizontal position is not zero; the table has no place
                for them.
        """
        return {
            name: self._value(kind, qpos, at)
            for name, kind, at in zip(self.names, self.kinds, self.addresses, strict=True)
        }

    def _value(self, kind: str, qpos: Array, at: int) -> object:
        if kind == "free":
            turn = Rotation.from_quat(qpos[at + 3 : at + 7], scalar_first=True)
            roll, pitch, yaw = np.degrees((turn * self.aligned.inv()).as_rotvec())
            if abs(yaw) > 0.1 or np.hypot(qpos[at], qpos[at + 1]) > 1e-4:
                raise InputError("a key pose has no heading and no horizontal position")
            return {
                "height": _rounded(qpos[at + 2], METRES),
                "roll": _rounded(roll, DEGREES),
                "pitch": _rounded(pitch, DEGREES),
            }
        if kind == "ball":
            vector = Rotation.from_quat(qpos[at : at + 4], scalar_first=True).as_rotvec()
            return [_rounded(x, DEGREES) for x in np.degrees(vector)]
        if kind == "slide":
            return _rounded(qpos[at], METRES)
        return _rounded(np.degrees(qpos[at]), DEGREES)

    def qpos(self, table: Mapping[str, object]) -> Array:
        """The pose (nq,) of a table.

        Raises:
            JointError: a joint is unknown, missing or has a value that it cannot take.
        """
        for name in table:
            if name not in self.names:
                raise JointError(
                    f"unknown joint {name!r}; the joints are {', '.join(self.names)}", name
                )
        missing = [name for name in self.names if name not in table]
        if missing:
            raise JointError(f"no value for {', '.join(missing)}", None)
        qpos = self.rest.copy()
        for name, kind, at in zip(self.names, self.kinds, self.addresses, strict=True):
            self._place(qpos, name, kind, at, table[name])
        return qpos

    def _place(self, qpos: Array, name: str, kind: str, at: int, value: object) -> None:
        if kind == "free":
            height, roll, pitch = _root(name, value)
            turn = Rotation.from_rotvec(np.radians([roll, pitch, 0.0])) * self.aligned
            qpos[at : at + 3] = 0.0, 0.0, height
            qpos[at + 3 : at + 7] = turn.as_quat(canonical=True, scalar_first=True)
        elif kind == "ball":
            if not isinstance(value, list) or len(value) != 3:
                raise JointError(f"{name!r} needs a rotation vector of 3 degrees", name)
            vector = np.radians([_number(name, x) for x in value])
            qpos[at : at + 4] = Rotation.from_rotvec(vector).as_quat(
                canonical=True, scalar_first=True
            )
        elif kind == "slide":
            qpos[at] = _number(name, value)
        else:
            qpos[at] = np.radians(_number(name, value))


def layout_of(character: Character) -> Layout:
    """The layout of a character's joints. The root's free joint must be its first."""
    joints = character.tree.joints
    return Layout(
        names=character.joint_names,
        kinds=tuple(_kind(joint) for joint in joints),
        addresses=tuple(joint.qpos for joint in joints),
        rest=np.array(character.reference_qpos),
        aligned=_aligned(character.front, character.up),
    )


def _kind(joint: Joint) -> str:
    return joint.kind


def _aligned(front: ArrayLike, up: ArrayLike) -> Rotation:
    z = np.asarray(up, dtype=np.float64)
    x = np.asarray(front, dtype=np.float64) - (np.asarray(front) @ z) * z
    x = x / np.linalg.norm(x)
    return Rotation.from_matrix(np.stack([x, np.cross(z, x), z]))


ACTOR_LAYOUT = Layout(
    names=SEGMENTS,
    kinds=("free", *["ball"] * (len(SEGMENTS) - 1)),
    addresses=(0, *range(7, NQ, 4)),
    rest=np.zeros(NQ),
    aligned=Rotation.identity(),
)


def _root(name: str, value: object) -> tuple[float, float, float]:
    if not isinstance(value, dict) or set(value) != set(ROOT_KEYS):
        raise JointError(
            f"{name!r} is a free root and needs height (m), roll and pitch (degrees), no more", name
        )
    height, roll, pitch = (_number(name, value[key]) for key in ROOT_KEYS)
    return height, roll, pitch


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise JointError(f"{name!r} needs a finite number, not {value!r}", name)
    return float(value)


def _rounded(value: float, decimals: int) -> float:
    return round(float(value), decimals) + 0.0  # no negative zeros
