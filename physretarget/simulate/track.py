"""Receding horizon: plan a window, play its beginning, plan again from where that led.

Where the body is lost, some of what was played is taken back and planned again, on a longer window
with more iterations; the attempt that came furthest is kept.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from physretarget.kinematics.pose import trajectories
from physretarget.simulate.plan import Plan, Planner
from physretarget.simulate.reference import Reference

__all__ = ["Ending", "Piece", "Track", "marker_errors", "track"]

Array = NDArray[np.float64]
Ending = Literal["end", "lost", "interrupted"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True, eq=False)
class Piece:
    """One stretch that was played, from knot `first`.

    ``before`` is the integration state it began with; ``qpos`` (n, nq) and ``qvel`` (n, nv) after
    each of its steps, ``torque`` (knots, nu) and ``gain`` (knots, nu, 2 nv);
    ``plan`` is what it came from and the next begins with, None once nothing can lead back here.
    """

    first: int
    before: Array
    qpos: Array
    qvel: Array
    torque: Array
    gain: NDArray[np.float32]
    plan: Plan | None

    @property
    def last(self) -> int:
        """The knot where it ends."""
        return self.first + len(self.torque)

    def until(self, knot: int) -> Piece:
        """Its beginning."""
        knots = knot - self.first
        steps = len(self.qpos) // len(self.torque)
        return replace(
            self,
            qpos=self.qpos[: knots * steps],
            qvel=self.qvel[: knots * steps],
            torque=self.torque[:knots],
            gain=self.gain[:knots],
        )


@dataclass(frozen=True, eq=False)
class Track:
    """What was played, and how it ended."""

    pieces: tuple[Piece, ...]
    ending: Ending
    attempts: int


def track(reference: Reference, progress: Callable[[float, float], None] | None = None) -> Track:
    """Play a reference forward as far as it goes.

    `progress` is told the seconds played and the seconds of the clip. An interrupt (Ctrl-C) ends
    the simulation where it is.
    """
    return _Tracker(reference, progress).run()


class _Tracker:
    def __init__(
        self, reference: Reference, progress: Callable[[float, float], None] | None
    ) -> None:
        self.reference, self.settings = reference, reference.settings
        self.planner, self.model = Planner(reference), reference.body.model
        self.progress = progress
        self.pieces: list[Piece] = []
        self.best: tuple[Piece, ...] = ()
        self.fall: Piece | None = None
        self.care, self.careful_until, self.attempts = 0, 0, 0
        self.grip_until = 0  # the knot up to which all friction is needed
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:], self.data.qvel[:] = reference.qpos[0], reference.qvel[0]
        self.started = time.process_time()

    def run(self) -> Track:
        ending: Ending = "end"
        try:
            while self.knot < self.reference.knots:
                piece = self._advance()
                if piece is not None:
                    self.pieces.append(piece)
                    self._forget()
                    self._tell()
                elif not self._retreat():
                    ending = "lost"
                    break
        except KeyboardInterrupt:
            ending = "interrupted"
        return Track(self._furthest(), ending, self.attempts)

    @property
    def knot(self) -> int:
        """Where the simulation is."""
        return self.pieces[-1].last if self.pieces else 0

    def _forget(self) -> None:
        """Let go of plans that no retreat comes back to: they outweigh all else that is kept."""
        settings = self.settings
        reach = settings.retreat * len(settings.care) / settings.commit
        far = len(self.pieces) - int(np.ceil(reach)) - 3
        if far >= 0:
            self.pieces[far] = replace(self.pieces[far], plan=None)

    def _furthest(self) -> tuple[Piece, ...]:
        ahead = bool(self.best) and self.best[-1].last > self.knot
        return self.best if ahead else tuple(self.pieces)

    def _tell(self) -> None:
        if self.progress is not None:
            knot = self.settings.knot
            self.progress(self.knot * knot, self.reference.knots * knot)

    def _effort(self) -> tuple[float, int]:
        """Window (s) and iterations of the next plan."""
        settings = self.settings
        if self._over_budget():
            return settings.window, 1
        if self.care and self.knot < self.careful_until:
            return settings.care[self.care - 1]
        self.care = 0
        return settings.window, settings.iterations

    def _over_budget(self) -> bool:
        budget = self.settings.budget
        spent = time.process_time() - self.started
        played = max(self.knot * self.settings.knot, self.settings.commit)
        return budget is not None and spent > budget * played

    def _advance(self) -> Piece | None:
        """Plan from here and play the beginning; None where the body is lost."""
        reference, settings, knot = self.reference, self.settings, self.knot
        window, iterations = self._effort()
        last = min(knot + round(window / settings.knot), reference.knots)
        before = self._state()
        self.fall = None
        plan = self._begin(before, knot, last)
        if plan is None:
            self._restore(before)
            return None
        if knot == 0 and iterations > 1:
            before, plan = self.planner.quicken(before, plan, iterations)
            self._restore(before)
        plan = self._improved(before, plan, iterations)
        if iterations > 1 and plan.cost > settings.stuck:
            plan = self._others(before, plan, iterations)
        piece = self._play(before, plan, min(knot + round(settings.commit / settings.knot), last))
        gone = np.flatnonzero(marker_errors(reference, piece.qpos, piece.first) >= settings.lost)
        if not len(gone):
            return piece
        self._restore(before)
        self.fall = piece.until(piece.first + int(gone[0]) + 1)
        return None

    def _improved(self, before: Array, plan: Plan, iterations: int) -> Plan:
        """Newton steps: on a smoother floor where its gains hold there, else on the real one.

        Where they do not, the next windows, which share most of this one, need not try.
        """
        planner, settings, last = self.planner, self.settings, plan.first + len(plan.torque)
        if plan.first >= self.grip_until:
            with planner.on_a_smoother_floor():
                smooth = planner.improve(before, plan, iterations)
            kept = planner.follow(before, plan.first, last, smooth, gain=smooth.gain)
            if (
                kept is not None
                and kept.cost <= settings.good
                and self._holds(before, kept, smooth)
            ):
                kept.gain = smooth.gain
                return kept
            self.grip_until = last
        hard = settings.hard_iterations if iterations > 1 else 0
        return planner.improve(before, plan, iterations, hard)

    def _holds(self, before: Array, kept: Plan, smooth: Plan) -> bool:
        """Whether the gains lead back from a start a little aside, on the smoother floor."""
        planner, last = self.planner, kept.first + len(kept.torque)
        start = planner.shifted(before, self.settings.aside)
        with planner.on_a_smoother_floor():
            back = planner.follow(start, kept.first, last, kept, gain=smooth.gain)
        return back is not None and back.cost <= self.settings.good

    def _begin(self, before: Array, knot: int, last: int) -> Plan | None:
        """The old plan continued, or, where that falls apart, the reference's torques."""
        old = self.pieces[-1].plan if self.pieces else None
        for first in (old, None) if old else (None,):
            for end in (last, knot + (last - knot) // 2, knot + (last - knot) // 4):
                plan = self.planner.follow(before, knot, end, first) if end > knot else None
                if plan is not None:
                    return plan
        return None

    def _others(self, before: Array, plan: Plan, iterations: int) -> Plan:
        """The best of a plan and what Newton steps make of its noisy variants."""
        settings, planner, last = self.settings, self.planner, plan.first + len(plan.torque)
        found = [planner.follow(before, plan.first, last, None)]
        for noise in self._noise(plan):
            varied = replace(plan, torque=plan.torque + noise)
            found.append(planner.follow(before, plan.first, last, varied, gain=plan.gain))
        runners = sorted((each for each in found if each is not None), key=lambda each: each.cost)
        for each in runners[: settings.finalists]:
            better = planner.improve(before, each, iterations)
            plan = better if better.cost < plan.cost else plan
        return plan

    def _noise(self, plan: Plan) -> Array:
        """(samples, H, nu) smooth noise on the torques; the assist has none."""
        settings, body = self.settings, self.reference.body
        random = np.random.default_rng((settings.seed, plan.first, self.attempts))
        size = np.where(np.isfinite(body.high), body.high, 0.0)
        time = settings.knot * np.arange(len(plan.torque))
        at = np.arange(0.0, time[-1] + 2 * settings.noise_s, settings.noise_s)
        values = random.normal(size=(settings.samples, max(len(at), 4), len(size)))
        at = settings.noise_s * np.arange(values.shape[1])
        noise = CubicSpline(at, values, axis=1)(time)
        return np.asarray(settings.noise * size * noise)

    def _play(self, before: Array, plan: Plan, last: int) -> Piece:
        model, data, settings = self.model, self.data, self.settings
        controls, knots = self.reference.body.controls, last - plan.first
        steps = settings.steps_per_knot
        qpos, qvel = np.empty((knots * steps, model.nq)), np.empty((knots * steps, model.nv))
        for k in range(knots):
            data.qfrc_applied[controls] = plan.torque[k]
            for row in range(k * steps, (k + 1) * steps):
                mujoco.mj_step(model, data)
                qpos[row], qvel[row] = data.qpos, data.qvel
        assert plan.gain is not None
        return Piece(
            plan.first, before, qpos, qvel, plan.torque[:knots].copy(),
            plan.gain[:knots].astype(np.float32), plan,
        )  # fmt: skip

    def _retreat(self) -> bool:
        """Take back what led here; False where all attempts are spent."""
        failed = self.knot
        if not self.best or failed > self.best[-1].first:
            self.best = (*self.pieces, *([self.fall] if self.fall else []))
        if self.care >= len(self.settings.care) or self._over_budget():
            return False
        self.care += 1
        self.attempts += 1
        back = failed - round(self.settings.retreat / self.settings.knot) * self.care
        while self.pieces and self.pieces[-1].first >= max(back, 0):
            self._restore(self.pieces.pop().before)
        self.careful_until = failed + round(self.settings.window / self.settings.knot)
        return True

    def _state(self) -> Array:
        """The integration state: with it, and torques, MuJoCo's next step is determined."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, state, _STATE)
        return state

    def _restore(self, state: Array) -> None:
        mujoco.mj_setState(self.model, self.data, state, _STATE)


def marker_errors(reference: Reference, qpos: Array, first: int) -> Array:
    """Root-mean-square marker error, in heights, at the knots after `first` (poses per step)."""
    character, steps = reference.body.character, reference.settings.steps_per_knot
    played = qpos[steps - 1 :: steps]
    wanted = reference.qpos[first + 1 : first + 1 + len(played)]
    markers = character.markers
    places = [
        trajectories(character.tree, np.ascontiguousarray(q), markers.body, markers.local)
        for q in (played, wanted)
    ]
    squared = ((places[0] - places[1]) ** 2).sum(axis=-1).mean(axis=-1)
    return np.asarray(np.sqrt(squared) / character.height)
