"""What an error of the state and a torque off the reference cost at one knot, with derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.simulate.reference import Reference

__all__ = ["Cost", "KnotCost"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class KnotCost:
    """Value, gradient and Hessian by the state's error (2 nv) at one knot."""

    value: float
    gradient: Array
    hessian: Array


class Cost:
    """½ eᵀ Q e + ½ s² ėᵀ Q ė + limits + ½ (u - u_ref)ᵀ R (u - u_ref), s = 1 / (2π speed_hz).

    R_j = Q_jj / ((2π torque_hz)⁴ I_j²): a torque costs what the error would that it makes.
    """

    def __init__(self, reference: Reference) -> None:
        body, settings = reference.body, reference.settings
        model = body.model
        self.reference = reference
        self._slow = (2 * np.pi * settings.speed_hz) ** -2
        limited = np.flatnonzero(
            (model.jnt_limited != 0) & (model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE))
        )
        self._limited_q, self._limited_v = model.jnt_qposadr[limited], model.jnt_dofadr[limited]
        low, high = model.jnt_range[limited].T
        margin = np.minimum(settings.limit_margin, 0.25 * (high - low))
        self._low, self._high = low + margin, high - margin
        self._limit = 2 * settings.limit
        self._stiff = (2 * np.pi * settings.torque_hz) ** -4 / body.inertia**2
        self._assist = ~np.isfinite(body.high)
        self._assist_price = _assist_price(reference)
        self._omega = np.sqrt(9.81 / max(body.character.com_height, 1e-3))

    def error(self, knot: int, qpos: Array, qvel: Array) -> Array:
        """(2 nv) the state less the reference, in the reference pose's tangent space."""
        model, nv = self.reference.body.model, self.reference.body.model.nv
        error = np.empty(2 * nv)
        mujoco.mj_differentiatePos(model, error[:nv], 1.0, self.reference.qpos[knot], qpos)
        np.subtract(qvel, self.reference.qvel[knot], out=error[nv:])
        return error

    def torque_price(self, knot: int) -> Array:
        """Diagonal (nu,) of R."""
        diagonal = np.diagonal(self.reference.price(knot))[self.reference.body.controls]
        price = diagonal * self._stiff
        price[self._assist] = self._assist_price
        return price

    def value(self, knot: int, error: Array, qpos: Array) -> float:
        """Cost of the state alone."""
        nv, price = len(error) // 2, self.reference.price(knot)
        e, ė = error[:nv], error[nv:]
        excess = self._excess(qpos)
        bend = self._limit * float(excess @ excess)
        return 0.5 * (float(e @ price @ e) + self._slow * float(ė @ price @ ė) + bend)

    def expand(self, knot: int, error: Array, qpos: Array) -> KnotCost:
        """The same with gradient and Hessian."""
        nv, price = len(error) // 2, self.reference.price(knot)
        gradient, hessian = np.empty(2 * nv), np.zeros((2 * nv, 2 * nv))
        gradient[:nv] = price @ error[:nv]
        gradient[nv:] = self._slow * (price @ error[nv:])
        hessian[:nv, :nv] = price
        hessian[nv:, nv:] = self._slow * price
        value = 0.5 * float(gradient @ error)
        excess = self._excess(qpos)
        if excess.any():
            value += 0.5 * self._limit * float(excess @ excess)
            gradient[self._limited_v] += self._limit * excess
            past = self._limited_v[excess != 0]
            hessian[past, past] += self._limit
        return KnotCost(value, gradient, hessian)

    def expand_last(self, knot: int, error: Array, qpos: Array) -> KnotCost:
        """Cost of a window's last knot: the state's, many times, and the capture point's."""
        settings = self.reference.settings
        now = self.expand(knot, error, qpos)
        jacobian = self.reference.com_jacobian(knot) / self.reference.body.character.height
        capture = np.concatenate([jacobian, jacobian / self._omega], axis=1)
        off = capture @ error
        weight = 2 * settings.capture
        return KnotCost(
            settings.terminal * now.value + 0.5 * weight * float(off @ off),
            settings.terminal * now.gradient + weight * (capture.T @ off),
            settings.terminal * now.hessian + weight * (capture.T @ capture),
        )

    def _excess(self, qpos: Array) -> Array:
        q = qpos[self._limited_q]
        return np.asarray(np.maximum(q - self._high, 0.0) + np.minimum(q - self._low, 0.0))


def _assist_price(reference: Reference) -> Array:
    character = reference.body.character
    unit = np.repeat([character.weight, character.weight * character.com_height], 3)
    number = int((~np.isfinite(reference.body.high)).sum())
    return (2 * reference.settings.assist_weight / unit**2)[:number]
