"""FBX: a skeleton's nodes and its longest animation, at the file's rate.

Mixamo, Motive, Rokoko, Character Creator and Blender write it. ufbx evaluates the format's chain of
pivots and rotation orders; only the file's own bytes are given to it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, sha256_of
from physretarget.capture.skeleton import Raw, finish, nice_rate
from physretarget.capture.world import Pose, world_of
from physretarget.errors import InputError, MissingExtraError, UnsafeInputError

_LARGEST, _MOST_NODES, _MOST_VALUES = 1 << 30, 20_000, 40_000_000
_CUSTOM = 30.0


def read(path: str | Path, options: ReadOptions) -> JointRecording:
    """Read a skeleton and its animation.

    Args:
        path: The file.
        options: ``rate`` samples at another rate than the file's.

    Raises:
        InputError: It is damaged, or nothing moves in it.
        MissingExtraError: ufbx is not installed.
        UnsafeInputError: It is absurdly large.
    """
    try:
        import ufbx
    except ImportError as error:
        raise MissingExtraError("ufbx", extra="fbx", purpose="Reading FBX") from error
    if Path(path).stat().st_size > _LARGEST:
        raise UnsafeInputError(f"the file is larger than {_LARGEST >> 30} GiB", path=path)
    content = Path(path).read_bytes()
    try:
        scene = ufbx.load_memory(content)
    except Exception as error:  # ufbx has an error of its own
        raise InputError(f"is no readable FBX: {error!s:.100}", path=path) from error
    stacks = [s for s in scene.anim_stacks if s.time_end > s.time_begin]
    if not stacks:
        raise InputError("nothing moves in the file: it has no animation.", path=path)
    stack = max(stacks, key=lambda each: each.time_end - each.time_begin)
    nodes = _skeleton(list(scene.nodes), path)
    stated = float(scene.settings.frames_per_second)
    rate = options.rate or (nice_rate(1 / stated) if 1 <= stated <= 1000 else _CUSTOM)
    frames = round((stack.time_end - stack.time_begin) * rate) + 1
    if frames * len(nodes) * 10 > _MOST_VALUES:
        raise UnsafeInputError(
            f"the animation has {frames} frames of {len(nodes)} nodes", path=path
        )
    time = stack.time_begin + np.arange(frames) / rate
    poses = [_pose(node, stack.anim, time) for node in nodes]
    place = {int(node.typed_id): i for i, node in enumerate(nodes)}
    parents = [place.get(int(n.parent.typed_id), -1) if n.parent else -1 for n in nodes]
    names = [node.name or f"node{i}" for i, node in enumerate(nodes)]
    found = world_of(names, parents, poses, str(path))
    notes = [f"animation {stack.name!r}"] if stack.name else []
    if len(stacks) > 1:
        notes.append(f"{len(stacks) - 1} shorter animations are left out")
    metres = float(scene.settings.unit_meters)
    raw = Raw(
        path=str(path), sha256=sha256_of(content), format="fbx", fps=rate, names=found.names,
        parents=found.parents, position=found.position, rotation=found.rotation, notes=tuple(notes),
        unit=f"{metres:.10g}" if metres > 0 and not options.unit else None,
    )  # fmt: skip
    return finish(raw, unit=options.unit, up=options.up, names=options.names)


def _skeleton(nodes: list[Any], path: str | Path) -> list[Any]:
    """Bones and all that they hang on; every node where no bone is marked as such."""
    bones = {int(node.typed_id) for node in nodes if node.bone is not None}
    wanted: set[int] = set()
    for node in nodes:
        if int(node.typed_id) not in bones and bones:
            continue
        at = node
        while at is not None and int(at.typed_id) not in wanted:
            wanted.add(int(at.typed_id))
            at = at.parent
    kept = [node for node in nodes if int(node.typed_id) in wanted]
    if len(kept) > _MOST_NODES:
        raise UnsafeInputError(f"the file has {len(kept)} nodes", path=path)
    return kept


def _pose(node: Any, anim: Any, time: Floats) -> Pose:
    place, turn, scale = np.empty((len(time), 3)), np.empty((len(time), 4)), np.ones(3)
    for t, at in enumerate(time):
        pose = node.evaluate_transform(anim, float(at))
        place[t] = tuple(pose.translation)[:3]
        turn[t] = tuple(pose.rotation)[:4]
        if t == 0:
            scale[:] = tuple(pose.scale)[:3]
    return Pose(place, Rotation.from_quat(turn).as_matrix(), scale)
