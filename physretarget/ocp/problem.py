"""The residuals of one frame, exact derivatives by CasADi, mapped over all frames.

Raising the root by Δz(t) changes inverse dynamics exactly affinely: with the root's vertical
acceleration grown by Δz̈ the force grows by ``m Δz̈`` and the moment about the root by
``(com - root) x (0, 0, m Δz̈)``; nothing else moves. So everything that a frame's residuals need
is known from one pass of inverse dynamics, and they depend on three numbers alone,
(Δz, Δż, Δz̈), which are linear in the weights of the bumps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from physretarget.ocp.contact_model import friction_force, normal_force
from physretarget.ocp.settings import ContactModel, RootHeightSettings

Array = NDArray[np.float64]

BLOCK = 4096
"""Frames that CasADi sees at once."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is known of a clip before its root is raised. T frames, P contact points.

    force, moment: (T, 3) required at the root, N and N m about the root.
    arm: (T, 3) centre of mass minus root, m.
    contact: (T, P, 3) contact points minus root, world axes, m; ``height`` (T, P) above the
    floor, m; ``velocity`` (T, P, 3) m/s.
    active: (T, P) which points are meant to touch; ``standing`` (T,) 1 where the clip stands,
    fading to 0 towards take-off and landing, 0 in flight.
    clearance: (T,) height of the lowest point of the whole body above the floor, m.
    mass kg, weight N, size m (the character's height), friction μ.
    pose_offset, pose_spread: (T,) mean vertical error of the features and its standard
    deviation, m, or None where the mapper knows none; ``features``: points that it speaks of.
    """

    force: Array
    moment: Array
    arm: Array
    contact: Array
    height: Array
    velocity: Array
    active: NDArray[np.bool_]
    standing: Array
    clearance: Array
    mass: float
    weight: float
    size: float
    friction: float
    pose_offset: Array | None = None
    pose_spread: Array | None = None
    features: int = 1

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.force.shape[0])

    @property
    def flight(self) -> NDArray[np.bool_]:
        """(T,) frames in which no point is meant to touch."""
        touching: NDArray[np.bool_] = np.any(self.active, axis=1)
        return ~touching

    def between(self, first: int, last: int) -> Scene:
        """Frames first to last - 1."""
        some = slice(first, last)
        offset, spread = self.pose_offset, self.pose_spread
        return replace(
            self, force=self.force[some], moment=self.moment[some], arm=self.arm[some],
            contact=self.contact[some], height=self.height[some], velocity=self.velocity[some],
            active=self.active[some], standing=self.standing[some],
            clearance=self.clearance[some], pose_offset=None if offset is None else offset[some],
            pose_spread=None if spread is None else spread[some],
        )  # fmt: skip


class OverFrames:
    """A CasADi function of one frame (s, p, f0), over all frames, some of them at a time.

    CasADi keeps an index beside every number: all frames at once would take several times the
    memory of the clip.
    """

    def __init__(self, function: Any) -> None:
        self.function = function
        self._mapped: dict[int, Any] = {}

    def __call__(self, motion: Array, parameters: Array, f0: float) -> list[Array]:
        """Outputs (rows, T * columns) for s (3, T) and p (P, T); f0 is shared."""
        frames = motion.shape[1]
        shapes = [self.function.size_out(i) for i in range(self.function.n_out())]
        found = [np.empty((rows, frames * columns)) for rows, columns in shapes]
        for start in range(0, frames, BLOCK):
            stop = min(start + BLOCK, frames)
            part = self._over(stop - start)(motion[:, start:stop], parameters[:, start:stop], f0)
            outputs = part if isinstance(part, tuple) else (part,)
            for whole, output, (_, columns) in zip(found, outputs, shapes, strict=True):
                whole[:, start * columns : stop * columns] = output.full()
        return found

    def _over(self, frames: int) -> Any:
        if frames not in self._mapped:
            name = f"{self.function.name()}_{frames}"
            self._mapped[frames] = self.function.map(name, "serial", frames, [2], [])
        return self._mapped[frames]


@dataclass(frozen=True)
class Problem:
    """Residuals r (T, R) and contact wrenches as functions of s = (Δz, Δż, Δz̈) (T, 3)."""

    residuals: OverFrames
    values: OverFrames
    wrench: OverFrames
    parameters: Array
    model: ContactModel
    rows: int

    def evaluate(self, motion: tuple[Array, ...], f0: float) -> tuple[Array, Array]:
        """Residuals (T, R) and their derivatives by Δz, Δż, Δz̈ (T, R, 3)."""
        r, jacobian = self.residuals(np.stack(motion), self.parameters, f0)
        slopes = jacobian.reshape(self.rows, self.parameters.shape[1], 3)
        return r.T, np.ascontiguousarray(slopes.transpose(1, 0, 2))

    def value(self, motion: tuple[Array, ...], f0: float) -> Array:
        """Residuals (R, T) alone."""
        return self.values(np.stack(motion), self.parameters, f0)[0]

    def contact_wrench(self, motion: tuple[Array, ...]) -> tuple[Array, Array]:
        """Force (T, 3) and moment about the root (T, 3) of the contact model."""
        (both,) = self.wrench(np.stack(motion), self.parameters, self.model.residual)
        return both.T[:, :3], both.T[:, 3:]


def build(scene: Scene, settings: RootHeightSettings) -> Problem:
    """Set the problem up for one clip."""
    points = scene.height.shape[1]
    model = settings.contact_model(scene.weight, scene.size, points, scene.friction)
    known, layout = _known(scene, settings)
    s = ca.SX.sym("s", 3)
    p = ca.SX.sym("p", known.shape[0])
    f0 = ca.SX.sym("f0")
    part = {name: p[rows] for name, rows in layout.items()}
    force, moment = _contact(s, part, points, model, f0)
    r = _residuals(s, part, force, moment, scene, settings)
    frame = ca.Function("frame", [s, p, f0], [r, ca.jacobian(r, s)])
    value = ca.Function("value", [s, p, f0], [r])
    wrench = ca.Function("wrench", [s, p, f0], [ca.vertcat(force, moment)])
    return Problem(
        OverFrames(frame),
        OverFrames(value),
        OverFrames(wrench),
        known,
        model,
        int(r.shape[0]),
    )


def _known(scene: Scene, settings: RootHeightSettings) -> tuple[Array, dict[str, slice]]:
    """Per-frame parameters (p, T) and which rows hold what."""
    frames = scene.frames
    pose = np.zeros((frames, 2))  # mean error, 1 / spread
    if scene.pose_offset is not None and scene.pose_spread is not None:
        pose[:, 0] = scene.pose_offset
        pose[:, 1] = 1.0 / np.maximum(scene.pose_spread, settings.pose_floor * scene.size)
    blocks = {
        "force": scene.force,
        "moment": scene.moment,
        "arm": scene.arm,
        "contact": scene.contact.reshape(frames, -1),
        "height": scene.height,
        "velocity": scene.velocity.reshape(frames, -1),
        "flight": scene.flight[:, None].astype(np.float64),
        "pose": pose,
        "standing": np.stack([scene.standing, _rest(scene, settings)], axis=1),
        "lowest": lowest_displacement(scene, settings)[:, None],
    }
    layout, start = {}, 0
    for name, block in blocks.items():
        layout[name] = slice(start, start + block.shape[1])
        start += block.shape[1]
    return np.concatenate(list(blocks.values()), axis=1).T.copy(), layout


def _rest(scene: Scene, settings: RootHeightSettings) -> Array:
    """(T,) how deep the contact model sinks under one body weight on the active points, m."""
    points = np.maximum(scene.active.sum(axis=1), 1)
    depth: Array = settings.sink * scene.size * scene.active.shape[1] / points
    return depth


def lowest_displacement(scene: Scene, settings: RootHeightSettings) -> Array:
    """(T,) the most that the root may be lowered before some part of the body sinks too deep, m.

    Parts that the clip has below the floor already may sink by a little more, so that what
    stands on the contact model has room.
    """
    deep = settings.floor * scene.size
    lowest: Array = -np.maximum(scene.clearance + deep, 0.1 * deep)
    return lowest


def _contact(
    s: Any, part: dict[str, Any], points: int, model: ContactModel, f0: Any
) -> tuple[Any, Any]:
    """Force and moment about the root of all contact points, the root raised by s."""
    force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
    for i in range(points):
        velocity = part["velocity"][3 * i : 3 * i + 3]
        normal = normal_force(part["height"][i] + s[0], velocity[2] + s[1], model, f0)
        push = ca.vertcat(friction_force(velocity[:2], normal, model), normal)
        force += push
        moment += ca.cross(part["contact"][3 * i : 3 * i + 3], push)
    return force, moment


def _residuals(
    s: Any,
    part: dict[str, Any],
    force: Any,
    moment: Any,
    scene: Scene,
    settings: RootHeightSettings,
) -> Any:
    """All rows of r; the cost is ½|r|² over all frames (Yamane 2010 eqs. (11), (12), (15))."""
    unit_force = scene.weight if settings.dimensionless else 1.0
    unit_moment = scene.weight * scene.size if settings.dimensionless else 1.0
    inertia = ca.vertcat(0, 0, scene.mass * s[2])
    required = part["force"] + inertia
    required_moment = part["moment"] + ca.cross(part["arm"], inertia)
    gap, gap_moment = (required - force) / unit_force, (required_moment - moment) / unit_moment
    rows = [settings.vertical * gap[2]]
    if settings.horizontal > 0:
        rows += [settings.horizontal * gap[0], settings.horizontal * gap[1]]
    if settings.moment > 0:
        rows += [settings.moment * gap_moment[i] for i in range(3)]
    if settings.flight > 0:
        rows.append(settings.flight * part["flight"] * required[2] / unit_force)
    if settings.displacement > 0:
        rows.append(settings.displacement * s[0] / scene.size)
    if settings.hold > 0:
        rows.append(settings.hold * part["standing"][0] * (s[0] + part["standing"][1]) / scene.size)
    if settings.roughness > 0:
        rows.append(settings.roughness * s[2] / (scene.weight / scene.mass))
    if settings.pose > 0 and scene.pose_spread is not None:
        # each of the features has the same spread: their squares add up to one square
        weight = (settings.pose * scene.features) ** 0.5
        rows.append(weight * (s[0] + part["pose"][0]) * part["pose"][1])
    if np.isfinite(settings.limit):
        beyond = ca.fabs(s[0]) / scene.size - 0.93 * settings.limit
        rows.append(3000.0 * ca.fmax(beyond, 0.0))
    if np.isfinite(settings.floor):
        rows.append(3000.0 * ca.fmax(part["lowest"][0] - s[0], 0.0) / scene.size)
    return ca.vertcat(*rows)
