"""Simulation by sampling beside ours: cross-entropy over servo targets, receding horizon.

    python -m benchmarks.sampling [--seconds S] [--samples N]

What others do on many cores (SAMCON, SPIDER): targets of a joint servo, one for each joint every
0.1 s, are drawn around the clip's joint angles, played in MuJoCo, and redrawn around the best. Same
clip, body, torque limits, window (0.4 s), commit (0.1 s), cost and start as ours; the reference's
torques are fed forward in both. Servos are critically damped at 6 Hz of each joint's inertia.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget import capture
from physretarget.clip import Clip
from physretarget.demo import models_folder, motions_folder
from physretarget.mapping.threads import one_thread
from physretarget.mjcf import Character
from physretarget.pipeline import retarget
from physretarget.reproduce.takes import learned
from physretarget.simulate import SimulationSettings, simulate
from physretarget.simulate.body import build_body
from physretarget.simulate.cost import Cost
from physretarget.simulate.reference import build_reference
from physretarget.simulate.track import marker_errors

Array = NDArray[np.float64]

SERVO_HZ = 6.0
TARGET_S = 0.1
ROUNDS, ELITE, SPREAD = 4, 0.125, 0.15  # rounds, share kept, rad
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Sampler:
    """Cross-entropy over servo targets on one reference."""

    def __init__(self, character: Character, clip: Clip, samples: int) -> None:
        self.settings = SimulationSettings()
        self.body = build_body(character, self.settings)
        self.reference = build_reference(clip, self.body, self.settings)
        self.cost, self.samples = Cost(self.reference), samples
        self.data = mujoco.MjData(self.body.model)
        self.random = np.random.default_rng(0)
        omega = 2 * np.pi * SERVO_HZ
        self.stiff, self.damp = omega**2 * self.body.inertia, 2 * omega * self.body.inertia

    def play(self, start: Array, first: int, last: int, offsets: Array) -> tuple[float, Array]:
        """Cost and poses per step with `offsets` (n, nu) rad added to the clip's joint angles."""
        model, data, reference, body = self.body.model, self.data, self.reference, self.body
        mujoco.mj_setState(model, data, start, _STATE)
        total, poses, nv = 0.0, [], model.nv
        every = round(TARGET_S / self.settings.knot)
        for knot in range(first, last + 1):
            error = self.cost.error(knot, data.qpos, data.qvel)
            if knot == last:
                total += self.cost.expand_last(knot, error, data.qpos).value
                break
            total += self.cost.value(knot, error, data.qpos)
            offset = offsets[min((knot - first) // every, len(offsets) - 1)]
            u = reference.torque[knot] + self.stiff * (offset - error[body.controls])
            u -= self.damp * error[nv + body.controls]
            data.qfrc_applied[body.controls] = np.clip(u, body.low, body.high)
            for _ in range(self.settings.steps_per_knot):
                mujoco.mj_step(model, data)
                poses.append(data.qpos.copy())
            if not abs(data.qvel).max() < self.settings.speed_most:
                return np.inf, np.array(poses)
        return total, np.array(poses)

    def run(self) -> Array:
        """Marker errors (K,) in heights until the body is lost, or the end."""
        data, reference, settings = self.data, self.reference, self.settings
        data.qpos[:], data.qvel[:] = reference.qpos[0], reference.qvel[0]
        state, knot = np.empty(mujoco.mj_stateSize(self.body.model, _STATE)), 0
        mujoco.mj_getState(self.body.model, data, state, _STATE)
        number, commit = round(settings.window / TARGET_S), round(settings.commit / settings.knot)
        mean, found = np.zeros((number, len(self.body.controls))), [np.zeros(0)]
        while knot < reference.knots:
            last = min(knot + round(settings.window / settings.knot), reference.knots)
            spread = np.full_like(mean, SPREAD)
            for _ in range(ROUNDS):
                drawn = mean + spread * self.random.normal(size=(self.samples, *mean.shape))
                drawn[0] = mean
                costs = [self.play(state, knot, last, each)[0] for each in drawn]
                best = drawn[np.argsort(costs)[: max(2, round(ELITE * self.samples))]]
                mean, spread = best.mean(axis=0), best.std(axis=0)
            end = min(knot + commit, reference.knots)
            _, poses = self.play(state, knot, end, mean)
            found.append(marker_errors(reference, poses, knot))
            if (found[-1] >= settings.lost).any():
                break
            mujoco.mj_getState(self.body.model, data, state, _STATE)
            mean, knot = np.concatenate([mean[1:], mean[-1:] * 0]), end
        return np.concatenate(found)


def main() -> None:
    """Play one clip both ways."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=0.4)
    parser.add_argument("--samples", type=int, default=32)
    told = parser.parse_args()
    one_thread(compare)(told.seconds, told.samples)


def compare(seconds: float, samples: int) -> None:
    """Print error, worst error, seconds survived and cost of both."""
    print("clip, method: deviation % of height RMS / worst, survived, CPU-s per s")
    for who, action in (("penguin", "walk"), ("penguin", "kick"), ("lamp", "kick")):
        mapper = learned(models_folder(), who)
        source = motions_folder() / f"humanoid3d_{action}.txt"
        whole = retarget(capture.load(source), mapper).clip
        kept = whole.time <= seconds
        clip = replace(
            whole, qpos=whole.qpos[kept], time=whole.time[kept], contact_active=None,
            contact_points=(),
        )  # fmt: skip
        started = time.process_time()
        played = simulate(clip, mapper.character)
        height = mapper.character.height
        tell(f"{who} {action}, iLQR", played.errors[1:] / height, clip, started)
        started = time.process_time()
        errors = Sampler(mapper.character, clip, samples).run()
        tell(f"{who} {action}, cross-entropy, {samples} × {ROUNDS}", errors, clip, started)


def tell(name: str, errors: Array, clip: Clip, started: float) -> None:
    """One line of a method on a clip."""
    lost = np.flatnonzero(errors >= SimulationSettings().lost)
    survived = (int(lost[0]) if len(lost) else len(errors)) * SimulationSettings().knot
    cpu = (time.process_time() - started) / max(survived, 1e-3)
    rms = 100 * float(np.sqrt(np.mean(errors**2)))
    print(
        f"{name}: {rms:.2f} / {100 * errors.max():.1f}, {survived:.2f} of {clip.duration:.2f} s, "
        f"{cpu:.1f}",
        flush=True,
    )


if __name__ == "__main__":
    main()
