"""The actor's looks and feature points: a neutral mannequin around the segments.

Sizes are those of a man of 1.75 m and scale with the actor's height; lengths and directions
follow the actor's own segments.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import SEGMENT, SEGMENTS, ActorShape

__all__ = ["feature_points", "geoms"]

Array = NDArray[np.float64]
UP = np.array([0.0, 0.0, 1.0])


def geoms(shape: ActorShape) -> dict[str, list[str]]:
    """MJCF geoms of every segment, as text."""
    size = shape.height / 1.75
    parts: dict[str, list[str]] = {name: [] for name in SEGMENTS}
    tip = {name: shape.tip[i] for i, name in enumerate(SEGMENTS)}
    _trunk(parts, shape, tip, size)
    _head(parts["head"], tip["head"], size)
    for index, side in enumerate(("left", "right")):
        _arm(parts, tip, side, size)
        _leg(parts, shape, tip, side, index, size)
    return parts


def _trunk(
    parts: dict[str, list[str]], shape: ActorShape, tip: dict[str, Array], size: float
) -> None:
    hips = shape.offset[[SEGMENT["left_thigh"], SEGMENT["right_thigh"]]]
    half = 0.5 * abs(float(hips[0, 1] - hips[1, 1]))
    middle = hips.mean(axis=0)
    parts["pelvis"] += [
        _ellipsoid(middle + size * np.array([-0.012, 0, 0.035]), (0.094, 0, 0.085), size, half),
        _between(0.1 * tip["pelvis"], 1.1 * tip["pelvis"], (0.085, 0.116), size),
    ]
    parts["abdomen"].append(
        _between(-0.12 * tip["abdomen"], 1.1 * tip["abdomen"], (0.083, 0.108), size, 0.06)
    )
    shoulders = shape.offset[[SEGMENT["left_clavicle"], SEGMENT["right_clavicle"]]]
    arms = shoulders + shape.offset[[SEGMENT["left_upper_arm"], SEGMENT["right_upper_arm"]]]
    width = max(0.5 * abs(float(arms[0, 1] - arms[1, 1])), 0.1 * size)
    chest = tip["chest"]
    parts["chest"] += [
        _ellipsoid(
            0.46 * chest + size * np.array([0.002, 0, 0]), (0.106, 0.146, 0.64), size, tall=chest
        ),
        _capsule(
            np.array([arms[0, 0], 0.62 * width, arms[0, 2] - 0.012 * size]),
            np.array([arms[1, 0], -0.62 * width, arms[1, 2] - 0.012 * size]),
            0.058 * size,
        ),
        _capsule(0.90 * chest, chest + 0.035 * size * UP, 0.052 * size),
    ]


def _head(parts: list[str], tip: Array, size: float) -> None:
    """Skull, jaw, nose and eyes: the gaze must read from across the room."""
    skull = tip - 0.104 * size * UP + size * np.array([0.002, 0, 0])

    def at(x: float, y: float, z: float) -> Array:
        return skull + size * np.array([x, y, z])

    parts += [
        _capsule(-0.1 * tip, 0.40 * tip, 0.051 * size),
        _ellipsoid(skull, (0.098, 0.077, 0.104), size),
        _ellipsoid(at(0.022, 0, -0.060), (0.064, 0.058, 0.066), size),
        _capsule(at(0.090, 0, -0.006), at(0.104, 0, -0.034), 0.009 * size),
        *(_sphere(at(0.083, y, -0.002), 0.0115 * size, "dark") for y in (0.031, -0.031)),
    ]


def _arm(parts: dict[str, list[str]], tip: dict[str, Array], side: str, size: float) -> None:
    upper, fore, hand = (tip[f"{side}_{part}"] for part in ("upper_arm", "forearm", "hand"))
    collar = tip[f"{side}_clavicle"]
    parts[f"{side}_clavicle"].append(_capsule(0.30 * collar, 0.92 * collar, 0.048 * size))
    parts[f"{side}_upper_arm"] += [
        _sphere(np.zeros(3), 0.055 * size),
        _capsule(np.zeros(3), upper, 0.038 * size),
        _along(0.36 * upper, upper, (0.050, 0.046, 0.46), size),
    ]
    parts[f"{side}_forearm"] += [
        _sphere(np.zeros(3), 0.038 * size),
        _capsule(0.1 * fore, fore, 0.029 * size),
        _along(0.30 * fore, fore, (0.041, 0.039, 0.42), size),
    ]
    parts[f"{side}_hand"] += [
        _sphere(np.zeros(3), 0.028 * size),
        _along(0.36 * hand, hand, (0.042, 0.020, 0.36), size),
        _along(0.72 * hand, hand, (0.034, 0.014, 0.28), size),
        _capsule(
            0.22 * hand + np.array([0.022, 0, 0]) * size,
            0.52 * hand + np.array([0.050, 0, 0]) * size,
            0.0115 * size,
        ),
    ]


def _leg(
    parts: dict[str, list[str]],
    shape: ActorShape,
    tip: dict[str, Array],
    side: str,
    index: int,
    size: float,
) -> None:
    thigh, shank, ball = (tip[f"{side}_{part}"] for part in ("thigh", "shank", "foot"))
    heel = shape.heel[index]
    parts[f"{side}_thigh"] += [
        _sphere(np.zeros(3), 0.080 * size),
        _capsule(0.05 * thigh, thigh, 0.052 * size),
        _along(0.33 * thigh, thigh, (0.082, 0.077, 0.52), size),
    ]
    parts[f"{side}_shank"] += [
        _sphere(np.zeros(3), 0.052 * size),
        _capsule(0.06 * shank, shank, 0.036 * size),
        _along(0.30 * shank - size * np.array([0.014, 0, 0]), shank, (0.053, 0.050, 0.37), size),
    ]
    forward = (ball - heel) / max(float(np.linalg.norm(ball - heel)), 1e-9)
    sideways = np.cross(UP, forward)
    toe = ball + 0.055 * size * forward
    rise = 0.022 * size * UP
    parts[f"{side}_foot"] += [
        _sphere(np.zeros(3), 0.043 * size),
        _capsule(np.zeros(3), heel + 0.034 * size * (UP + forward), 0.034 * size),
        _capsule(
            heel + 0.030 * size * forward + 1.3 * rise, ball + 0.024 * size * UP, 0.0235 * size
        ),
        *(
            _capsule(
                0.45 * heel + 0.55 * ball + rise + shift * 0.014 * size * sideways,
                toe + 0.95 * rise + shift * 0.020 * size * sideways,
                0.0205 * size,
            )
            for shift in (-1.0, 0.1, 1.0)
        ),
    ]


def feature_points(shape: ActorShape) -> dict[str, list[Array]]:
    """Feature points in the segments' frames, two or three on each main segment.

    They lie where an optical marker would: on bony, well visible places, off the segment's
    axis so that turning about it shows. Hands carry one, their twist is rarely captured well.
    """
    size = shape.height / 1.75
    tip = {name: shape.tip[i] for i, name in enumerate(SEGMENTS)}

    def at(x: float, y: float, z: float) -> Array:
        return size * np.array([x, y, z])

    points = {
        "pelvis": [at(0.08, 0.12, 0.09), at(0.08, -0.12, 0.09), at(-0.11, 0, 0.09)],
        "chest": [
            0.6 * tip["chest"] + at(0.11, 0, 0),
            0.8 * tip["chest"] + at(0, 0.15, 0),
            0.8 * tip["chest"] + at(0, -0.15, 0),
        ],
        "head": [
            tip["head"] + at(0.09, 0, -0.07),
            tip["head"] + at(-0.02, 0.08, -0.07),
            tip["head"] + at(-0.02, -0.08, -0.07),
        ],
    }
    for index, (side, y) in enumerate((("left", 1.0), ("right", -1.0))):
        points |= {
            f"{side}_upper_arm": [at(0, 0.05 * y, 0), tip[f"{side}_upper_arm"] + at(-0.04, 0, 0)],
            f"{side}_forearm": [
                tip[f"{side}_forearm"] + at(0.03, 0, 0),
                tip[f"{side}_forearm"] + at(-0.03, 0, 0),
            ],
            f"{side}_hand": [tip[f"{side}_hand"]],
            f"{side}_thigh": [
                tip[f"{side}_thigh"] + at(0.05, 0, 0.03),
                tip[f"{side}_thigh"] + at(0, 0.06 * y, 0),
            ],
            f"{side}_shank": [
                tip[f"{side}_shank"] + at(0.04, 0, 0.05),
                tip[f"{side}_shank"] + at(0, 0.04 * y, 0),
            ],
            f"{side}_foot": [shape.heel[index], tip[f"{side}_foot"]],
        }
    return points


def _numbers(values: Array) -> str:
    return " ".join(f"{value:.6f}" for value in np.asarray(values, dtype=np.float64))


def _sphere(at: Array, radius: float, material: str = "body") -> str:
    return f'<geom type="sphere" pos="{_numbers(at)}" size="{radius:.6f}" material="{material}"/>'


def _capsule(start: Array, end: Array, radius: float) -> str:
    if np.linalg.norm(end - start) < 1e-4:  # a segment of no length in this skeleton
        return _sphere(start, radius)
    ends = _numbers(np.concatenate([start, end]))
    return f'<geom type="capsule" fromto="{ends}" size="{radius:.6f}"/>'


def _ellipsoid(
    at: Array,
    radii: tuple[float, float, float],
    size: float,
    half_width: float | None = None,
    tall: Array | None = None,
) -> str:
    half = size * np.array(radii)
    if half_width is not None:
        half[1] = half_width + 0.075 * size
    if tall is not None:
        half[2] = max(radii[2] * float(np.linalg.norm(tall)), 0.05 * size)
    return f'<geom type="ellipsoid" pos="{_numbers(at)}" size="{_numbers(half)}"/>'


def _between(
    start: Array, end: Array, radii: tuple[float, float], size: float, extra: float = 0.03
) -> str:
    """An upright ellipsoid around a piece of the spine."""
    tall = 0.5 * float(np.linalg.norm(end - start)) + extra * size
    half = np.array([radii[0] * size, radii[1] * size, tall])
    return f'<geom type="ellipsoid" pos="{_numbers(0.5 * (start + end))}" size="{_numbers(half)}"/>'


def _along(at: Array, axis: Array, radii: tuple[float, float, float], size: float) -> str:
    """An ellipsoid whose long half axis is a share of the segment and points along it."""
    length = float(np.linalg.norm(axis))
    if length < 1e-4:
        return _sphere(at, radii[0] * size)
    half = np.array([radii[0] * size, radii[1] * size, radii[2] * length])
    direction = _numbers(axis / length)
    return (
        f'<geom type="ellipsoid" pos="{_numbers(at)}" size="{_numbers(half)}" zaxis="{direction}"/>'
    )
