"""The clip played forward by MuJoCo: by joint torques alone, or with an assist on the root.

Receding-horizon iLQR: a window of motion is rolled out, its derivatives taken by finite
differences, one Newton step by a Riccati recursion gives torques and feedback, and the beginning
of the best plan is played. What comes out is a simulation: the recorded torques reproduce it.

A body's limits and options (:mod:`body`, :mod:`torques`), the clip at the knots (:mod:`reference`),
what errors cost (:mod:`cost`), a window (:mod:`plan`), the whole clip (:mod:`track`), its result
(:mod:`simulation`), the proof (:mod:`replay`).
"""

from __future__ import annotations

from physretarget.simulate.proof import follow, model_of, replay
from physretarget.simulate.run import simulate
from physretarget.simulate.settings import SimulationSettings, settings_of
from physretarget.simulate.simulation import Simulation, SimulationMeasures

__all__ = [
    "Simulation",
    "SimulationMeasures",
    "SimulationSettings",
    "follow",
    "model_of",
    "replay",
    "settings_of",
    "simulate",
]
