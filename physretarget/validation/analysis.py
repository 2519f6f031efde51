"""Everything that rules and measures read, computed once per clip and frame.

The clip is worked through in chunks: what a chunk needs in poses, contact points and forces
is dropped when its per-frame results are set aside, and these are read one at a time, so that
memory hardly grows with the clip.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from physretarget.clip import Motion
from physretarget.kinematics import slerp
from physretarget.mjcf import Character, lowpass
from physretarget.validation.chunk import Chunk, Workspace, analyse_chunk
from physretarget.validation.declared import columns as contact_columns
from physretarget.validation.series import Gathered
from physretarget.validation.smear import dilated, pushed, reach_frames, straight
from physretarget.validation.smoothness import WINDOW_S, edge_frames

if TYPE_CHECKING:
    from physretarget.validation.config import Settings

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Poses = Callable[[int, int], Floats]
Progress = Callable[[int, int], None]  # frames done, frames in all

CHUNK = 1024
# Frames beyond a chunk's ends that differences of third order reach, on top of a window.
_HALO = 6
_FORGOTTEN_PERIODS = 10
# Beyond this the time axis is not uniform (rounding of text files stays below).
_UNIFORM = 1e-3
# Below this share of body weight the direction of a support force means nothing.
SUPPORT_BW = 0.1
# 3 % of the CoM height, within 1 and 2 cm: soles of robots and captures lie that far off.
_TOLERANCE_OF_HEIGHT, _TOLERANCE_M = 0.03, (0.01, 0.02)


@dataclass(frozen=True, eq=False)
class Analysis:
    """Per-frame results; forces in body weights, moments in body weight times CoM height.

    ``time`` (T,) s is uniform. ``series`` maps a name to (T,) or (T, n) arrays, see
    :class:`physretarget.validation.chunk.Chunk` for their meanings; a missing name could not
    be computed. ``poses`` (first, last) gives the frames (last - first, nq) before the filter.
    """

    clip: Motion
    character: Character
    settings: Settings
    time: Floats
    fps: float
    tolerance: float
    friction: float
    poses: Poses
    work: Workspace
    series: Mapping[str, NDArray[np.generic]] = field(default_factory=dict)
    uneven: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.time)

    @property
    def has(self) -> frozenset[str]:
        """Names of the series that could be computed."""
        return frozenset(self.series)

    def __getitem__(self, name: str) -> Floats:
        """A series as float64."""
        return np.asarray(self.series[name], dtype=np.float64)

    def ints(self, name: str) -> Ints:
        """A series of indices."""
        return np.asarray(self.series[name], dtype=np.int64)

    def flags(self, name: str) -> NDArray[np.bool_]:
        """A series of booleans."""
        return np.asarray(self.series[name], dtype=np.bool_)

    def clip_frame(self, frame: int) -> int:
        """The clip's own frame nearest to a frame of the (uniform) analysis."""
        if len(self.uneven) == 0:
            return frame
        return int(np.argmin(np.abs(self.clip.time - self.clip.time[0] - self.time[frame])))

    def body_name(self, body: int) -> str:
        """A body's name, or its number where it has none."""
        return self.character.model.body(int(body)).name or f"body{int(body)}"

    @cached_property
    def judges_forces(self) -> bool:
        """Whether contact forces could be looked for at all."""
        return "unexplained_force" in self.series

    @cached_property
    def no_forces_because(self) -> str:
        """Why not."""
        if not self.character.has_root:
            return "the model has no free joint: its base is held by the world"
        if self.frames < 4:
            return f"accelerations need at least 4 frames, the clip has {self.frames}"
        return "the model has no contact geometry"


def analyse(
    clip: Motion,
    character: Character,
    settings: Settings,
    progress: Progress | None = None,
) -> Analysis:
    """Compute every series of a clip.

    Raises UsageError where the filter does not fit the frame rate, InputError where the clip
    does not fit the model.
    """
    time, poses, uneven = _uniform(clip, character)
    fps = (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else 0.0
    height = max(character.com_height, 1e-3)
    tolerance = settings.contact_tolerance_m
    if tolerance is None:
        tolerance = float(np.clip(_TOLERANCE_OF_HEIGHT * height, *_TOLERANCE_M))
    friction = settings.friction or character.friction
    work = Workspace.build(character, tolerance=tolerance, friction=friction)
    said = _declared(clip, character, time if len(uneven) else None)
    series = Gathered()
    reach = reach_frames(fps, settings.lowpass_hz)
    halo = _HALO + max(reach, math.ceil(WINDOW_S * fps / 2) + edge_frames(fps))
    for first in range(0, len(time), CHUNK):
        last = min(first + CHUNK, len(time))
        start, stop = max(0, first - halo), min(len(time), last + halo)
        given = poses(start, stop)
        smooth = given
        if settings.lowpass_hz is not None and len(time) > 1:
            smooth = _filtered(character, poses, len(time), fps, settings.lowpass_hz, start, stop)
        chunk = Chunk(
            qpos=smooth, raw=given, time=time[start:stop],
            keep=slice(first - start, last - start), reach=reach,
            declared=None if said is None else said(start, stop),
        )  # fmt: skip
        series.add({name: _slim(name, s) for name, s in analyse_chunk(work, chunk).items()})
        if progress is not None:
            progress(last, len(time))
    series.add(_over_time(character, series, fps, settings.lowpass_hz))
    return Analysis(
        clip=clip, character=character, settings=settings, time=time, fps=fps,
        tolerance=tolerance, friction=friction, poses=poses, work=work, series=series,
        uneven=uneven,
    )  # fmt: skip


def _slim(name: str, series: NDArray[np.generic]) -> NDArray[np.generic]:
    """A series as it is kept: in single precision, six digits of whatever it measures.

    The CoM's path will be differentiated and stays as it is.
    """
    if name == "given_com" or series.dtype == np.bool_:
        return series
    return series.astype(np.float32 if series.dtype.kind == "f" else np.int32)


def _over_time(
    character: Character, series: Mapping[str, NDArray[np.generic]], fps: float, hz: float | None
) -> dict[str, NDArray[np.generic]]:
    """What takes a clip as a whole: pushes smeared by the filter, and friction beside them."""
    if "required_force" not in series:
        return {}
    required = np.asarray(series["required_force"], dtype=np.float64)
    path = np.asarray(series["given_com"], dtype=np.float64)
    gravity = float(np.linalg.norm(character.model.opt.gravity))
    force = straight(required, path, fps, hz, gravity)
    anywhere = np.ones(len(force), dtype=bool)
    ringing = np.minimum(pushed(force[:, 2], anywhere, fps, hz), 0.0)
    found: dict[str, NDArray[np.generic]] = {"straight_force": force, "ringing": ringing}
    if "touching" in series:
        near = dilated(np.asarray(series["touching"]) > 0, 1)
        found["pushed"] = pushed(force[:, 2], near, fps, hz)
    with np.errstate(divide="ignore", invalid="ignore"):
        demand = np.linalg.norm(required[:, :2], axis=1) / (required[:, 2] - ringing)
    found["friction_demand"] = np.where(required[:, 2] > SUPPORT_BW, demand, np.nan)
    return {name: _slim(name, part) for name, part in found.items()}


def _filtered(
    character: Character, poses: Poses, frames: int, fps: float, hz: float, start: int, stop: int
) -> Floats:
    """Frames start to stop of the filtered clip, as if it had been filtered as a whole."""
    # The filter forgets by exp(-2 pi hz t / sqrt(2)): 1e-19 after ten periods.
    reach = math.ceil(_FORGOTTEN_PERIODS * fps / hz)
    before, behind = max(0, start - reach), min(frames, stop + reach)
    smooth = lowpass(character, poses(before, behind), fps, hz)
    return smooth[start - before : stop - before]


def _uniform(clip: Motion, character: Character) -> tuple[Floats, Poses, Floats]:
    """The clip on a uniform time axis: itself, or resampled at its mean rate."""
    time = clip.time - clip.time[0]
    if len(time) < 3:
        return time, clip.between, np.zeros(0)
    step = time[-1] / (len(time) - 1)
    deviation = np.abs(np.diff(time) - step) / step
    even = np.arange(len(time)) * step
    if deviation.max() <= _UNIFORM:
        return even, clip.between, np.zeros(0)
    after = np.clip(np.searchsorted(time, even, side="right"), 1, len(time) - 1)
    share = (even - time[after - 1]) / (time[after] - time[after - 1])

    def poses(first: int, last: int) -> Floats:
        here, part = after[first:last], share[first:last]
        given = clip.between(int(here[0]) - 1, int(here[-1]) + 1)
        behind = here - (here[0] - 1)
        return _between(character, given[behind - 1], given[behind], part)

    return even, poses, deviation


def _declared(
    clip: Motion, character: Character, even: Floats | None
) -> Callable[[int, int], NDArray[np.bool_]] | None:
    """(first, last) to (last - first, K) which candidate points the clip says to stand."""
    mine, active = contact_columns(clip, character), clip.contact_active
    if mine is None or active is None:
        return None
    frames = np.arange(clip.frames)
    if even is not None:  # resampled: the clip's frame nearest in time
        time = clip.time - clip.time[0]
        frames = np.searchsorted(0.5 * (time[1:] + time[:-1]), even)
    return lambda first, last: active[np.ix_(frames[first:last], mine)]


def _between(character: Character, before: Floats, behind: Floats, share: Floats) -> Floats:
    qpos = before + share[:, None] * (behind - before)
    for columns in character.tree.quats[0]:
        qpos[:, columns] = slerp(before[:, columns], behind[:, columns], share)
    return qpos
