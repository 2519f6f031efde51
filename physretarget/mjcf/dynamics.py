"""Derivatives, filtering, momentum and inverse dynamics of a clip, batched over its frames.

MuJoCo is called once per frame in a plain loop with preallocated arrays; every call has its
own ``MjData``, so that clips can be worked on in parallel threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from physretarget.errors import InputError, UsageError
from physretarget.kinematics import continuous, difference
from physretarget.mjcf.character import Character

__all__ = ["Momentum", "RootWrench", "derivatives", "lowpass", "momentum", "required_wrench"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Momentum:
    """Centroidal momentum of the root's tree, world axes.

    ``com`` (T, 3) m, ``linear`` (T, 3) kg m/s, ``angular`` (T, 3) kg m²/s about the centre of
    mass, ``inertia`` (T, 3, 3) kg m² about the centre of mass (the body frozen in its pose).
    """

    com: Array
    linear: Array
    angular: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class RootWrench:
    """What the surroundings must supply so that the motion happens as it does.

    ``force`` (T, 3) N and ``moment`` (T, 3) N m about ``root`` in world axes: the rate of
    change of momentum minus gravity. ``root`` (T, 3) is the origin of the root body, ``com``
    (T, 3) the centre of mass (m). ``joint_torque`` (T, nv), N m or N, is what the joints must
    transmit in all; ``passive`` (T, nv) is the share that springs and dampers declared in the
    file would supply, so that motors need ``joint_torque - passive``. Gains of a controller
    hide there in some robot files: hence the two apart. The dofs of the free root repeat the
    wrench (moment in the root's axes).
    """

    force: Array
    moment: Array
    com: Array
    root: Array
    joint_torque: Array
    passive: Array


def derivatives(character: Character, qpos: Array, time: Array) -> tuple[Array, Array]:
    """Velocity and acceleration (T, nv) of a clip, both of second order in the time step.

    Central differences; at the ends the one-sided formulas over three and four frames.
    Conventions are MuJoCo's: rotations as rotation vectors in the frame of the body at that
    very instant, so that qpos, qvel and qacc belong to the same time. Fewer than four frames
    give what they can: a constant acceleration, a constant velocity, or none.

    Args:
        character: The character.
        qpos: (T, nq) poses.
        time: (T,) s.

    Returns:
        qvel and qacc, (T, nv) each.

    Raises:
        InputError: `time` is not uniform and increasing, or shapes disagree.
    """
    qpos = _checked(character, qpos)
    step = _step(time, len(qpos))
    tree, frames, nv = character.tree, len(qpos), character.model.nv
    qvel, qacc = np.zeros((frames, nv)), np.zeros((frames, nv))
    if frames == 1:
        return qvel, qacc
    if frames == 2:
        qvel[:1] = difference(tree, qpos[:1], qpos[1:]) / step
        qvel[1:] = -difference(tree, qpos[1:], qpos[:1]) / step
        return qvel, qacc
    middle = qpos[1:-1]
    ahead, behind = difference(tree, middle, qpos[2:]), difference(tree, middle, qpos[:-2])
    qvel[1:-1] = (ahead - behind) / (2 * step)
    qacc[1:-1] = (ahead + behind) / step**2
    # Rotation vectors from one frame have that body's angular velocity and acceleration as
    # their first and second derivative, so the formulas for vectors hold unchanged.
    for end, inward in ((0, 1), (frames - 1, -1)):
        away = [
            difference(tree, qpos[end : end + 1], qpos[k : k + 1])[0]
            for k in range(end + inward, end + inward * min(frames, 4), inward)
        ]
        qvel[end] = inward * (4 * away[0] - away[1]) / (2 * step)
        if len(away) == 3:
            qacc[end] = (-5 * away[0] + 4 * away[1] - away[2]) / step**2
        else:
            qacc[end] = qacc[1]
    return qvel, qacc


def check_lowpass(fps: float, hz: float) -> None:
    """Raise UsageError where `hz` is not between 0 and half the frame rate.

    Args:
        fps: Frames per second.
        hz: Cut-off frequency.
    """
    nyquist = 0.5 * fps
    if not 0 < hz < nyquist:
        raise UsageError(
            f"a low-pass of {hz:g} Hz is not possible at {fps:g} frames per second: "
            f"it must lie between 0 and {nyquist:g} Hz"
        )


def lowpass(character: Character, qpos: Array, fps: float, hz: float) -> Array:
    """Filter a clip by a zero-lag 4th-order Butterworth low-pass; returns qpos (T, nq).

    A second-order filter with its cut-off at `hz` runs forward and backward, as ``filtfilt`` and
    most published figures have it: each pass takes 3 dB at `hz`, both together 6 dB, and 3 dB at
    0.802 `hz`. (Winter 2009, section 3.4.4.2, would raise the cut-off by 1/0.802.)
    Quaternions are made continuous, filtered by component and renormalised: exact for a
    rotation at rest, and to second order in the angle swept within the filter's window.

    Args:
        character: The character.
        qpos: (T, nq) poses.
        fps: Frames per second.
        hz: Frequency at which each of the two passes is at −3 dB.

    Returns:
        (T, nq) filtered poses.

    Raises:
        UsageError: `hz` is not between 0 and half the frame rate.
    """
    qpos = _checked(character, qpos)
    check_lowpass(fps, hz)
    if len(qpos) < 3:
        return qpos.copy()
    smooth = qpos.copy()
    address = character.tree.quats[0]
    smooth[:, address] = continuous(smooth[:, address])
    smooth = smoothed(smooth, fps, hz)
    quats = smooth[:, address]
    smooth[:, address] = quats / np.linalg.norm(quats, axis=-1, keepdims=True)
    return np.ascontiguousarray(smooth, dtype=np.float64)


_RINGS = 40
"""Frames after which the filter has forgotten its start, cutoffs near half the frame rate too."""


def smoothed(values: Array, fps: float, hz: float) -> Array:
    """The filter of :func:`lowpass` on numbers (T, n) or (T,), continued beyond their ends.

    The continuation is the mirror image through the end, bent by the acceleration that a parabola
    over the last period of `hz` has there: a clip that ends in free fall goes on falling, where the
    plain mirror image would stop its acceleration.

    Args:
        values: (T, n) or (T,).
        fps: Frames per second.
        hz: Cut-off frequency.

    Returns:
        Filtered values of the same shape.
    """
    frames = len(values)
    # It forgets within three periods of the cutoff.
    pad = min(frames - 1, max(int(np.ceil(3 * fps / hz)), _RINGS))
    window = min(frames, max(5, int(np.ceil(fps / hz)) + 1))
    whole = np.concatenate(
        [_mirrored(values, pad, window)[::-1], values, _mirrored(values[::-1], pad, window)]
    )
    smooth = sosfiltfilt(butter(2, 2 * hz / fps, output="sos"), whole, axis=0, padtype=None)
    return np.ascontiguousarray(smooth[pad : pad + frames])


def _mirrored(values: Array, pad: int, window: int) -> Array:
    """What lies before the first of `values`, the nearest first: (pad, n)."""
    away = np.arange(window) / window
    bend = np.polynomial.polynomial.polyfit(away, values[:window].reshape(window, -1), 2)[2]
    outward = np.arange(1, pad + 1) / window
    continued = 2 * values[:1] - values[1 : pad + 1]
    continued += 2 * (outward[:, None] ** 2 * bend).reshape(continued.shape)
    return np.asarray(continued)


def momentum(character: Character, qpos: Array, qvel: Array) -> Momentum:
    """Centroidal momentum and inertia of the root's tree, from MuJoCo's ``mj_subtreeVel``.

    Args:
        character: The character.
        qpos: (T, nq) poses.
        qvel: (T, nv) velocities.

    Returns:
        Linear kg m/s, angular kg m²/s, CoM m and inertia kg m², world axes.
    """
    qpos, qvel = _checked(character, qpos), _checked_dofs(character, qvel, qpos)
    model, root = character.model, character.root_body
    data = mujoco.MjData(model)
    bodies = slice(root, root + len(character.bodies))  # MuJoCo numbers trees depth first
    frames = len(qpos)
    com, linear, angular = (np.empty((frames, 3)) for _ in range(3))
    inertia = np.empty((frames, 10))
    com_now, velocity = data.subtree_com[root], data.subtree_linvel[root]
    spin, cinert = data.subtree_angmom[root], data.cinert[bodies]
    for t in range(frames):
        data.qpos = qpos[t]
        data.qvel = qvel[t]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_subtreeVel(model, data)
        com[t], linear[t], angular[t] = com_now, velocity, spin
        inertia[t] = cinert.sum(axis=0)
    linear *= character.mass
    # cinert holds xx yy zz xy xz yz about the tree's centre of mass, then offset and mass.
    full = inertia[:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(frames, 3, 3)
    return Momentum(com, linear, angular, full)


def required_wrench(character: Character, qpos: Array, qvel: Array, qacc: Array) -> RootWrench:
    """Inverse dynamics of every frame, contacts, limits and equalities left out.

    A fixed base is supported by the world: its wrench is what passes into the root body.

    Args:
        character: The character.
        qpos: (T, nq) poses.
        qvel: (T, nv) velocities.
        qacc: (T, nv) accelerations.

    Returns:
        Force (T, 3) N and moment (T, 3) N m at the root, and joint torques.
    """
    qpos = _checked(character, qpos)
    qvel, qacc = _checked_dofs(character, qvel, qpos), _checked_dofs(character, qacc, qpos)
    model, root = character.unconstrained, character.root_body
    data = mujoco.MjData(model)
    frames = len(qpos)
    torque, passive = np.empty((frames, model.nv)), np.empty((frames, model.nv))
    com, origin, turn = (np.empty((frames, n)) for n in (3, 3, 9))
    supported = np.zeros((frames, 6))
    total, springs = data.qfrc_inverse, data.qfrc_passive
    com_now, origin_now, turn_now = data.subtree_com[root], data.xpos[root], data.xmat[root]
    for t in range(frames):
        data.qpos = qpos[t]
        data.qvel = qvel[t]
        data.qacc = qacc[t]
        mujoco.mj_inverse(model, data)
        torque[t], passive[t] = total, springs
        com[t], origin[t], turn[t] = com_now, origin_now, turn_now
        if not character.has_root:
            mujoco.mj_rnePostConstraint(model, data)
            supported[t] = data.cfrc_int[root]
    torque += passive
    if character.has_root:
        dofs = slice(character.root_dof, character.root_dof + 6)
        # Armature on a free root (set by a default class) resists no real floor.
        torque[:, dofs] -= model.dof_armature[dofs] * qacc[:, dofs]
        force = torque[:, dofs][:, :3].copy()
        moment = np.einsum("tij,tj->ti", turn.reshape(-1, 3, 3), torque[:, dofs][:, 3:])
    else:
        force = supported[:, 3:]
        moment = supported[:, :3] + np.cross(com - origin, force)
    return RootWrench(force, moment, com, origin, torque, passive)


def _checked(character: Character, qpos: Array) -> Array:
    qpos = np.ascontiguousarray(qpos, dtype=np.float64)
    if qpos.ndim != 2 or qpos.shape[1] != character.model.nq or not len(qpos):
        raise InputError(
            f"qpos has shape {qpos.shape}, {character.name} needs (T, {character.model.nq})"
        )
    return qpos


def _checked_dofs(character: Character, values: Array, qpos: Array) -> Array:
    values = np.ascontiguousarray(values, dtype=np.float64)
    if values.shape != (len(qpos), character.model.nv):
        raise InputError(
            f"velocities or accelerations have shape {values.shape}, "
            f"({len(qpos)}, {character.model.nv}) is needed"
        )
    return values


def _step(time: Array, frames: int) -> float:
    time = np.asarray(time, dtype=np.float64)
    if time.shape != (frames,):
        raise InputError(f"time has shape {time.shape}, ({frames},) is needed")
    if frames == 1:
        return 1.0
    steps = np.diff(time)
    step = float(time[-1] - time[0]) / (frames - 1)
    if not step > 0:
        raise InputError("time does not increase")
    uneven = np.flatnonzero(np.abs(steps - step) > 1e-3 * step)
    if len(uneven):
        raise InputError("time is not uniform", frame=int(uneven[0]) + 1)
    return step
