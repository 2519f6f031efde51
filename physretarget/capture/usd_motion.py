"""USD: the first skeleton's animation (UsdSkel), at the stage's rate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, sha256_of
from physretarget.capture.skeleton import Raw, finish, nice_rate
from physretarget.capture.world import Pose, world_of
from physretarget.errors import InputError, MissingExtraError, UnsafeInputError

_LARGEST, _MOST_FRAMES = 1 << 30, 200_000


def read(path: str | Path, options: ReadOptions) -> JointRecording:
    """Read a skeleton and its animation.

    Raises:
        InputError: It is damaged, or holds no moving skeleton.
        MissingExtraError: usd-core is not installed.
    """
    try:
        from pxr import Usd, UsdGeom, UsdSkel
    except ImportError as error:
        raise MissingExtraError("usd-core", extra="usd", purpose="Reading USD") from error
    if Path(path).stat().st_size > _LARGEST:
        raise UnsafeInputError(f"the file is larger than {_LARGEST >> 30} GiB", path=path)
    try:
        stage = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
    except Exception as error:  # pxr's errors are its own
        raise InputError("is no readable USD stage.", path=path) from error
    skeleton = next((p for p in stage.Traverse() if p.IsA(UsdSkel.Skeleton)), None)
    if skeleton is None:
        raise InputError("the stage holds no skeleton.", path=path)
    query = UsdSkel.Cache().GetSkelQuery(UsdSkel.Skeleton(skeleton))
    animation = query.GetAnimQuery() if query else None
    if not animation or not animation.JointTransformsMightBeTimeVarying():
        raise InputError("the skeleton has no animation.", path=path)
    times = _times(stage, animation, str(path))
    joints = list(query.GetJointOrder())
    index = {name: i for i, name in enumerate(joints)}
    parents = [index.get(name.rpartition("/")[0], -1) for name in joints]
    root = UsdGeom.XformCache()
    matrices = np.empty((len(times), len(joints), 4, 4))
    carriers = np.empty((len(times), 4, 4))
    for t, time in enumerate(times):
        local = query.ComputeJointLocalTransforms(time)
        matrices[t] = np.array([np.array(m) for m in local])
        root.SetTime(time)
        carriers[t] = np.array(root.GetLocalToWorldTransform(skeleton))
    poses = [_pose(carriers)] + [_pose(matrices[:, j]) for j in range(len(joints))]
    names = [skeleton.GetName(), *(name.rpartition("/")[2] for name in joints)]
    found = world_of(names, [-1, *(p + 1 for p in parents)], poses, str(path))
    unit = options.unit or f"{UsdGeom.GetStageMetersPerUnit(stage):.10g}"
    fps = nice_rate(1 / float(stage.GetTimeCodesPerSecond()))
    raw = Raw(
        path=str(path), sha256=sha256_of(Path(path).read_bytes()), format="usd", fps=fps,
        names=found.names, parents=found.parents,
        position=found.position, rotation=found.rotation, unit=None if options.unit else unit,
    )  # fmt: skip
    return finish(raw, unit=options.unit, up=options.up, names=options.names)


def _times(stage: Any, animation: Any, path: str) -> Floats:
    """The stage's frames from the first sample to the last."""
    samples = animation.GetJointTransformTimeSamples()
    if len(samples) < 2:
        raise InputError("the skeleton has no animation.", path=path)
    first, last = float(samples[0]), float(samples[-1])
    if not last - first < _MOST_FRAMES:
        raise UnsafeInputError(f"the animation claims {last - first:g} frames.", path=path)
    times: Floats = np.arange(round(last - first) + 1, dtype=np.float64) + first
    return times


def _pose(matrix: Floats) -> Pose:
    """Place, rotation and scale of matrices (T, 4, 4) that act on rows, as USD's do."""
    turn = np.swapaxes(matrix[:, :3, :3], 1, 2)
    scale = np.linalg.norm(turn, axis=1)
    rotation = turn / np.maximum(scale, 1e-12)[:, None]
    return Pose(matrix[:, 3, :3], rotation, np.median(scale, axis=0))
