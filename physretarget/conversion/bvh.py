"""BVH: every body of the character becomes a joint of a skeleton, centimetres, y up.

BVH has no rest rotation, so the channels carry the whole rotation of a body in its parent.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physretarget.clip import Clip
from physretarget.kinematics import forward
from physretarget.mjcf import Character

Array = NDArray[np.float64]
# Ours is x forward, y left, z up; the file's y is up and its z forward.
AXES = [1, 2, 0]
ROTATION = "Zrotation Xrotation Yrotation"


def bvh_text(clip: Clip, character: Character) -> str:
    """The clip as BVH; bodies that slide in their parent get position channels too."""
    tree = character.tree
    pose = forward(tree, clip.qpos)
    parent = np.asarray(tree.parent)
    turned = np.swapaxes(pose.rotation[:, parent], -1, -2)
    place = np.einsum("tbij,tbj->tbi", turned, pose.position - pose.position[:, parent])
    turn = turned @ pose.rotation
    bodies = list(range(1, tree.nb))
    top = [b for b in bodies if parent[b] == 0]
    slides = {b for b in bodies if b in top or np.ptp(place[:, b], axis=0).max() > 1e-9}
    names = [f"body_{b}" if not (n := character.model.body(b).name) else n for b in range(tree.nb)]
    children = {b: [c for c in bodies if parent[c] == b] for b in bodies}
    lines, order = ["HIERARCHY"], list[int]()
    for body in top:
        _write(body, lines, order, names, children, slides, tree.offset, character)
    columns = []
    for body in order:
        if body in slides:
            columns.append(100.0 * place[:, body][:, AXES])
        columns.append(_angles(turn[:, body]))
    rows = np.concatenate(columns, axis=1)
    lines += ["MOTION", f"Frames: {clip.frames}", f"Frame Time: {1.0 / (clip.fps or 1.0):.8f}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def _write(
    body: int,
    lines: list[str],
    order: list[int],
    names: list[str],
    children: dict[int, list[int]],
    slides: set[int],
    offset: Array,
    character: Character,
) -> None:
    """One joint and, inside its braces, those below it."""
    order.append(body)
    root = int(character.tree.parent[body]) == 0
    count, moved = (6, "Xposition Yposition Zposition ") if body in slides else (3, "")
    lines += [
        f"{'ROOT' if root else 'JOINT'} {names[body].replace(' ', '_')}",
        "{",
        f"OFFSET {_cm(np.zeros(3) if root else offset[body])}",
        f"CHANNELS {count} {moved}{ROTATION}",
    ]
    for child in children[body]:
        _write(child, lines, order, names, children, slides, offset, character)
    if not children[body]:
        end = 2.0 * np.asarray(character.model.body_ipos[body])
        lines += ["End Site", "{", f"OFFSET {_cm(end)}", "}"]
    lines.append("}")


def _cm(vector: Array) -> str:
    return " ".join(f"{100.0 * value:.6f}" for value in vector[AXES])


def _angles(matrix: Array) -> Array:
    """Degrees (T, 3) for the channels ZXY, in the file's axes."""
    vector = Rotation.from_matrix(matrix).as_rotvec()[:, AXES]
    angles = Rotation.from_rotvec(vector).as_euler("ZXY", degrees=True)
    return np.asarray(np.degrees(np.unwrap(np.radians(angles), axis=0)))
