"""The size of an actor and the seats of its markers, solved together with poses.

Unknown over a spread of frames: joint offsets (limbs alike on both sides), marker positions
on their segments, and one pose per frame. Gauss–Newton on all of them at once, the poses
eliminated frame by frame (Schur complement), with anatomical priors on offsets and markers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from physretarget.capture.actor import SEGMENT, ActorShape
from physretarget.capture.marker_model import (
    Floats,
    Ints,
    MarkerModel,
    first_poses,
    fit_poses,
    pose_weights,
)
from physretarget.kinematics import difference, forward, jacobian, points

_NOISE = 0.01  # m, skin against bone: what a marker's error is compared to
_COUNT = 10.0  # independent looks that many frames of one person are worth
_ROUNDS = 8


@dataclass(frozen=True)
class _Measure:
    """One number of the shape: an axis of one joint offset, the same on both sides."""

    name: str
    axis: int
    spread: float  # m at 1.75 m

    def entries(self) -> list[tuple[int, float]]:
        """Segments whose offset it changes, with signs (left is +y, right is -y)."""
        if self.name in SEGMENT:
            return [(SEGMENT[self.name], 1.0)]
        mirrored = -1.0 if self.axis == 1 else 1.0
        return [(SEGMENT[f"left_{self.name}"], 1.0), (SEGMENT[f"right_{self.name}"], mirrored)]


# Lengths vary by about a tenth between people of one height, joint centres across by a
# centimetre or two.
_MEASURES = (
    _Measure("abdomen", 0, 0.015),
    _Measure("abdomen", 2, 0.02),
    _Measure("chest", 0, 0.015),
    _Measure("chest", 2, 0.02),
    _Measure("head", 0, 0.015),
    _Measure("head", 2, 0.02),
    _Measure("clavicle", 0, 0.01),
    _Measure("clavicle", 2, 0.01),
    _Measure("upper_arm", 0, 0.015),
    _Measure("upper_arm", 1, 0.02),
    _Measure("upper_arm", 2, 0.015),
    _Measure("forearm", 2, 0.03),
    _Measure("hand", 2, 0.03),
    _Measure("thigh", 1, 0.01),
    _Measure("thigh", 2, 0.01),
    _Measure("shank", 2, 0.04),
    _Measure("foot", 2, 0.04),
)


def estimate_height(model: MarkerModel, position: Floats) -> float:
    """A height (m) from distances between markers that a pose hardly changes.

    Pairs on one segment, and pairs across a joint of which one is next to it, compared to
    the same distances on ``model``, the reference actor; the median ratio, by distance.
    """
    tree = model.shape.tree()
    at = points(forward(tree, tree.neutral()[None]), model.segment + 1, model.local)[0]
    ratios, lengths = [], []
    some = position[:: max(1, len(position) // 200)]
    parent = tree.parent[1:] - 1
    near = np.linalg.norm(model.local, axis=1) < 0.08
    for i in range(len(at)):
        for j in range(i):
            a, b = model.segment[i], model.segment[j]
            across = (parent[a] == b and near[i]) or (parent[b] == a and near[j])
            length = float(np.linalg.norm(at[i] - at[j]))
            if length < 0.12 or not (a == b or across or _at_joint(model, i, j, at)):
                continue
            measured = np.linalg.norm(some[:, i] - some[:, j], axis=1)
            measured = measured[np.isfinite(measured)]
            if len(measured):
                ratios.append(float(np.median(measured)) / length)
                lengths.append(length)
    if not ratios:
        return model.shape.height
    order = np.argsort(ratios)
    passed = np.cumsum(np.array(lengths)[order])
    middle = order[np.searchsorted(passed, 0.5 * passed[-1])]
    return float(np.clip(model.shape.height * ratios[middle], 0.8, 2.4))


def _at_joint(model: MarkerModel, i: int, j: int, at: Floats) -> bool:
    """Whether a marker sits at the far end of its segment, next to the other one's joint."""
    parent = model.shape.tree().parent[1:] - 1
    for a, b in ((i, j), (j, i)):
        if parent[model.segment[b]] != model.segment[a]:
            continue
        joint = model.shape.offset[model.segment[b]]
        if np.linalg.norm(model.local[a] - joint) < 0.08:
            return True
    return False


def resized(model: MarkerModel, height: float) -> MarkerModel:
    """The model with everything scaled to another height."""
    scale = height / model.shape.height
    return replace(
        model, shape=ActorShape.reference(height, model.shape.mass), local=model.local * scale
    )


def fit_model(model: MarkerModel, position: Floats) -> MarkerModel:
    """Fit shape and marker seats of ``model`` to frames ``position`` (F, K, 3)."""
    size = model.shape.height / 1.75
    tightness = np.concatenate(
        [
            [1 / (m.spread * size) ** 2 for m in _MEASURES],
            np.repeat(1 / (model.spread * size) ** 2, 3),
        ]
    )
    change = np.zeros(len(tightness))
    qpos = fit_poses(model, position, first_poses(model, position), iterations=40).qpos
    fitted = model
    for _ in range(_ROUNDS):
        step = _step(fitted, position, qpos, change, tightness)
        change = change + step
        fitted = _changed(model, change)
        solution = fit_poses(fitted, position, qpos, iterations=6)
        qpos = solution.qpos
        if np.abs(step).max() < 5e-4:
            break
    return fitted


def _changed(model: MarkerModel, change: Floats) -> MarkerModel:
    """The model with measures and marker seats moved by ``change``."""
    offset = model.shape.offset.copy()
    for value, measure in zip(change, _MEASURES, strict=False):
        for segment, sign in measure.entries():
            offset[segment, measure.axis] += sign * value
    old = model.shape
    shape = ActorShape.standing(old.name, old.mass, offset, old.tip, old.heel)
    return replace(model, shape=shape, local=model.local + change[len(_MEASURES) :].reshape(-1, 3))


def _step(
    model: MarkerModel, position: Floats, qpos: Floats, change: Floats, tightness: Floats
) -> Floats:
    """One Gauss–Newton step for shape and seats, the poses free to follow."""
    tree = model.shape.tree()
    pose = forward(tree, qpos)
    body = model.segment + 1
    error = points(pose, body, model.local) - position
    seen = np.asarray(np.isfinite(error).all(axis=-1))
    frames = len(position)
    weight = seen * model.weight * (_COUNT / (frames * _NOISE**2))
    wide = np.repeat(weight, 3, axis=1)
    residual = np.where(seen[..., None], error, 0.0).reshape(frames, -1)
    by_pose = jacobian(tree, pose, qpos, body, model.local)
    by_shape = _shape_slopes(model, pose.rotation, body)
    prior = pose_weights() * _COUNT / (frames * _NOISE**2)
    away = difference(tree, np.broadcast_to(tree.neutral(), qpos.shape), qpos)
    weighted = wide[..., None] * by_pose
    pose_pose = np.swapaxes(weighted, 1, 2) @ by_pose + np.diag(prior + 1e-6 * prior.max())
    pose_shape = np.swapaxes(weighted, 1, 2) @ by_shape
    pose_slope = np.einsum("trv,tr->tv", weighted, residual) + prior * away
    shape_shape = np.einsum("trg,tr,trh->gh", by_shape, wide, by_shape, optimize=True)
    shape_slope = np.einsum("trg,tr->g", by_shape, wide * residual, optimize=True)
    follow = np.linalg.solve(pose_pose, np.concatenate([pose_shape, pose_slope[..., None]], 2))
    shape_shape -= np.einsum("tvg,tvh->gh", pose_shape, follow[..., :-1], optimize=True)
    shape_slope -= np.einsum("tvg,tv->g", pose_shape, follow[..., -1], optimize=True)
    matrix = shape_shape + np.diag(tightness)
    step: Floats = np.linalg.solve(matrix, -(shape_slope + tightness * change))
    return np.clip(step, -0.05, 0.05)


def _shape_slopes(model: MarkerModel, rotation: Floats, body: Ints) -> Floats:
    """Derivatives (F, 3K, G) of marker positions by measures and seats."""
    tree = model.shape.tree()
    frames, count = len(rotation), len(body)
    slopes = np.zeros((frames, count, 3, len(_MEASURES) + 3 * count))
    for column, measure in enumerate(_MEASURES):
        for segment, sign in measure.entries():
            carried = tree.carries[segment + 1, body]
            axis = sign * rotation[:, tree.parent[segment + 1], :, measure.axis]
            slopes[..., column][:, carried] += axis[:, None]
    for k in range(count):
        first = len(_MEASURES) + 3 * k
        slopes[:, k, :, first : first + 3] = rotation[:, body[k]]
    return slopes.reshape(frames, 3 * count, -1)
