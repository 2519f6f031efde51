"""Breadth-first orders of bodies and joints, as simulators on the GPU have them."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics.tree import Tree

Ints = NDArray[np.int64]

_WIDTH = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}


def breadth_first_bodies(tree: Tree) -> Ints:
    """(nb,) the bodies of a tree level by level, the world first."""
    children: dict[int, list[int]] = {}
    for body in range(1, tree.nb):
        children.setdefault(int(tree.parent[body]), []).append(body)
    visited, queue = [], deque([0])
    while queue:
        body = queue.popleft()
        visited.append(body)
        queue.extend(children.get(body, []))
    return np.array(visited, dtype=np.int64)


def breadth_first(tree: Tree) -> Ints:
    """For each qpos coordinate of the model, its column in a breadth-first file."""
    addresses = [
        joint.qpos + i
        for body in breadth_first_bodies(tree)
        for joint in tree.joints_of[int(body)]
        for i in range(_WIDTH[joint.kind])
    ]
    columns = np.empty(tree.nq, dtype=np.int64)
    columns[addresses] = np.arange(tree.nq)
    return columns
