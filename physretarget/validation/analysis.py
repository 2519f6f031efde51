"""Everything that rules and measures read, computed once per clip and frame.

The clip is worked through in chunks: what a chunk needs in poses, contact points and forces
is dropped when its per-frame results are set aside, and these are read one at a time, so that
memory hardly grows with the clip.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physretarget.clip import Motion
from physretarget.ground.contacts import contact_tolerance
from physretarget.ground.undersides import bearing_solids
from physretarget.kinematics import slerp
from physretarget.mjcf import Character, check_lowpass
from physretarget.options.judging import ValidationOptions
from physretarget.validation.chunk import Workspace
from physretarget.validation.continuity import Continuity, continuity
from physretarget.validation.declared import columns as contact_columns
from physretarget.validation.evidence import Evidence, evidence, probe
from physretarget.validation.grid import Grid, Poses
from physretarget.validation.readings import Better, better_reading
from physretarget.validation.series import ForceSeries, FrameSeries
from physretarget.validation.simulated import Played

Floats = NDArray[np.float64]
Progress = Callable[[int, int], None]  # frames done, frames in all

# Longer ones are faster by the overhead of array operations and take more memory.
CHUNK = 1024
# Beyond this the time axis is not uniform (rounding of text files stays below).
_UNIFORM = 1e-3


@dataclass(frozen=True, eq=False)
class Analysis:
    """A clip, a character, and what is known of every frame.

    ``time`` (T,) s is uniform. ``poses`` (first, last) gives the frames (last - first, nq) before
    the filter. ``own_frames`` tells whether its frames are the clip's, ``stands`` whether a base
    that the model fixes to the world was set free. ``coarse`` is the clip at 30 instants a second,
    None where it has hardly more frames than that. ``played`` is the clip simulated, where that was
    asked for.
    """

    clip: Motion
    character: Character
    settings: ValidationOptions
    time: Floats
    fps: float
    tolerance: float
    friction: float
    poses: Poses
    work: Workspace
    series: FrameSeries
    uneven: Floats = field(default_factory=lambda: np.zeros(0))
    own_frames: bool = True
    stands: bool = False
    coarse: Analysis | None = None
    played: Played | None = None

    @property
    def measured(self) -> Analysis:
        """What measures are taken from: 30 instants a second, or the frames of a slow clip."""
        return self.coarse or self

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.time)

    def clip_frame(self, frame: int) -> int:
        """The clip's own frame nearest to a frame of the (uniform) analysis."""
        if self.own_frames:
            return frame
        return int(np.argmin(np.abs(self.clip.time - self.clip.time[0] - self.time[frame])))

    def body_name(self, body: int) -> str:
        """A body's name, or its number where it has none."""
        return self.character.model.body(int(body)).name or f"body{int(body)}"

    @cached_property
    def continuity(self) -> Continuity:
        """How its frames follow one another, before any filter."""
        return continuity(self.character, self.poses, self.frames, self.fps)

    @cached_property
    def _probe(self) -> tuple[Floats, float]:
        return probe(self.poses, self.frames, self.fps or 1.0)

    @cached_property
    def has_geometry(self) -> bool:
        """Whether the character has any geom that could stand on the floor."""
        return len(bearing_solids(self.character)) > 0

    @property
    def probe(self) -> Floats:
        """(n, nq) poses at about 30 instants a second of the clip's first half minute."""
        return self._probe[0]

    @cached_property
    def evidence(self) -> Evidence:
        """What these say about how the clip was read."""
        return evidence(self.character, *self._probe)

    @cached_property
    def better_reading(self) -> Better | None:
        """Another reading of the clip that makes sense where this one does not."""
        return better_reading(self.character, *self._probe)

    @cached_property
    def forces(self) -> ForceSeries | None:
        """What contact forces are judged by, None where none could be looked for."""
        s = self.series
        if s.floor and s.required and s.bearing and s.residual:
            return ForceSeries(s.floor, s.required, s.bearing, s.residual)
        return None

    @cached_property
    def no_forces_because(self) -> str:
        """Why not."""
        if not self.character.has_root:
            return (
                "the model has no free joint: its base is held by the world "
                "(--stands judges one that only stands on its floor)"
            )
        if self.frames < 4:
            return f"accelerations need at least 4 frames, the clip has {self.frames}"
        return "the model has no contact geometry"


def analyse(
    clip: Motion,
    character: Character,
    settings: ValidationOptions,
    progress: Progress | None = None,
    *,
    stands: bool = False,
) -> Analysis:
    """Compute every series of a clip.

    Raises UsageError where the filter does not fit the frame rate, InputError where the clip
    does not fit the model.
    """
    time, poses, uneven = _uniform(clip, character)
    height = max(character.com_height, 1e-3)
    tolerance = settings.contact_tolerance_m
    if tolerance is None:
        tolerance = contact_tolerance(height)
    friction = settings.friction or character.foot_friction
    work = Workspace.build(character, tolerance=tolerance, friction=settings.friction)
    said = _declared(clip, character, time if len(uneven) else None)
    hz = settings.lowpass_hz
    if hz is not None and len(time) > 1:
        check_lowpass((len(time) - 1) / float(time[-1] - time[0]), hz)
    own = Grid(time, np.arange(len(time), dtype=np.float64), work, hz, poses, said)
    grids = [grid for grid in (own, own.resampled()) if grid is not None]
    done, instants = 0, sum(len(grid.time) for grid in grids)
    for grid in grids:
        for first in range(0, len(grid.time), CHUNK):
            last = min(first + CHUNK, len(grid.time))
            grid.add(first, last)
            done += last - first
            if progress is not None:
                progress(done * len(time) // instants, len(time))
    found: Analysis | None = None
    for grid in reversed(grids):
        found = Analysis(
            clip=clip, character=character, settings=settings, time=grid.time, fps=grid.fps,
            tolerance=tolerance, friction=friction, poses=grid.poses, work=work,
            series=grid.finish(), uneven=uneven, own_frames=grid is own and len(uneven) == 0,
            coarse=found, stands=stands,
        )  # fmt: skip
    assert found is not None
    return found


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
    """(first, last) to (last - first, K) which contact points the clip says to stand."""
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
