"""What a stage does to the acting: pose, gaze, speed, timing and hops, beside the stage before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.ground.undersides import lowest_heights, solids
from physretarget.keyposes.propose import gazes
from physretarget.mjcf import Character

Array = NDArray[np.float64]

SINCE: Mapping[str, str] = {
    "contacted": "placed",
    "physical": "contacted",
    "balanced": "contacted",
    "simulated": "balanced",
    "after": "before",
}
"""The stage that each begins with. Before ``placed`` a clip stands on the spot."""
LONGEST_LAG_S = 0.2
_CHUNK = 1024


@dataclass(frozen=True, kw_only=True)
class Acting:
    """One stage's clip as a spectator sees it.

    ``since`` names the stage that it began with, None where there is none to compare with; against
    it: ``moved`` RMS displacement of the markers over the height, ``gaze_error_deg`` RMS, and
    ``lag_s``, by how much its speeds come later. Of the clip itself: ``gaze_speed_deg_s``,
    ``joint_speed_rad_s`` and ``joint_step_rad`` (in one frame), peaks; ``hop``, the highest that
    its lowest point comes above the floor, over the height.
    """

    stage: str
    since: str | None
    moved: float | None
    gaze_error_deg: float | None
    lag_s: float | None
    gaze_speed_deg_s: float
    joint_speed_rad_s: float
    joint_step_rad: float
    hop: float


@dataclass(frozen=True, kw_only=True)
class ActingBudget:
    """What the last stage may cost the acting; what cannot be mended within stays and is said.

    ``moved`` and ``lag_s`` as in :class:`Acting`; ``gaze_speed`` and ``joint_speed`` peaks as
    shares of those of the stage that it began with.
    """

    moved: float = 0.05
    lag_s: float = 0.05
    gaze_speed: float = 1.2
    joint_speed: float = 1.5


def measure_acting(
    character: Character, stages: Mapping[str, Array], time: Array
) -> tuple[Acting, ...]:
    """Of every stage's clip (T, nq), in order; ``time`` (T,) s."""
    seen = {name: _Seen.of(character, qpos) for name, qpos in stages.items()}
    step = float(time[-1] - time[0]) / (len(time) - 1) if len(time) > 1 else 1.0
    found = []
    for name, own in seen.items():
        since = SINCE.get(name)
        before = seen.get(since) if since is not None else None
        size = own.largest_step()
        found.append(
            Acting(
                stage=name,
                since=since if before is not None else None,
                moved=None if before is None else own.moved_from(before) / character.height,
                gaze_error_deg=None if before is None else own.gaze_off(before),
                lag_s=None if before is None else own.lag_behind(before, step),
                gaze_speed_deg_s=own.gaze_step() / step,
                joint_speed_rad_s=size / step,
                joint_step_rad=size,
                hop=own.highest / character.height,
            )
        )
    return tuple(found)


def over_budget(acting: tuple[Acting, ...], budget: ActingBudget | None = None) -> tuple[str, ...]:
    """What the last stage costs beyond its budget, one sentence each."""
    budget = budget or ActingBudget()
    last = acting[-1]
    by_name = {each.stage: each for each in acting}
    if last.since is None or last.moved is None or last.lag_s is None:
        return ()
    before, said = by_name[last.since], []
    if last.moved > budget.moved:
        said.append(f"moves the pose by {last.moved:.1%} of the height (budget {budget.moved:.1%})")
    if abs(last.lag_s) > budget.lag_s:
        said.append(f"shifts the timing by {last.lag_s:+.2f} s (budget {budget.lag_s:.2f} s)")
    for what, unit, now, then, most in (
        ("head", "°/s", last.gaze_speed_deg_s, before.gaze_speed_deg_s, budget.gaze_speed),
        ("fastest joint", "rad/s", last.joint_speed_rad_s, before.joint_speed_rad_s,
         budget.joint_speed),
    ):  # fmt: skip
        if now > most * then:
            said.append(f"turns the {what} at {now:.3g} {unit}, {now / max(then, 1e-9):.1f} × as "
                        f"fast as stage {last.since} (budget {most:.1f} ×)")  # fmt: skip
    return tuple(f"Stage {last.stage} {each}." for each in said)


def hop_height(character: Character, qpos: Array) -> float:
    """The highest (m) that the lowest point of a clip (T, nq) comes above the floor."""
    return _Seen.of(character, qpos).highest


@dataclass(frozen=True, eq=False)
class _Seen:
    """``markers`` (T, K, 3) m, ``gaze`` (T, 3), ``turn`` (T - 1, nv) of joints, ``highest`` m."""

    markers: Array
    gaze: Array
    turn: Array
    highest: float

    @classmethod
    def of(cls, character: Character, qpos: Array) -> _Seen:
        tree, points = character.tree, character.markers
        turns = tree.tables.dof_turns.astype(bool).copy()
        if character.has_root:
            turns[character.root_dof : character.root_dof + 6] = False
        markers = kinematics.trajectories(tree, qpos, points.body, points.local)
        shapes, highest = solids(character), 0.0
        for at in range(0, len(qpos), _CHUNK):
            pose = kinematics.forward(tree, qpos[at : at + _CHUNK])
            low = lowest_heights(shapes, pose)
            if low.size:
                highest = max(highest, float(low.min(axis=1).max()) - character.floor_height)
        step = kinematics.difference(tree, qpos[:-1], qpos[1:])[:, turns]
        return cls(markers, gazes(character, qpos), step, highest)

    def largest_step(self) -> float:
        return float(np.abs(self.turn).max(initial=0.0))

    def gaze_step(self) -> float:
        return float(_angles(self.gaze[1:], self.gaze[:-1]).max(initial=0.0))

    def gaze_off(self, before: _Seen) -> float:
        return float(np.sqrt(np.mean(_angles(self.gaze, before.gaze) ** 2)))

    def moved_from(self, before: _Seen) -> float:
        squared = np.sum((self.markers - before.markers) ** 2, axis=-1)
        return float(np.sqrt(squared.mean()))

    def lag_behind(self, before: _Seen, step: float) -> float:
        """s, where the speeds of joints are most alike."""
        one, other = (np.linalg.norm(each.turn, axis=1) for each in (self, before))
        one, other = one - one.mean(), other - other.mean()
        most = min(int(LONGEST_LAG_S / step), len(one) // 2)
        count = len(one)
        lags = range(-most, most + 1)
        alike = [
            float(one[max(k, 0) : count + min(k, 0)] @ other[max(-k, 0) : count - max(k, 0)])
            for k in lags
        ]
        # Of equals the least: a clip that does not move has no lag.
        best = max(range(len(lags)), key=lambda i: (alike[i], -abs(lags[i])))
        return lags[best] * step


def _angles(one: Array, other: Array) -> Array:
    """(T,) degrees between unit vectors, exact for small ones too."""
    half = 0.5 * np.linalg.norm(one - other, axis=1)
    found: Array = np.degrees(2.0 * np.arcsin(np.clip(half, 0.0, 1.0)))
    return found
