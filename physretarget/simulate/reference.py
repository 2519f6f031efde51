"""The clip as a reference: poses, speeds and torques at the knots, and what an error costs there.

Errors live in the tangent space of the reference pose, e = (q ⊖ q_ref, v - v_ref). Their cost is
the Gauss-Newton form of squared marker errors, ½ eᵀ Q e with Q from the points' Jacobians at the
reference pose: exactly quadratic, so that no kinematics is needed while planning.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from physretarget.clip import Clip
from physretarget.errors import InputError
from physretarget.kinematics import continuous
from physretarget.mjcf import derivatives, lowpass
from physretarget.simulate.body import Body
from physretarget.simulate.settings import SimulationSettings

__all__ = ["Reference", "build_reference"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_PRICE_EVERY = 0.02  # s between poses at which the points' Jacobians are taken
_LEAST_DURATION = 0.02  # s


@dataclass(frozen=True, eq=False)
class Reference:
    """What is to be played.

    Attributes:
        body: who plays it.
        settings: how.
        qpos: (K+1, nq), qvel: (K+1, nv), torque: (K+1, nu) at the knots.
        speed_doubt: (nv,) by how much the speed at the first frame may be another: its change
            over the clip's first frame.
        lift: m by which the clip was raised out of the floor.
        touching: geoms that come near the floor at some time of the clip.
    """

    body: Body
    settings: SimulationSettings
    qpos: Array
    qvel: Array
    torque: Array
    speed_doubt: Array
    lift: float
    touching: Ints
    _prices: dict[int, Array] = field(default_factory=dict)

    @property
    def knots(self) -> int:
        """Number of intervals between knots."""
        return len(self.qpos) - 1

    def price(self, knot: int) -> Array:
        """Q (nv, nv): cost of errors of the pose at this knot, ½ eᵀ Q e."""
        every = max(1, round(_PRICE_EVERY / self.settings.knot))
        at = min(every * round(knot / every), self.knots)
        if at not in self._prices:
            for old in [k for k in self._prices if abs(k - at) * self.settings.knot > 2.0]:
                del self._prices[old]
            self._prices[at] = _price(self, at)
        return self._prices[at]

    def com_jacobian(self, knot: int) -> Array:
        """(3, nv) of the centre of mass in the reference pose."""
        data = self._posed(knot)
        jacobian = np.empty((3, self.body.model.nv))
        mujoco.mj_jacSubtreeCom(self.body.model, data, jacobian, self.body.character.root_body)
        return jacobian

    def _posed(self, knot: int) -> mujoco.MjData:
        model = self.body.model
        data = mujoco.MjData(model)
        data.qpos[:] = self.qpos[knot]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        return data


def build_reference(clip: Clip, body: Body, settings: SimulationSettings) -> Reference:
    """Bring a clip to the knots, out of the floor, and find the torques it seems to need.

    Raises:
        InputError: the clip is too short to be played.
    """
    character = body.character
    if clip.duration < _LEAST_DURATION:
        raise InputError(
            f"lasts {clip.duration:.3g} s: at least {_LEAST_DURATION:g} s are needed to simulate.",
            path=clip.path,
        )
    knots = int(clip.duration / settings.knot + 1e-6)
    time = np.asarray(settings.knot * np.arange(knots + 1), np.float64)
    qpos = _interpolated(body, clip, time)
    near = _near_model(body, settings.touch * character.height)
    depth, touching = _floor_contact(near, body, qpos)
    lift = float(np.median(depth))
    lift = lift if lift > settings.lift else 0.0
    qpos[:, character.root_qpos + 2] += lift
    qvel, qacc = _rates(body, settings, qpos, time)
    torque = _torques(near, body, settings, qpos, qvel, qacc, time)
    # MuJoCo moves the pose by the speed after a step: that of half a step before the pose's time.
    qvel -= 0.5 * settings.timestep * qacc
    doubt = _speed_doubt(body, clip)
    return Reference(body, settings, qpos, qvel, torque, doubt, lift, touching)


def _speed_doubt(body: Body, clip: Clip) -> Array:
    """(nv,) change of the speed between the first two intervals of a clip, 0 where it has one."""
    model = body.model
    speeds = np.zeros((2, model.nv))
    if clip.frames < 3:
        return np.zeros(model.nv)
    for row, (one, two) in zip(speeds, ((0, 1), (1, 2)), strict=True):
        step = float(clip.time[two] - clip.time[one])
        mujoco.mj_differentiatePos(model, row, step, clip.qpos[one], clip.qpos[two])
    return np.asarray(np.abs(speeds[1] - speeds[0]))


def _interpolated(body: Body, clip: Clip, time: Array) -> Array:
    """Natural cubic splines through the clip's poses; of quaternions by component, renormalised."""
    address = body.character.tree.quats[0]
    given = clip.qpos.copy()
    given[:, address] = continuous(given[:, address])
    if len(given) < 3:
        at = (clip.time - clip.time[0]) / clip.duration
        qpos = np.array([np.interp(time / clip.duration, at, column) for column in given.T]).T
    else:
        qpos = CubicSpline(clip.time - clip.time[0], given, bc_type="natural")(time)
    quats = qpos[:, address]
    qpos[:, address] = quats / np.linalg.norm(quats, axis=-1, keepdims=True)
    return np.ascontiguousarray(qpos)


def _near_model(body: Body, margin: float) -> mujoco.MjModel:
    """A copy in which geoms within `margin` (m) of each other count as touching."""
    model = copy.copy(body.model)
    model.geom_margin[:] = margin
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return model


def _floor_contacts(model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[int, int]]:
    """Contacts of moving geoms with the still world: (contact, moving geom)."""
    still = model.body_weldid[model.geom_bodyid] == 0
    found = []
    for index, (one, two) in enumerate(data.contact.geom[: data.ncon]):
        if still[one] != still[two]:
            found.append((index, int(two if still[one] else one)))
    return found


def _floor_contact(model: mujoco.MjModel, body: Body, qpos: Array) -> tuple[Array, Ints]:
    """Depth of the deepest point (m, at frames 20 ms apart) and the geoms that come near."""
    data, depth = mujoco.MjData(model), []
    touching: set[int] = set()
    for pose in qpos[::5]:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        contacts = _floor_contacts(model, data)
        touching.update(geom for _, geom in contacts)
        depth.append(max((-float(data.contact.dist[c]) for c, _ in contacts), default=0.0))
    return np.array(depth), np.array(sorted(touching), dtype=np.int64)


def _rates(
    body: Body, settings: SimulationSettings, qpos: Array, time: Array
) -> tuple[Array, Array]:
    """Speeds (K+1, nv), and accelerations of the smoothed poses."""
    character = body.character
    qvel, _ = derivatives(character, qpos, time)
    if len(qpos) > 3:
        qpos = lowpass(character, qpos, 1.0 / settings.knot, settings.smooth_hz)
    return qvel, derivatives(character, qpos, time)[1]


def _torques(
    near: mujoco.MjModel,
    body: Body,
    settings: SimulationSettings,
    qpos: Array,
    qvel: Array,
    qacc: Array,
    time: Array,
) -> Array:
    """Inverse dynamics without contacts, minus the floor's forces inside their cones (K+1, nu)."""
    model = copy.copy(body.model)
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONSTRAINT | off.mjDSBL_CONTACT
    data, floor = mujoco.MjData(model), mujoco.MjData(near)
    every = max(1, round(_PRICE_EVERY / settings.knot))
    forces = np.zeros((len(qpos), model.nv))
    knots = np.unique(np.append(np.arange(0, len(qpos), every), len(qpos) - 1))
    needed = np.empty((len(qpos), model.nv))
    for knot in range(len(qpos)):
        data.qpos[:], data.qvel[:], data.qacc[:] = qpos[knot], qvel[knot], qacc[knot]
        mujoco.mj_inverse(model, data)
        needed[knot] = data.qfrc_inverse
    for knot in knots:
        floor.qpos[:] = qpos[knot]
        forces[knot] = _floor_force(near, floor, body, needed[knot])
    columns = [np.interp(time, time[knots], forces[knots, dof]) for dof in body.controls]
    torque = needed[:, body.controls] - np.stack(columns, axis=1)
    free = ~np.isfinite(body.high)
    torque[:, free] = 0.0
    return np.asarray(np.clip(torque, body.low, body.high))


def _floor_force(model: mujoco.MjModel, data: mujoco.MjData, body: Body, needed: Array) -> Array:
    """Generalised force (nv,) of the floor that comes nearest to the root's `needed` wrench."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    contacts = _floor_contacts(model, data)
    if not contacts:
        return np.zeros(model.nv)
    character = body.character
    root = slice(character.root_dof, character.root_dof + 6)
    edges, jacobian = [], np.empty((3, model.nv))
    for index, geom in contacts:
        contact = data.contact[index]
        frame = contact.frame.reshape(3, 3)
        upward = frame[0] if frame[0, 2] > 0 else -frame[0]
        owner = int(model.geom_bodyid[geom])
        mujoco.mj_jac(model, data, jacobian, None, contact.pos, owner)
        rough = min(float(contact.friction[0]), 2.0)
        for side in (frame[1], -frame[1], frame[2], -frame[2]):
            edges.append(jacobian.T @ (upward + rough * side))
    rays = np.array(edges).T
    # Moments count by the height of the centre of mass; a little of everything picks one answer.
    scale = np.repeat([1.0 / character.weight, 1.0], [3, 3])
    scale[3:] /= character.weight * character.com_height
    keep = 1e-3 / np.sqrt(rays.shape[1]) * np.eye(rays.shape[1])
    system = np.vstack([rays[root] * scale[:, None] * character.weight, keep])
    target = np.concatenate([needed[root] * scale, np.zeros(len(keep))])
    shares, _ = nnls(system, target, maxiter=50 * rays.shape[1])
    return np.asarray(rays @ shares) * character.weight


def _price(reference: Reference, knot: int) -> Array:
    body, settings = reference.body, reference.settings
    model, character = body.model, body.character
    data, nv, h = reference._posed(knot), body.model.nv, body.character.height
    jacobian, turn = np.empty((3, nv)), np.empty((3, nv))
    price = np.zeros((nv, nv))

    def add(points: list[tuple[Array, int]], weight: float) -> None:
        stack = np.empty((len(points), 3, nv))
        for row, (place, owner) in zip(stack, points, strict=True):
            mujoco.mj_jac(model, data, row, None, place, owner)
        flat = stack.reshape(-1, nv)
        np.add(price, 2 * weight / (len(points) * h**2) * (flat.T @ flat), out=price)

    markers = character.markers
    place = data.xpos[markers.body] + np.einsum(
        "kij,kj->ki", data.xmat[markers.body].reshape(-1, 3, 3), markers.local
    )
    add([(p, int(b)) for p, b in zip(place, markers.body, strict=True)], settings.marker)
    feet = [(data.geom_xpos[g], int(model.geom_bodyid[g])) for g in reference.touching]
    if feet:
        add(feet, settings.feet)
    mujoco.mj_jacSubtreeCom(model, data, jacobian, character.root_body)
    price += 2 * settings.com / h**2 * (jacobian.T @ jacobian)
    mujoco.mj_jacBody(model, data, None, turn, character.root_body)
    price += 2 * settings.tilt * (turn[:2].T @ turn[:2])
    price[np.diag_indices(nv)] += 2 * settings.posture
    return price
