"""How far mappers reach into extremes that no key pose shows them: height and head direction."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget import ik, mapping
from physretarget.keyposes.propose import gazes
from physretarget.reproduce.subject import Subject

Array = NDArray[np.float64]


def reach(own: Subject, which: str, removed: NDArray[np.bool_]) -> dict[str, Any]:
    """Map the removed key poses by a mapper without them, and measure what is left of them.

    Heights are those of the mean of all markers, m; the reach is the highest mapped over the
    highest posed, both above the lowest posed. Head directions in degrees.
    """
    character = own.character
    mapper = mapping.fit(which, own.y[~removed], own.z[~removed], calibrated=False)
    mapped = np.concatenate([mapper.predict(y[None]).mean for y in own.y[removed]])
    kept = np.array([pose.qpos for pose in own.keyposes.poses])
    start = kept[~removed][_nearest(own.y[removed], own.y[~removed])]
    qpos = np.concatenate(
        [
            ik.solve(character, z[None], start=s[None]).qpos
            for z, s in zip(mapped, start, strict=True)
        ]
    )
    truth, truth_qpos = own.z[removed], kept[removed]
    high, posed = mapped[:, 2::3].mean(axis=1), truth[:, 2::3].mean(axis=1)
    gaze, right = gazes(character, qpos), gazes(character, truth_qpos)
    angle = np.degrees(np.arccos(np.clip(np.sum(gaze * right, axis=1), -1.0, 1.0)))
    pitch, pitch_posed = _pitch(gaze), _pitch(right)
    return {
        "mapper": which,
        "height_error": float(np.sqrt(np.mean((high - posed) ** 2))),
        "height_reach": float((high.max() - posed.min()) / (posed.max() - posed.min())),
        "head_error": float(np.sqrt(np.mean(angle**2))),
        "head_reach": float(np.ptp(pitch) / np.ptp(pitch_posed)),
        "up": float(pitch.max()),
        "up_posed": float(pitch_posed.max()),
        "down": float(pitch.min()),
        "down_posed": float(pitch_posed.min()),
    }


def _pitch(gaze: Array) -> Array:
    return np.degrees(np.arcsin(np.clip(gaze[:, 2], -1.0, 1.0)))


def _nearest(y: Array, keys: Array) -> NDArray[np.int64]:
    squared = np.sum((y[:, None] - keys[None]) ** 2, axis=2)
    return np.asarray(np.argmin(squared, axis=1))
