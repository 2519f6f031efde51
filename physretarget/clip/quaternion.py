"""Which number of a quaternion is w, and how far from unit length it may be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError

QuatOrder = Literal["wxyz", "xyzw"]
_ORDERS: tuple[QuatOrder, QuatOrder] = ("wxyz", "xyzw")
Floats = NDArray[np.float64]

# Rounding of float32 and of text files; anything beyond is reported.
_ROUNDING = 1e-5
# Averaging or linear interpolation of rotations shortens them by a few per cent; a norm
# further off says that these columns are no quaternion.
_REPAIRABLE = 0.1
# Upright means within 60 degrees of vertical. A reading makes sense when nearly all frames
# are upright under it; the other is ruled out when clearly fewer are. Facing -x under wxyz
# looks like facing +x under xyzw, so a clip that never turns can leave both standing.
_UPRIGHT = 0.5
_NEARLY_ALL, _FEWER = 0.95, 0.75


def upright_fraction(quat: Floats, order: QuatOrder) -> float:
    """Share of frames (T, 4) whose z axis points within 60 degrees of up, read in that order."""
    x, y = (quat[:, 1], quat[:, 2]) if order == "wxyz" else (quat[:, 0], quat[:, 1])
    norm = np.maximum(np.sum(quat**2, axis=1), 1e-12)
    return float(np.mean(1 - 2 * (x**2 + y**2) / norm > _UPRIGHT))


def decide_order(quat: Floats, *, path: str) -> tuple[QuatOrder, str]:
    """The only order under which the root stays upright, and a sentence that says so.

    Raises InputError when both orders make sense, or neither: then it must be told.
    """
    share = {order: upright_fraction(quat, order) for order in _ORDERS}
    pairs: tuple[tuple[QuatOrder, QuatOrder], ...] = (("wxyz", "xyzw"), ("xyzw", "wxyz"))
    for order, other in pairs:
        if share[order] >= _NEARLY_ALL and share[other] < _FEWER:
            return order, (
                f"Quaternion order {order} was inferred: the root is upright in "
                f"{share[order]:.0%} of the frames, in {share[other]:.0%} when read as {other}."
            )
    raise InputError(
        "the quaternion order is not stated and cannot be inferred (the root is upright in "
        f"{share['wxyz']:.0%} of the frames read as wxyz, {share['xyzw']:.0%} as xyzw): "
        "give --quat wxyz or --quat xyzw.",
        path=path,
    )


def doubt_order(quat: Floats, order: QuatOrder, *, format: str) -> str | None:
    """A sentence where only the other order than the format's keeps the root upright.

    No more than a doubt: someone may lie or roll, and the format says how it is meant.
    """
    other: QuatOrder = "xyzw" if order == "wxyz" else "wxyz"
    as_is, turned = upright_fraction(quat, order), upright_fraction(quat, other)
    if as_is >= _FEWER or turned < _NEARLY_ALL:
        return None
    return (
        f"Quaternions are read as {order}, as {format} has them, but the root is upright in "
        f"{as_is:.0%} of the frames then, in {turned:.0%} when read as {other}: if the file was "
        f"written so, give --quat {other}."
    )


@dataclass(kw_only=True)
class Lengths:
    """Normalises quaternions part by part; reports repairs, refuses what is no rotation."""

    path: str
    worst: float = 0.0
    frame: int = 0

    def repair(self, qpos: Floats, quats: NDArray[np.int64], first: int) -> None:
        """Normalise (T, nq) in place; ``first`` is the number of its first frame."""
        for columns in quats:
            norm = np.linalg.norm(qpos[:, columns], axis=1)
            off = np.abs(norm - 1)
            frame = int(np.argmax(off))
            if off[frame] > _REPAIRABLE:
                raise InputError(
                    f"the quaternion in columns {columns[0]}..{columns[3]} has length "
                    f"{norm[frame]:.4g}, 1 is needed (up to 10 % off is repaired).",
                    path=self.path,
                    frame=first + frame,
                )
            if off[frame] > self.worst:
                self.worst, self.frame = float(off[frame]), first + frame
            qpos[:, columns] /= norm[:, None]

    def notes(self) -> list[str]:
        """What was repaired, beyond rounding."""
        if self.worst <= _ROUNDING:
            return []
        return [
            f"Quaternions were normalised: the length was off by up to {self.worst:.2g} "
            f"(frame {self.frame})."
        ]
