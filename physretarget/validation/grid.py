"""A clip at its own frame rate, and at 30 instants a second for the measures.

Findings look at every frame. Numbers about a whole clip have to mean the same at any frame rate:
they are those of the clip at 30 frames/s, filtered and differentiated as such. Accelerations
between are not passed over: a second difference over n frames,

    (p[t + n] - 2 p[t] + p[t - n]) / (n dt)^2 = sum_k (n - |k|) / n^2  a[t + k],

is the mean of the second differences a of all frames between, with a hat for a weight, and the
hats of neighbouring instants add up to one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter

from physretarget.ground.response import (
    explained_force,
    filtered,
    near_contact,
    reach_frames,
    side_lobes,
)
from physretarget.ground.wrench import external_wrench
from physretarget.kinematics import Pose, Tree, difference, forward, integrate
from physretarget.mjcf import lowpass
from physretarget.validation.chunk import Chunk, Workspace, analyse_chunk
from physretarget.validation.series import Bearing, FrameSeries, Gathered, Pushes, Residual
from physretarget.validation.smoothness import WINDOW_S, edge_frames

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Poses = Callable[[int, int], Floats]
Flags = Callable[[int, int], Bools]

# The rate that clips of robots and animations come in: what they can show, all can.
MEASURED_HZ = 30.0
# Slower than this a clip is measured frame by frame: cubics between its frames would cut peaks.
_FASTER_THAN_HZ = 45.0
# So is a clip of fewer instants than a fourth-order difference and its neighbours need, and one
# with a filter that is too fast for 30 instants a second.
_FEWEST = 8
_FILTER_HZ = 0.4 * MEASURED_HZ
# An instant this near to a frame is that frame.
_SAME_FRAME = 1e-3
# Frames beyond a chunk's ends that differences of third order reach, on top of a window.
_HALO = 6
# Below this share of body weight the direction of a support force means nothing.
SUPPORT_BW = 0.1
# Below this a centre of pressure says nothing: little moves it far.
BORNE_BW = 0.2


class Grid:
    """Some instants of a clip, analysed piece by piece.

    ``time`` (T,) s are the instants; ``poses`` and ``declared`` (first, last) give some of them,
    before the filter; ``place`` (T,) says where they lie, in frames of the clip.
    """

    def __init__(
        self, time: Floats, place: Floats, work: Workspace, lowpass_hz: float | None,
        poses: Poses, declared: Flags | None,
    ) -> None:  # fmt: skip
        self.time = time
        self.place = place
        self.poses = poses
        self.fps = (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else 0.0
        self._gathered = Gathered()
        self._declared = declared
        self._work = work
        self._hz = lowpass_hz
        self._reach = reach_frames(self.fps, lowpass_hz)
        window = math.ceil(WINDOW_S * self.fps / 2) + edge_frames(self.fps)
        self._halo = _HALO + max(self._reach, window)

    def resampled(self) -> Grid | None:
        """The same clip at 30 instants a second, None where it has no more frames than that."""
        fast = self._hz is not None and self._hz > _FILTER_HZ
        if self.fps < _FASTER_THAN_HZ or fast:
            return None
        count = math.floor(float(self.time[-1]) * MEASURED_HZ + _SAME_FRAME) + 1
        if count < _FEWEST:
            return None
        time = np.arange(count) / MEASURED_HZ
        place = np.minimum(time * self.fps, len(self.time) - 1)
        near = np.round(place)
        place = np.where(np.abs(place - near) < _SAME_FRAME, near, place)
        poses = partial(_interpolated, self._work.character.tree, self.poses, place, len(self.time))
        said = None if self._declared is None else partial(_nearest, self._declared, place)
        return Grid(time, place, self._work, self._hz, poses, said)

    def add(self, first: int, last: int) -> None:
        """Answer for the instants ``first`` to ``last`` - 1."""
        start, stop = max(0, first - self._halo), min(len(self.time), last + self._halo)
        before, behind = start, stop
        if self._hz is not None and len(self.time) > 1:
            # Beyond that the filter has forgotten all but 1e-19.
            poles = butter(2, 2 * self._hz / self.fps, output="zpk")[1]
            reach = math.ceil(math.log(1e-19) / math.log(float(np.abs(poles).max())))
            before, behind = max(0, start - reach), min(len(self.time), stop + reach)
        given = self.poses(before, behind)
        pose = forward(self._work.character.tree, given)
        force, moment = self._required(pose)
        here = slice(start - before, stop - before)
        smooth = given
        if self._hz is not None and len(self.time) > 1:
            smooth = lowpass(self._work.character, given, self.fps, self._hz)
        raw = given[here]
        chunk = Chunk(
            qpos=raw if smooth is given else smooth[here], raw=raw, force=force[here],
            raw_pose=Pose(pose.position[here], pose.rotation[here]), moment=moment[here],
            time=self.time[start:stop],
            keep=slice(first - start, last - start), reach=self._reach,
            declared=None if self._declared is None else self._declared(start, stop),
        )  # fmt: skip
        self._gathered.add(analyse_chunk(self._work, chunk))

    def finish(self) -> FrameSeries:
        """All series, with what takes the clip as a whole: the filter's response, and friction."""
        series = self._gathered.series
        if series.required is None:
            return series
        required = series.required.force
        anywhere = np.full(len(required), self._work.character.foot_friction)
        pushed = explained_force(required, anywhere, self.fps, self._hz)
        ringing = np.minimum(pushed[:, 2], 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            demand = np.linalg.norm(required[:, :2], axis=1) / (required[:, 2] - ringing)
        demand = np.where(required[:, 2] > SUPPORT_BW, demand, np.nan)
        residual = None
        if series.floor is not None and series.bearing is not None:
            residual = self._residual(required, near_contact(series.floor.grip), series.bearing)
        self._gathered.add(FrameSeries(pushes=Pushes(ringing, demand), residual=residual))
        return self._gathered.series

    def _residual(self, required: Floats, grip: Floats, bearing: Bearing) -> Residual:
        """What remains of force and moment, and the latter as a centre of pressure."""
        explained = explained_force(required, grip, self.fps, self._hz)
        arm, rest = bearing.arm, bearing.moment_rest
        lobes = side_lobes(required, arm, self.fps, self._hz)
        left = np.maximum(np.linalg.norm(rest, axis=1) - lobes, 0.0)
        tips = np.maximum(np.hypot(rest[:, 0], rest[:, 1]) - lobes, 0.0)
        borne = bearing.supported & (required[:, 2] > BORNE_BW)
        height = max(self._work.character.com_height, 1e-3)
        outside = tips * height / np.where(borne, required[:, 2], np.nan)
        force = np.linalg.norm(required - explained, axis=1)
        return Residual(explained, force, lobes, left, outside)

    def _required(self, pose: Pose) -> tuple[Floats, Floats]:
        """Force (T, 3) BW and moment (T, 3) BW h, filtered; zeros where they cannot be had.

        The filter is linear: what it makes of the wrench is what forces look like through it, while
        the wrench of filtered coordinates has their corners cut.
        """
        if len(pose.position) < 3 or not self._work.character.has_root:
            return np.zeros((len(pose.position), 3)), np.zeros((len(pose.position), 3))
        wrench = external_wrench(self._work.character, pose, 1 / self.fps)
        return (
            filtered(wrench.force, self.fps, self._hz), filtered(wrench.moment, self.fps, self._hz)
        )  # fmt: skip


def _interpolated(
    tree: Tree, poses: Poses, place: Floats, frames: int, first: int, last: int
) -> Floats:
    """(last - first, nq) poses at instants: of frames, and between them of cubics through four.

    Cubics are exact to fourth order, rotations being rotation vectors from the frame before.
    """
    here = place[first:last]
    before = np.floor(here).astype(np.int64)
    if np.array_equal(here, before):
        whole: Floats = poses(int(before[0]), int(before[-1]) + 1)[before - before[0]]
        return whole
    left = np.clip(before - 1, 0, frames - 4)
    start = int(left[0])
    given = poses(start, int(left[-1]) + 4)
    base, where = given[before - start], here - left
    change = np.zeros((len(here), tree.nv))
    for node in range(4):
        others = [k for k in range(4) if k != node]
        weight = np.prod([(where - k) / (node - k) for k in others], axis=0)
        change += weight[:, None] * difference(tree, base, given[left - start + node])
    return np.where((here == before)[:, None], base, integrate(tree, base, change))


def _nearest(declared: Flags, place: Floats, first: int, last: int) -> Bools:
    """What a clip says in the frames nearest to some instants."""
    frames = np.round(place[first:last]).astype(np.int64)
    near: Bools = declared(int(frames[0]), int(frames[-1]) + 1)[frames - frames[0]]
    return near
