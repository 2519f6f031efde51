"""Points fixed on a character's bodies: virtual markers and contact points."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.mjcf.reference import body_radius

__all__ = ["Points", "declared_points", "generated_markers"]


@dataclass(frozen=True, eq=False)
class Points:
    """Named points: ``body`` (K,) ids, ``local`` (K, 3) in metres in the body's frame."""

    names: tuple[str, ...]
    body: NDArray[np.int64]
    local: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.names)


def declared_points(model: mujoco.MjModel, prefix: str) -> Points:
    """The sites whose names begin with `prefix`, in the order of the file."""
    sites = [i for i in range(model.nsite) if model.site(i).name.startswith(prefix)]
    return _frozen(
        [model.site(i).name for i in sites],
        model.site_bodyid[sites].astype(np.int64),
        np.array(model.site_pos[sites]).reshape(-1, 3),
    )


def generated_markers(model: mujoco.MjModel, bodies: NDArray[np.int64], size: float) -> Points:
    """Three non-collinear points on every body of `bodies` (Yamane 2010, section 4.1).

    They stand around the body's centre of mass along its frame's axes, as far off as the body
    is large, within 3 % to 50 % of the character's `size` (m): so that the error of a marker
    weighs position and orientation alike, and a tiny link still shows how it is turned.
    """
    names: list[str] = []
    owners: list[int] = []
    places: list[NDArray[np.float64]] = []
    for body in bodies:
        reach = float(np.clip(body_radius(model, body), 0.03 * size, 0.5 * size))
        centre = model.body_ipos[body]
        label = model.body(body).name or f"body{body}"
        for axis, offset in zip("xyz", reach * np.eye(3), strict=True):
            names.append(f"marker_{label}_{axis}")
            owners.append(int(body))
            places.append(centre + offset)
    return _frozen(names, np.array(owners, dtype=np.int64), np.array(places).reshape(-1, 3))


def _frozen(names: list[str], body: NDArray[np.int64], local: NDArray[np.float64]) -> Points:
    body.setflags(write=False)
    local.setflags(write=False)
    return Points(tuple(names), body, local)
