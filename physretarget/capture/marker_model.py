"""Markers on an actor: where they sit, and a first pose for every frame from them alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import NV, PARENTS, SEGMENT, SEGMENTS, ActorShape
from physretarget.kinematics import (
    PointTargets,
    Solution,
    difference,
    integrate,
    matrix_to_quat,
    quat_to_matrix,
    slerp,
    solve,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_ALONG = 3e-4  # m² per rad², how strongly a pose is drawn to its neighbours in time
_TRUNK = ("pelvis", "abdomen", "chest")


@dataclass(frozen=True, eq=False)
class MarkerModel:
    """An actor wearing K markers.

    ``segment`` (K,) and ``local`` (K, 3), metres in the segment's frame; ``spread`` (K,) how
    far a marker may sit from its expected place; ``weight`` (K,) in the fit of a pose.
    """

    shape: ActorShape
    segment: Ints
    local: Floats
    spread: Floats
    weight: Floats

    def only(self, markers: Bools | Ints) -> MarkerModel:
        """The same actor with some of the markers."""
        return replace(
            self,
            segment=self.segment[markers],
            local=self.local[markers],
            spread=self.spread[markers],
            weight=self.weight[markers],
        )


def pose_weights() -> Floats:
    """(57,) m² per rad²: how strongly each joint is drawn to zero where markers are silent.

    A marker 0.1 m from a joint counts 0.01 m²/rad², so these are a tenth of one marker or
    less; the spine shares its bending, the collar bones stay near rest, knees and elbows are
    mostly hinges, and a head without markers looks where the chest does.
    """
    weight = np.full(NV, 1e-5)
    weight[:6] = 0.0
    share = {
        "abdomen": (1e-3, 1e-3, 1e-3),
        "chest": (1e-3, 1e-3, 1e-3),
        "head": (3e-4, 3e-4, 3e-4),
        "clavicle": (4e-3, 4e-3, 4e-3),
        "forearm": (2e-4, 1e-5, 5e-5),
        "hand": (2e-4, 2e-4, 2e-3),
        "shank": (2e-3, 2e-5, 1e-3),
        "foot": (2e-4, 1e-4, 2e-4),
    }
    for i, name in enumerate(SEGMENTS[1:], start=1):
        kind = name.removeprefix("left_").removeprefix("right_")
        if kind in share:
            weight[3 + 3 * i : 6 + 3 * i] = share[kind]
    return weight


def fit_poses(
    model: MarkerModel,
    position: Floats,
    start: Floats,
    *,
    weight: Floats | None = None,
    prior: Floats | None = None,
    iterations: int = 30,
    tolerance: float = 3e-4,
) -> Solution:
    """The poses (T, 75) that bring the markers closest to ``position`` (T, K, 3).

    What markers leave open follows anatomy and, where it is given, ``prior`` (T, 75).
    """
    tree = model.shape.tree()
    targets = PointTargets(
        model.segment + 1, model.local, position, model.weight if weight is None else weight
    )
    rest, pull = tree.neutral()[None], pose_weights()
    if prior is not None:
        # Two pulls, to rest and to the prior, are one to the point between them.
        pull[6:] += _ALONG
        share = np.repeat([0.0, _ALONG], [6, NV - 6]) / np.maximum(pull, _ALONG)
        rest = integrate(
            tree, np.repeat(rest, len(prior), 0), share * difference(tree, rest, prior)
        )
    return solve(
        tree,
        start,
        [targets],
        prior=rest,
        prior_weight=pull,
        iterations=iterations,
        tolerance=tolerance,
    )


def first_poses(model: MarkerModel, position: Floats) -> Floats:
    """Poses (T, 75) found segment by segment from the pelvis outwards, each frame on its own.

    Every rotation is the best rigid fit of the segment's markers about its joint (Kabsch
    1976), leaning on the parent's where they leave it open. Needing no start, it cannot carry
    an error from one frame to the next.
    """
    frames = len(position)
    seen = np.asarray(np.isfinite(position).all(axis=-1))
    target = np.where(seen[..., None], position, 0.0)
    turn = np.empty((frames, 18, 3, 3))
    place = np.empty((frames, 18, 3))
    turn[:, 0], place[:, 0] = _pelvis(model, target, seen)
    chest = model.segment == SEGMENT["chest"]
    girdle = np.isin(model.segment, [SEGMENT["left_clavicle"], SEGMENT["right_clavicle"]])
    local = model.local.copy()
    local[girdle] += model.shape.offset[model.segment[girdle]]
    share = seen * (chest + 0.2 * girdle)
    turn[:, 2] = _about_mean(target, local, share, 1e-4 * turn[:, 0])
    turn[:, 1] = _halfway(turn[:, 0], turn[:, 2])
    for segment in range(1, 18):
        parent = PARENTS[segment]
        place[:, segment] = place[:, parent] + turn[:, parent] @ model.shape.offset[segment]
        if segment <= 2:
            continue
        share = seen * (model.segment == segment)
        if SEGMENTS[segment] == "head":
            turn[:, segment] = _about_mean(target, model.local, share, 1e-4 * turn[:, parent])
            continue
        lean = (1e-2 if "clavicle" in SEGMENTS[segment] else 1e-3) * turn[:, parent]
        from_joint = target - place[:, segment, None]
        cross = np.einsum("tk,tki,kj->tij", share, from_joint, model.local)
        turn[:, segment] = _nearest_rotation(cross + lean)
    return _qpos(place[:, 0], turn)


def _pelvis(model: MarkerModel, target: Floats, seen: Bools) -> tuple[Floats, Floats]:
    """Rotation and place of the pelvis; the chest as if upright helps where it is hidden."""
    local = model.local.copy()
    share = seen * (model.segment == SEGMENT["pelvis"]).astype(np.float64)
    above = np.zeros(3)
    for name in _TRUNK[1:]:
        above = above + model.shape.offset[SEGMENT[name]]
        on = model.segment == SEGMENT[name]
        local[on] += above
        share[:, on] = 0.01 * seen[:, on]
    turn = _about_mean(target, local, share, np.zeros((len(target), 3, 3)))
    total = np.maximum(share.sum(axis=1, keepdims=True), 1e-12)
    middle = np.einsum("tk,tkc->tc", share, target) / total
    own = share @ local / total
    return turn, middle - np.matmul(turn, own[..., None])[..., 0]


def _about_mean(target: Floats, local: Floats, share: Floats, lean: Floats) -> Floats:
    """Rotations (T, 3, 3) that best turn ``local`` (K, 3) to ``target`` about their means."""
    total = np.maximum(share.sum(axis=1), 1e-12)
    cross = np.einsum("tk,tki,kj->tij", share, target, local)
    means = np.einsum("tk,tki->ti", share, target), share @ local
    cross -= means[0][:, :, None] * means[1][:, None, :] / total[:, None, None]
    return _nearest_rotation(cross + lean)


def _nearest_rotation(matrix: Floats) -> Floats:
    left, _, right = np.linalg.svd(matrix)
    left[..., -1] *= np.sign(np.linalg.det(left @ right))[..., None]
    rotation: Floats = left @ right
    return rotation


def _halfway(first: Floats, second: Floats) -> Floats:
    middle = slerp(matrix_to_quat(first), matrix_to_quat(second), np.full(len(first), 0.5))
    return quat_to_matrix(middle)


def _qpos(root: Floats, turn: Floats) -> Floats:
    """qpos (T, 75) from the root's place and world rotations (T, 18, 3, 3)."""
    relative = turn.copy()
    for segment in range(1, 18):
        relative[:, segment] = np.swapaxes(turn[:, PARENTS[segment]], 1, 2) @ turn[:, segment]
    quats = matrix_to_quat(relative).reshape(len(root), 72)
    return np.concatenate([root, quats], axis=1)
