"""Inverse kinematics: mapped features → poses of the character.

The mapper predicts where the virtual markers are in the local frame; here the joints are
found that bring them there, as weighted least squares within the joint limits (Yamane
2010, section 4.1 and 5.2 use the same for contacts). A clip is solved as one motion, in
which speed and acceleration of the joints have a price: solved frame by frame, the answer
leaps where a joint's two ways of reaching a place meet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from physretarget import kinematics
from physretarget.errors import InputError
from physretarget.features import frame_of
from physretarget.kinematics import PointTargets, Price
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class IkSettings:
    """How the markers are followed.

    Over a clip each joint speed of 1 rad/s (or of one height per second along a slide) costs
    as much as markers that miss by ``velocity_s`` of the height (RMS), each acceleration of
    1 rad/s² as much as ``acceleration_s2``. A joint that turns a tenth of the markers at a
    fifth of the height, as a forearm does, then follows half of a swing of 6 Hz, to which
    captures are filtered before, and 96 % of one of 2 Hz; one that no marker sees well
    follows more slowly, instead of leaping.

    prior: how much a joint that no marker determines is held to the start pose, in m² per
    rad² of the sum of squared marker distances. doubt: stretches whose markers miss by more
    than this share of the height (RMS, with the price of motion) are also sought from the
    reference pose. iterations: the most steps per start; tolerance: a search ends when its
    step is below this (rad or m).
    """

    velocity_s: float = 1e-3
    acceleration_s2: float = 4.5e-5
    doubt: float = 0.025
    prior: float = 1e-6
    iterations: int = 15
    tolerance: float = 3e-4


@dataclass(frozen=True, eq=False)
class IkResult:
    """Poses that follow the features.

    ``qpos`` (T, nq) with root x = y = 0 and heading 0; ``residual_rms`` (T,) m, root mean
    square distance of the markers to where the features put them.
    """

    qpos: Floats
    residual_rms: Floats


def solve(
    character: Character,
    features: Floats,
    *,
    start: Floats | None = None,
    settings: IkSettings | None = None,
) -> IkResult:
    """Find the pose of every row of ``features``, each for itself; for clips :func:`follow`.

    Args:
        character: whose ``markers`` the features describe.
        features: (T, 3K) stacked marker coordinates in the local frame, m.
        start: (T, nq) or (nq,) where to begin, e.g. the nearest key pose; the reference pose
            if None.
        settings: defaults if None; prices of motion play no part.

    Raises:
        InputError: the features have another width than the markers, or are not finite.
    """
    settings = settings or IkSettings()
    target = _targets(character, features)
    markers = character.markers
    found = kinematics.solve(
        character.tree,
        _begin(character, start, len(target)),
        [PointTargets(markers.body, markers.local, target)],
        lower=character.lower,
        upper=character.upper,
        locked=_locked(character),
        prior_weight=settings.prior,
        iterations=settings.iterations,
        tolerance=settings.tolerance,
    )
    return _result(character, found.qpos, target)


COARSE_HZ, FINE_HZ = 12.0, 24.0
"""Frame rates, at least, at which a clip is first sought and then solved. Captures hold nothing
above 6 Hz; poses between the frames of the finer one are interpolated."""
REFINEMENTS = 4
"""Steps at the finer rate, which begins next to its answer."""


def follow(
    character: Character,
    features: Floats,
    fps: float,
    *,
    start: Floats | None = None,
    settings: IkSettings | None = None,
) -> IkResult:
    """Find the motion whose markers follow a clip's ``features``.

    Args:
        character: whose ``markers`` the features describe.
        features: (T, 3K) stacked marker coordinates in the local frame, m, of frames that
            follow each other in time.
        fps: how many of them there are in a second.
        start: (T, nq) or (nq,) where to begin, as for :func:`solve`.
        settings: defaults if None.

    Raises:
        InputError: the features have another width than the markers, or are not finite.
    """
    settings = settings or IkSettings()
    target = _targets(character, features)
    begin = _begin(character, start, len(target))
    fine = max(1, int(fps / FINE_HZ))
    coarse = fine * max(1, int(fps / fine / COARSE_HZ))
    problem = _Clip(character, target, begin, fps, settings)
    rest = _begin(character, None, len(target))
    grid, poses = problem.solved(coarse, [begin, rest], settings.iterations)
    if coarse != fine:
        between = between_frames(character, grid, poses, len(target))
        grid, poses = problem.solved(fine, [between], REFINEMENTS)
    if fine > 1:
        poses = between_frames(character, grid, poses, len(target))
    return _result(character, poses, target)


@dataclass(frozen=True, eq=False)
class _Clip:
    """A clip's marker targets (T, K, 3), where its search begins (T, nq), and how it is solved."""

    character: Character
    target: Floats
    begin: Floats
    fps: float
    settings: IkSettings

    def solved(self, stride: int, starts: list[Floats], iterations: int) -> tuple[Ints, Floats]:
        """Every ``stride``-th frame and its pose. The last frame may lie beyond the clip's end."""
        character, settings = self.character, self.settings
        grid = np.arange(0, len(self.target) + stride - 1, stride)
        inside = np.minimum(grid, len(self.target) - 1)
        markers = character.markers
        one = len(markers.names) * character.height**2  # the solver's cost sums over markers, in m²
        found = kinematics.solve_trajectory(
            character.tree,
            [start[inside] for start in starts],
            [PointTargets(markers.body, markers.local, _sampled(self.target, grid))],
            step_s=stride / self.fps,
            price=motion_price(character, settings),
            lower=character.lower,
            upper=character.upper,
            locked=_locked(character),
            prior=self.begin[inside],
            prior_weight=settings.prior,
            doubt=0.5 * one * settings.doubt**2,
            iterations=iterations,
            tolerance=settings.tolerance,
        )
        return grid, found.qpos


def motion_price(character: Character, settings: IkSettings) -> Price:
    """What motion costs where each marker's distance has the weight 1."""
    one = len(character.markers.names) * character.height**2
    unit = np.where(character.tree.tables.dof_turns > 0, 1.0, 1.0 / character.height)
    return Price(
        velocity=one * (settings.velocity_s * unit) ** 2,
        acceleration=one * (settings.acceleration_s2 * unit) ** 2,
    )


def _sampled(target: Floats, grid: Ints) -> Floats:
    """Targets at the frames of a grid; what lies beyond the end is mirrored about the last one."""
    last = len(target) - 1
    found = target[np.minimum(grid, last)]
    beyond = grid > last
    found[beyond] = 2.0 * target[last] - target[np.maximum(2 * last - grid[beyond], 0)]
    return found


def between_frames(character: Character, grid: Ints, qpos: Floats, frames: int) -> Floats:
    """Poses (frames, nq) on cubic splines through those of a grid, within the joint limits."""
    if len(grid) < 2:
        return np.repeat(qpos, frames, axis=0)
    smooth = continuous_qpos(character, qpos)
    poses = np.asarray(CubicSpline(grid, smooth, axis=0)(np.arange(frames)))
    poses = np.clip(poses, character.lower, character.upper)
    for part in _quats(character):
        poses[:, part] /= np.linalg.norm(poses[:, part], axis=1, keepdims=True)
    return poses


def _begin(character: Character, start: Floats | None, frames: int) -> Floats:
    """(T, nq) where a search begins: the root over the origin, its height and tilt free."""
    pose = character.reference_qpos if start is None else start
    begin = np.array(np.broadcast_to(pose, (frames, character.tree.nq)))
    if character.has_root:
        begin[:, character.root_qpos : character.root_qpos + 2] = 0.0
    return begin


def _locked(character: Character) -> NDArray[np.bool_]:
    """(nv,) what must not move: the root stands over the origin."""
    locked = np.zeros(character.tree.nv, dtype=bool)
    if character.has_root:
        locked[character.root_dof : character.root_dof + 2] = True
    return locked


def _result(character: Character, qpos: Floats, target: Floats) -> IkResult:
    markers = character.markers
    pose = kinematics.forward(character.tree, qpos)
    miss = kinematics.points(pose, markers.body, markers.local) - target
    rms = np.sqrt(np.mean(np.sum(miss * miss, axis=2), axis=1))
    return IkResult(continuous_qpos(character, facing_forward(character, qpos)), rms)


def _targets(character: Character, features: Floats) -> Floats:
    markers = len(character.markers.names)
    if features.shape[1] != 3 * markers:
        raise InputError(
            f"the features have {features.shape[1]} columns; {character.name} has {markers} "
            f"markers and needs {3 * markers}."
        )
    broken = ~np.isfinite(features).all(axis=1)
    if broken.any():
        raise InputError("the features are not finite.", frame=int(np.argmax(broken)))
    return features.reshape(len(features), markers, 3)


def facing_forward(character: Character, qpos: Floats) -> Floats:
    """Turn the root about the vertical until the heading is zero; features stay as they are.

    Features have heading zero by construction, but predicted ones are no exact pose and
    the best fit may face a fraction of a degree aside.
    """
    if not character.has_root:
        return qpos
    half = -0.5 * frame_of(character, qpos).yaw
    turn = np.zeros((len(qpos), 4))
    turn[:, 0], turn[:, 3] = np.cos(half), np.sin(half)
    turned = qpos.copy()
    quat = slice(character.root_qpos + 3, character.root_qpos + 7)
    turned[:, quat] = kinematics.quat_multiply(turn, qpos[:, quat])
    return turned


def continuous_qpos(character: Character, qpos: Floats) -> Floats:
    """The same poses with quaternion signs that do not flip from frame to frame."""
    smooth = qpos.copy()
    for part in _quats(character):
        smooth[:, part] = kinematics.continuous(qpos[:, part])
    return smooth


def _quats(character: Character) -> list[slice]:
    """Where the quaternions lie in qpos."""
    first = [
        joint.qpos + (3 if joint.kind == "free" else 0)
        for joint in character.tree.joints
        if joint.kind in ("free", "ball")
    ]
    return [slice(at, at + 4) for at in first]
