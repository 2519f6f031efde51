"""Gauss-Newton over one window, the motion's dynamics linearised anew in every iteration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.wholebody.problem import Price, State, Window, costs, evaluate, normal

Array = NDArray[np.float64]

IGNORANCE = 0.01
"""θ at first, see :func:`physretarget.wholebody.problem.normal`."""
HARDEN = 0.6
"""The soft length shrinks to this share of itself with every step."""
SHORTEST = 4
"""Times that a step is halved."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Where the search ended: the last trial, why, and after how many iterations."""

    state: State
    status: str
    iterations: int


def solve(window: Window, start: Array) -> Outcome:
    """Lead the poses ``start`` (T, nq) to where they cost least."""
    settings = window.settings
    softest, hardest = settings.soft
    price = Price(softest, np.ones(len(start)))
    state = evaluate(window, start, price)
    ignorance, status = IGNORANCE, "iteration limit"
    for iteration in range(1, settings.iterations + 1):
        if iteration - 1 in settings.patience:
            patience = 1.0 / (1.0 + (state.unexplained / settings.hopeless) ** 2)
            price = Price(price.soft, patience)
        state = replace(state, parts=costs(window, state, price))
        step = normal(window, state, price, ignorance).solve()
        trial, tried = _search(window, state, step, price)
        gained = (state.cost - trial.cost) / max(state.cost, 1e-12) if trial else 0.0
        if trial is not None:
            state = trial
        if tried == 0:
            ignorance *= 0.5
        elif trial is None:
            ignorance = min(1.0, 8.0 * ignorance)
        if trial is None:
            if ignorance == 1.0:
                status = "stuck"
                break
            continue
        final = price.soft <= hardest and iteration > max(settings.patience)
        if final and gained < settings.tolerance:
            status = "converged"
            break
        price = Price(max(hardest, HARDEN * price.soft), price.patience)
    return Outcome(state, status, iteration)


def _search(window: Window, state: State, step: Array, price: Price) -> tuple[State | None, int]:
    """The first of the halved steps that costs less, and how often it was halved."""
    character = window.character
    for halved in range(SHORTEST + 1):
        qpos = kinematics.integrate(character.tree, state.qpos, 0.5**halved * step)
        trial = evaluate(window, qpos, price)
        if trial.cost < state.cost:
            return trial, halved
    return None, SHORTEST + 1
