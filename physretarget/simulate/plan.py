"""A window of motion under feedback, its derivatives, and the Newton step that betters it (iLQR).

Notation after Tassa, Erez and Todorov (2012): the state is x = (q, v), its change δx lives in the
tangent space; V is the cost to go, u ← u + α k + K δx the new torque. As the cost's Hessians are
positive semidefinite and every torque has its price, Q_uu needs no regularisation.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dgemm
from scipy.linalg.lapack import dposv

from physretarget.simulate.cost import Cost, KnotCost
from physretarget.simulate.reference import Reference

__all__ = ["Plan", "Planner"]

Array = NDArray[np.float64]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_SEARCH = (
    (0.0, (1.0, 0.5, 0.25, 0.1, 0.03)),
    (30.0, (1.0, 0.1)),
    (1000.0, (1.0,)),
)
"""Damping, in prices of the state, and the step lengths tried with it, until one is better."""
_DIFFERENCE = 1e-6  # step of the finite differences; MuJoCo's own default


@dataclass(eq=False)
class Plan:
    """A rollout from knot `first`: poses (H+1, nq), speeds (H+1, nv), torques (H, nu), its cost.

    ``gain`` (H, nu, 2 nv) is the feedback it was made with, or None.
    """

    first: int
    qpos: Array
    qvel: Array
    warm: Array
    torque: Array
    cost: float
    gain: Array | None = None


class Planner:
    """Plans windows of one reference; owns the scratch memory that this takes."""

    def __init__(self, reference: Reference) -> None:
        body = reference.body
        self.reference, self.body, self.cost = reference, body, Cost(reference)
        self.settings = reference.settings
        self.data = mujoco.MjData(body.model)
        self._coarse = mujoco.MjData(body.coarse)
        self._smoother = False
        self._tail = self._servo()
        self.derivatives = 0

    @property
    def _model(self) -> mujoco.MjModel:
        return self.body.smoother if self._smoother else self.body.model

    @contextmanager
    def on_a_smoother_floor(self) -> Iterator[None]:
        """Plan meanwhile with less friction than there is."""
        self._smoother = True
        try:
            yield
        finally:
            self._smoother = False

    def shifted(self, start: Array, distance: float) -> Array:
        """An integration state with the root moved by a distance (m) along x and y each."""
        model, data, root = self.body.model, self.data, self.body.character.root_qpos
        mujoco.mj_setState(model, data, start, _STATE)
        data.qpos[root : root + 2] += distance
        moved = np.empty_like(start)
        mujoco.mj_getState(model, data, moved, _STATE)
        return moved

    # -- rolling out ------------------------------------------------------------------------

    def follow(
        self,
        start: Array,
        first: int,
        last: int,
        plan: Plan | None,
        *,
        step: float = 0.0,
        push: Array | None = None,
        gain: Array | None = None,
        bound: float = np.inf,
    ) -> Plan | None:
        """Simulate from `start` (an integration state) at knot `first` to knot `last`.

        While `plan` lasts, its torques are played, changed by ``step * push`` and by `gain` times
        the departure from it; beyond, the reference's torques and a servo. None once the cost
        exceeds `bound` or the body has come apart.
        """
        body, model, data, cost = self.body, self._model, self.data, self.cost
        nv, horizon = model.nv, last - first
        mujoco.mj_setState(model, data, start, _STATE)
        qpos, qvel = np.empty((horizon + 1, model.nq)), np.empty((horizon + 1, nv))
        warm, torque = np.empty((horizon + 1, nv)), np.empty((horizon, len(body.controls)))
        total, change, reference = 0.0, np.empty(2 * nv), self.reference
        for k in range(horizon + 1):
            knot = first + k
            qpos[k], qvel[k], warm[k] = data.qpos, data.qvel, data.qacc_warmstart
            error = cost.error(knot, qpos[k], qvel[k])
            if k == horizon:
                total += cost.expand_last(knot, error, qpos[k]).value
                break
            if k:
                total += cost.value(knot, error, qpos[k])
            at = knot - plan.first if plan else 0
            if plan is not None and at < len(plan.torque):
                u = plan.torque[at]
                if gain is not None:
                    mujoco.mj_differentiatePos(model, change[:nv], 1.0, plan.qpos[at], qpos[k])
                    np.subtract(qvel[k], plan.qvel[at], out=change[nv:])
                    u = u + gain[k] @ change
                if push is not None:
                    u = u + step * push[k]
            else:
                u = reference.torque[knot] - self._tail[0] * error[body.controls]
                u -= self._tail[1] * error[nv + body.controls]
            torque[k] = u = np.minimum(np.maximum(u, body.low), body.high)
            off = u - reference.torque[knot]
            total += 0.5 * float((off * off) @ self._torque_price(knot))
            data.qfrc_applied[body.controls] = u
            mujoco.mj_step(model, data, self.settings.steps_per_knot)
            if not total < bound or not abs(data.qvel).max() < self.settings.speed_most:
                return None
        return Plan(first, qpos, qvel, warm, torque, total) if total < bound else None

    def _torque_price(self, knot: int) -> Array:
        return self.cost.torque_price(knot)

    def _servo(self) -> tuple[Array, Array]:
        """Stiffness and damping (nu,) of the servo beyond a plan's end, critically damped."""
        omega = 2 * np.pi * self.settings.tail_hz
        inertia = np.where(np.isfinite(self.body.high), self.body.inertia, 0.0)
        return omega**2 * inertia, 2 * omega * inertia

    # -- improving --------------------------------------------------------------------------

    def improve(self, start: Array, plan: Plan, iterations: int, hard: int = 0) -> Plan:
        """Newton steps until the window is settled; the plan with the gains of its last step.

        Beyond `iterations` there are up to `hard` in all while the plan is not good.
        """
        last = plan.first + len(plan.torque)
        for iteration in range(max(iterations, hard)):
            if iteration >= iterations and plan.cost < self.settings.good:
                break
            slopes = [self.linearise(plan, k) for k in range(len(plan.torque))]
            better = None
            for damping, steps in _SEARCH:
                push, gain, _ = self.backward(plan, slopes, damping)
                plan.gain = gain if damping == 0 else plan.gain
                for step in steps:
                    better = better or self.follow(
                        start, plan.first, last, plan,
                        step=step, push=push, gain=gain, bound=plan.cost,
                    )  # fmt: skip
            if better is None:
                break
            settled = plan.cost - better.cost < self.settings.gain * plan.cost
            better.gain = plan.gain
            plan = better
            if settled:
                break
        return plan

    def quicken(self, start: Array, plan: Plan, iterations: int) -> tuple[Array, Plan]:
        """Choose the speed that a window begins with as well, within what the clip leaves open.

        Returns the new start and a plan from it. A clip gives poses: at its first frame the speed
        is known no better than it changes over a frame.
        """
        model, data, nv = self._model, self.data, self.body.model.nv
        last, doubt = plan.first + len(plan.torque), self.reference.speed_doubt
        for _ in range(iterations):
            slopes = [self.linearise(plan, k) for k in range(len(plan.torque))]
            push, gain, ahead = self.backward(plan, slopes, 0.0)
            change = -dposv(ahead.hessian[nv:, nv:], ahead.gradient[nv:])[1].reshape(nv)
            known, worth = self.reference.qvel[plan.first], self._with_start(plan)
            for step in _SEARCH[0][1]:
                mujoco.mj_setState(model, data, start, _STATE)
                speed = np.clip(plan.qvel[0] + step * change, known - doubt, known + doubt)
                data.qvel[:] = speed
                begin = np.empty_like(start)
                mujoco.mj_getState(model, data, begin, _STATE)
                found = self.follow(
                    begin, plan.first, last, plan, step=step, push=push, gain=gain, bound=worth
                )
                if found is not None and self._with_start(found) < worth:
                    start, plan = begin, found
                    break
            else:
                break
        return start, plan

    def _with_start(self, plan: Plan) -> float:
        """A plan's cost and that of the state it begins with."""
        error = self.cost.error(plan.first, *plan_state(plan, 0))
        return plan.cost + self.cost.value(plan.first, error, plan.qpos[0])

    def backward(
        self, plan: Plan, slopes: list[Array], damping: float
    ) -> tuple[Array, Array, KnotCost]:
        """Open-loop change k (H, nu), feedback K (H, nu, 2 nv), and the cost to go at the start.

        `damping` adds so many times the state's price to every change of the states: a step
        stays where the `slopes` hold.
        """
        body, cost, nv = self.body, self.cost, self.body.model.nv
        horizon, nu = plan.torque.shape
        last = plan.first + horizon
        end = cost.expand_last(last, cost.error(last, *plan_state(plan, horizon)), plan.qpos[-1])
        push, gain = np.zeros((horizon, nu)), np.zeros((horizon, nu, 2 * nv))
        slope, bend = end.gradient, end.hessian
        for k in range(horizon - 1, -1, -1):
            knot = plan.first + k
            both = slopes[k]
            hessian = dgemm(1.0, both, dgemm(1.0, bend, both), trans_a=True)
            gradient = both.T @ slope
            now = cost.expand(knot, cost.error(knot, *plan_state(plan, k)), plan.qpos[k])
            price = cost.torque_price(knot)
            gradient[: 2 * nv] += now.gradient
            gradient[2 * nv :] += price * (plan.torque[k] - self.reference.torque[knot])
            hessian[: 2 * nv, : 2 * nv] += now.hessian
            hessian[np.arange(2 * nv, 2 * nv + nu), np.arange(2 * nv, 2 * nv + nu)] += price
            outer = hessian[2 * nv :].copy()
            if damping:
                change = dgemm(1.0, damping * now.hessian, both)
                outer += dgemm(1.0, both[:, 2 * nv :], change, trans_a=True)
            inner = outer[:, 2 * nv :]
            # A torque at its bound that wants further stays there and gives no feedback.
            u, g = plan.torque[k], gradient[2 * nv :]
            free = ~((u <= body.low) & (g > 0) | (u >= body.high) & (g < 0))
            side = np.column_stack([g, outer[:, : 2 * nv]])
            if free.all():
                solved = -dposv(inner, side)[1]
            else:
                solved = np.zeros_like(side)
                if free.any():
                    solved[free] = -dposv(inner[np.ix_(free, free)], side[free])[1]
            push[k], gain[k] = solved[:, 0], solved[:, 1:]
            cross, own, k_, K = (
                hessian[2 * nv :, : 2 * nv],
                hessian[2 * nv :, 2 * nv :],
                push[k],
                gain[k],
            )
            slope = gradient[: 2 * nv] + cross.T @ k_ + K.T @ (own @ k_ + g)
            mixed = K.T @ cross
            bend = hessian[: 2 * nv, : 2 * nv] + mixed + mixed.T + K.T @ own @ K
            bend = 0.5 * (bend + bend.T)
        return push, gain, KnotCost(plan.cost, slope, bend)

    def linearise(self, plan: Plan, k: int) -> Array:
        """(2 nv, 2 nv + nu) derivative of the next state by state and torque, over one knot."""
        model, data, nv = self.body.coarse, self._coarse, self.body.coarse.nv
        share = self.settings.friction_share if self._smoother else 1.0
        model.geom_friction[:, 0] = share * self.body.model.geom_friction[:, 0]
        model.pair_friction[:, :2] = share * self.body.model.pair_friction[:, :2]
        data.qpos[:], data.qvel[:] = plan.qpos[k], plan.qvel[k]
        data.qacc_warmstart[:] = plan.warm[k]
        data.ctrl[:] = plan.torque[k]
        a, b = np.empty((2 * nv, 2 * nv)), np.empty((2 * nv, model.nu))
        mujoco.mjd_transitionFD(model, data, _DIFFERENCE, False, a, b, None, None)
        self.derivatives += 1
        return np.asfortranarray(np.concatenate([a, b], axis=1))


def plan_state(plan: Plan, k: int) -> tuple[Array, Array]:
    """Pose and speed at a plan's k-th knot."""
    return plan.qpos[k], plan.qvel[k]
