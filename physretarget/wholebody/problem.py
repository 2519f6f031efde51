"""One window of a clip: what a pose costs, and the quadratic that this is near the pose."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.ground.undersides import Solid
from physretarget.ground.wrench import external_wrench
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character
from physretarget.wholebody.banded import BlockBand
from physretarget.wholebody.settings import WholeBodySettings
from physretarget.wholebody.support import Support, residual
from physretarget.wholebody.wrench import cross, wrench_slopes

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Window:
    """Frames of a clip that are solved at once, T of them, and what stays the same meanwhile.

    ``original`` (T, nq); ``time`` (T,) s; ``fixed`` (T,) frames that stay as they are. ``targets``
    where markers and contact points are to be. ``metric`` (T, nv, nv) of the markers' displacement,
    over the height squared; ``joint`` (nv,) of a joint's change.
    ``deepest`` (T, G) m, how low each of the ``solids`` may reach. ``face`` body and direction.
    ``share`` (T,) of the price of a residual in each frame; ``slowness`` (T - 1,) what the velocity
    of the change counts between frames.
    """

    character: Character
    settings: WholeBodySettings
    original: Array
    time: Array
    fixed: Flags
    targets: PointTargets
    support: Support
    metric: Array
    joint: Array
    solids: tuple[Solid, ...]
    deepest: Array
    face: tuple[int, Array]
    gaze: Array
    share: Array
    slowness: Array

    @property
    def step(self) -> float:
        """Seconds from one frame to the next."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def tau(self) -> float:
        """√(h / g) s."""
        c = self.character
        return float(np.sqrt(c.com_height * c.mass / c.weight))


@dataclass(frozen=True, eq=False)
class State:
    """A trial: poses, what they require and leave unexplained, and every part of the cost."""

    qpos: Array
    pose: kinematics.Pose
    change: Array  # (T, nv) from the original
    error: Array  # (T, K, 3) of targets, m
    gaze: Array  # (T, 3) turned from the original
    wrench: Array  # (T, 6) about the CoM, BW and BW h
    residual: Array  # (T, 6)
    curvature: Array  # (T, 6, 6)
    excess: Array  # (T, nq) beyond a joint's range
    depth: Array  # (T, G) too deep in the floor, m
    parts: dict[str, float]

    @property
    def cost(self) -> float:
        """The sum of all parts."""
        return sum(self.parts.values())

    @property
    def unexplained(self) -> Array:
        """(T,) length of the residual."""
        found: Array = np.linalg.norm(self.residual, axis=1)
        return found

    @property
    def length(self) -> Array:
        """(T,) of the residual and, next to nothing, of the forces: √(w · y).

        w · y is twice what the fit of forces minimises, and y its gradient by w.
        """
        found: Array = np.sqrt(np.maximum(np.sum(self.wrench * self.residual, axis=1), 0.0))
        return found


@dataclass(frozen=True, eq=False)
class Price:
    """Of a residual: ``soft`` length below which it is quadratic, ``patience`` (T,)."""

    soft: float
    patience: Array


def evaluate(window: Window, qpos: Array, price: Price) -> State:
    """What poses qpos (T, nq) cost."""
    character = window.character
    tree = character.tree
    pose = kinematics.forward(tree, qpos)
    targets = window.targets
    error = kinematics.points(pose, targets.body, targets.local) - targets.target
    required = external_wrench(character, pose, window.step)
    wrench = np.concatenate([required.force, required.moment], axis=1)
    rest, curvature = residual(
        window.support,
        required.com,
        wrench,
        character.com_height,
    )
    body, ahead = window.face
    excess = np.maximum(qpos - character.upper, 0.0) - np.maximum(character.lower - qpos, 0.0)
    excess[~np.isfinite(excess)] = 0.0
    lowest = _lowest(window.solids, pose)
    state = State(
        qpos=qpos,
        pose=pose,
        change=kinematics.difference(tree, window.original, qpos),
        error=error,
        gaze=pose.rotation[:, body] @ ahead - window.gaze,
        wrench=wrench,
        residual=rest,
        curvature=curvature,
        excess=excess,
        depth=np.maximum(window.deepest - lowest, 0.0),
        parts={},
    )
    return replace(state, parts=costs(window, state, price))


def costs(window: Window, state: State, price: Price) -> dict[str, float]:
    """Each part of the cost of a trial."""
    character, settings = window.character, window.settings
    size = len(character.markers) * character.height**2
    rate = window.tau / window.step
    weighted = window.targets.weight * np.sum(state.error**2, axis=-1)
    first, second = np.diff(state.change, 1, axis=0), np.diff(state.change, 2, axis=0)
    length = np.hypot(state.length, price.soft)
    worth = settings.residual * window.share * price.patience
    return {
        "points": 0.5 * float(weighted.sum()) / size,
        "joints": 0.5 * float(np.sum(window.joint * state.change**2)),
        "velocity": 0.5
        * rate**2
        * _form(window.slowness[:, None, None] * window.metric[1:], first),
        "acceleration": 0.5 * settings.acceleration * rate**4 * _form(window.metric[1:-1], second),
        "budget": 0.5 * settings.beyond * float(np.sum(_over_budget(window, state)[0] ** 2)),
        "gaze": 0.5 * settings.gaze * float(np.sum(state.gaze**2)),
        "gaze rate": 0.5
        * settings.gaze_rate
        * rate**2
        * float(np.sum(np.diff(state.gaze, axis=0) ** 2)),
        "limits": 0.5 * settings.limit * float(np.sum(state.excess**2)),
        "floor": 0.5 * settings.floor * float(np.sum((state.depth / character.height) ** 2)),
        "residual": float(worth @ (length - price.soft + 0.5 * settings.spike * state.length**2)),
    }


def normal(window: Window, state: State, price: Price, ignorance: float) -> BlockBand:
    """Gauss-Newton's quadratic of the cost around a trial.

    ``ignorance`` θ in 0..1: how little it is believed that the floor explains what it
    explains at the moment.
    """
    character, settings = window.character, window.settings
    tree, frames = character.tree, len(state.qpos)
    band = BlockBand(frames, tree.nv)
    size = len(character.markers) * character.height**2
    index = np.arange(tree.nv)
    band.blocks[0][:, index, index] += window.joint
    band.gradient += window.joint * state.change
    rate = window.tau / window.step
    band.add_differences(window.slowness * rate**2, window.metric[1:], 1, state.change)
    band.add_differences(settings.acceleration * rate**4, window.metric[1:-1], 2, state.change)
    _add_budget(band, window, state)
    _, by_step = kinematics.difference_slopes(tree, window.original, state.qpos)
    band.gradient = by_step.times(band.gradient[:, None])[:, 0]
    matrix, gradient = kinematics.attraction(tree, state.qpos, state.pose, window.targets)
    band.blocks[0] += matrix / size
    band.gradient += gradient / size
    _add_gaze(band, window, state, rate)
    _add_limits(band, window, state)
    _add_floor(band, window, state)
    _add_wrench(band, window, state, price, ignorance)
    band.pin(window.fixed)
    return band


def _over_budget(window: Window, state: State) -> tuple[Array, Array, Array]:
    """By how much (T,) a frame's markers are moved too far, how far, and the slope (T, nv)."""
    pull = (window.metric @ state.change[..., None])[..., 0]
    far = np.sqrt(np.maximum(np.sum(state.change * pull, axis=1), 1e-12))
    return np.maximum(far - window.settings.most, 0.0), far, pull / far[:, None]


def _add_budget(band: BlockBand, window: Window, state: State) -> None:
    over, far, slope = _over_budget(window, state)
    weight = window.settings.beyond
    band.gradient += weight * over[:, None] * slope
    some = np.flatnonzero(over)
    ratio = (over / far)[some, None, None]
    outer = slope[some, :, None] * slope[some, None, :]
    band.blocks[0][some] += weight * (ratio * window.metric[some] + (1.0 - ratio) * outer)


def _add_gaze(band: BlockBand, window: Window, state: State, rate: float) -> None:
    settings, tree = window.settings, window.character.tree
    body, ahead = window.face
    now = state.pose.rotation[:, body] @ ahead
    angular = kinematics.screws(tree, state.pose, state.qpos)[0]
    turn = cross(angular, now[:, None]) * tree.carries[tree.dof_body, body][:, None]
    turn = turn.swapaxes(1, 2)  # (T, 3, nv)
    unit = np.broadcast_to(np.eye(3), (len(now), 3, 3))
    band.add_rows((turn,), settings.gaze * unit, settings.gaze * state.gaze)
    weight = settings.gaze_rate * rate**2
    band.add_rows((-turn[:-1], turn[1:]), weight * unit[1:], weight * np.diff(state.gaze, axis=0))


def _add_limits(band: BlockBand, window: Window, state: State) -> None:
    at, dof = window.character.tree.scalars
    beyond = state.excess[:, at]
    band.gradient[:, dof] += window.settings.limit * beyond
    band.blocks[0][:, dof, dof] += window.settings.limit * (beyond != 0)


def _add_floor(band: BlockBand, window: Window, state: State) -> None:
    """Rows of what is too deep: how each degree of freedom raises the lowest point of a solid."""
    tree = window.character.tree
    weight = window.settings.floor / window.character.height**2
    frame, which = np.nonzero(state.depth)
    if not len(frame):
        return
    body = np.array([solid.body for solid in window.solids])[which]
    local = np.empty((len(frame), 3))
    for g in np.unique(which):
        mine = which == g
        local[mine] = _lowest_points(window.solids[g], state.pose, frame[mine])
    rows = kinematics.rises(tree, state.pose, state.qpos, frame, body, local)
    for t0 in range(len(frame)):  # few: what touches the floor
        t = frame[t0]
        band.blocks[0][t] += weight * np.outer(rows[t0], rows[t0])
        band.gradient[t] -= weight * state.depth[t, which[t0]] * rows[t0]


def _add_wrench(
    band: BlockBand, window: Window, state: State, price: Price, ignorance: float
) -> None:
    settings = window.settings
    slopes = wrench_slopes(window.character, state.qpos, state.pose, window.step)
    worth = settings.residual * window.share * price.patience
    slope = worth * (1.0 / np.hypot(state.length, price.soft) + settings.spike)
    blend = (1.0 - ignorance) * state.curvature + ignorance * np.eye(6)
    curvature, pull = slope[:, None, None] * blend, slope[:, None] * state.residual
    # √(r² + ε²) bends less along the residual than across it.
    less = (1.0 - ignorance) * worth / np.hypot(state.length, price.soft) ** 3
    curvature -= less[:, None, None] * (state.residual[:, :, None] * state.residual[:, None, :])
    # The floor pushes on where it did, while the centre of mass moves away.
    force = (state.wrench - state.residual)[:, None, :3]
    lever = np.zeros((len(pull), 6, slopes.shift.shape[2]))
    lever[:, 3:] = cross(slopes.shift.swapaxes(1, 2), force).swapaxes(1, 2)
    inner = slice(1, -1)
    band.add_rows(
        (slopes.behind, slopes.here + lever[inner], slopes.ahead), curvature[inner], pull[inner]
    )
    # The first and the last frame have their neighbour's second difference.
    for end, which in ((slice(0, 1), 0), (slice(-1, None), 2)):
        parts = [slopes.behind[end], slopes.here[end], slopes.ahead[end]]
        parts[which] = parts[which] + lever[end]
        band.add_rows(tuple(parts), curvature[end], pull[end], last=which == 2)


def _form(metric: Array, vector: Array) -> float:
    return float(np.einsum("ti,tij,tj->", vector, metric, vector, optimize=True))


def _lowest(solids: tuple[Solid, ...], pose: kinematics.Pose) -> Array:
    return np.stack([solid.heights(pose).min(axis=1) for solid in solids], axis=1)


def _lowest_points(solid: Solid, pose: kinematics.Pose, frames: Ints) -> Array:
    """(N, 3) where a solid is lowest in some frames, in its body's frame."""
    upward = pose.rotation[frames, solid.body, 2]
    along = (upward @ solid.frame) * solid.axes
    size = np.linalg.norm(along, axis=1, keepdims=True)
    reach = ((solid.axes * along) / np.where(size > 0, size, 1.0)) @ solid.frame.T
    lowest = np.argmin(upward @ solid.points.T, axis=1)
    found: Array = solid.points[lowest] - reach
    return found
