"""From nodes that hang on each other to joints in the world, whatever the file's format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physretarget.capture.recording import Floats
from physretarget.errors import InputError

__all__ = ["Joints", "Pose", "world_of"]


@dataclass(frozen=True, eq=False)
class Pose:
    """One node in its parent: place (T, 3), rotation (T, 3, 3), and scale (3,) along its axes."""

    place: Floats
    rotation: Floats
    scale: Floats


@dataclass(frozen=True, eq=False)
class Joints:
    """Joints in the file's world, parents first: see JointRecording."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    position: Floats
    rotation: Floats


def world_of(
    names: Sequence[str], parents: Sequence[int], poses: Sequence[Pose], path: str
) -> Joints:
    """World places and rotations of nodes; a scale moves what hangs on a node, and turns nothing.

    Args:
        names: Of the nodes, in the file's order.
        parents: Each one's parent, -1 for none.
        poses: Each one's pose in its parent, over the same frames.
        path: The file's name, for errors.

    Raises:
        InputError: A node hangs on itself.
    """
    order: list[int] = []
    waiting = [i for i, parent in enumerate(parents) if parent < 0]
    children: dict[int, list[int]] = {}
    for i, parent in enumerate(parents):
        children.setdefault(parent, []).append(i)
    while waiting:
        order.append(waiting.pop(0))
        waiting += children.get(order[-1], [])
    if len(order) != len(names):
        raise InputError("a node hangs on itself.", path=path)
    rank = {old: new for new, old in enumerate(order)}
    frames = len(poses[0].place)
    position = np.empty((frames, len(order), 3))
    rotation = np.empty((frames, len(order), 3, 3))
    stretch = np.empty((len(order), 3))
    for new, old in enumerate(order):
        pose, parent = poses[old], parents[old]
        if parent < 0:
            position[:, new], rotation[:, new] = pose.place, pose.rotation
            stretch[new] = pose.scale
            continue
        above = rank[parent]
        place = pose.place * stretch[above]
        position[:, new] = position[:, above] + np.einsum("tij,tj->ti", rotation[:, above], place)
        rotation[:, new] = rotation[:, above] @ pose.rotation
        stretch[new] = stretch[above] * pose.scale
    return Joints(
        names=tuple(names[old] for old in order),
        parents=tuple(rank[parents[old]] if parents[old] >= 0 else -1 for old in order),
        position=position,
        rotation=rotation,
    )
