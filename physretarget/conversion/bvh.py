"""BVH: every body of the character becomes a joint of a skeleton, centimetres, y up.

BVH has no rest rotation, so the channels carry the whole rotation of a body in its parent. A hinge
along an axis of such a body is one channel with the hinge's own angle, which never flips; all other
rotations are three Euler angles, of the two ways to write each the one next to the frame before.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physretarget.clip import Clip
from physretarget.kinematics import Tree, forward
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
    skeleton = _Skeleton(character, names, parent, slides, {b: _hinge(tree, b) for b in bodies})
    for body in top:
        skeleton.write(body)
    columns = []
    for body in skeleton.order:
        if body in slides:
            columns.append(100.0 * place[:, body][:, AXES])
        hinge = skeleton.hinges[body]
        if hinge is None:
            columns.append(_angles(turn[:, body]))
        else:
            columns.append(hinge.sign * np.degrees(clip.qpos[:, [hinge.qpos]]))
    rows = np.concatenate(columns, axis=1)
    lines = ["HIERARCHY", *skeleton.lines]
    lines += ["MOTION", f"Frames: {clip.frames}", f"Frame Time: {1.0 / (clip.fps or 1.0):.8f}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Hinge:
    """A body's only joint, along an axis of the file: which channel, where in qpos, which way."""

    channel: str
    qpos: int
    sign: float


def _hinge(tree: Tree, body: int) -> _Hinge | None:
    """The hinge that alone turns a body whose frame is its parent's at rest; None if it is not."""
    mine = [joint for joint in tree.joints if joint.body == body]
    if len(mine) != 1 or mine[0].kind != "hinge":
        return None
    if abs(tree.rotation[body][0]) < 1 - 1e-12:  # (w, x, y, z)
        return None
    axis = np.asarray(mine[0].axis)[AXES]
    along = int(np.argmax(np.abs(axis)))
    if abs(axis[along]) < 1 - 1e-9:
        return None
    return _Hinge("XYZ"[along] + "rotation", mine[0].qpos, float(np.sign(axis[along])))


@dataclass
class _Skeleton:
    """The hierarchy's lines, and the order in which its joints stand."""

    character: Character
    names: list[str]
    parent: NDArray[np.int64]
    slides: set[int]
    hinges: dict[int, _Hinge | None]
    lines: list[str] = field(default_factory=list)
    order: list[int] = field(default_factory=list)

    def write(self, body: int) -> None:
        """One joint and, inside its braces, those below it."""
        self.order.append(body)
        root, hinge = int(self.parent[body]) == 0, self.hinges[body]
        moved = "Xposition Yposition Zposition " if body in self.slides else ""
        turned = ROTATION if hinge is None else hinge.channel
        channels = (moved + turned).split()
        offset = np.zeros(3) if root else self.character.tree.offset[body]
        self.lines += [
            f"{'ROOT' if root else 'JOINT'} {self.names[body].replace(' ', '_')}",
            "{",
            f"OFFSET {_cm(offset)}",
            f"CHANNELS {len(channels)} {' '.join(channels)}",
        ]
        children = np.flatnonzero(self.parent == body)
        below = [int(child) for child in children if child != body]
        for child in below:
            self.write(child)
        if not below:
            end = 2.0 * np.asarray(self.character.model.body_ipos[body])
            self.lines += ["End Site", "{", f"OFFSET {_cm(end)}", "}"]
        self.lines.append("}")


def _cm(vector: Array) -> str:
    return " ".join(f"{100.0 * value:.6f}" for value in vector[AXES])


def _angles(matrix: Array) -> Array:
    """Degrees (T, 3) for the channels ZXY, in the file's axes, without leaps.

    (z, x, y) and (z + 180, 180 - x, y + 180) are one rotation: every frame takes the one nearer to
    the frame before, whole turns added.
    """
    vector = Rotation.from_matrix(matrix).as_rotvec()[:, AXES]
    first = Rotation.from_rotvec(vector).as_euler("ZXY", degrees=True)
    other = first * [1.0, -1.0, 1.0] + 180.0
    found = first.copy()
    for t in range(1, len(first)):
        both = np.stack([first[t], other[t]])
        both += 360.0 * np.round((found[t - 1] - both) / 360.0)
        found[t] = both[int(np.argmin(np.abs(both - found[t - 1]).sum(axis=1)))]
    return found
