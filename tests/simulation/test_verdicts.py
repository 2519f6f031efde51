"""What MuJoCo simulates is possible: no finding of dynamics or floating is an error about it."""

from __future__ import annotations

import pytest

from benchmarks.simulations.judge import Take, judged, simulated

TAKES = [
    ("lamp", "drop"), ("lamp", "ragdoll"), ("penguin", "hop"), ("penguin", "fall"),
    ("squirrel", "stand"), ("squirrel", "push"), ("four legs", "hop"), ("six legs", "dance"),
    ("wheels", "skid"), ("wheels", "roll"), ("arm", "drop"), ("ball", "roll"), ("bird", "fall"),
    ("box", "skid"), ("snake", "skid"), ("turtle", "push"), ("rover", "roll"),
    ("marble", "skid"), ("person", "dance"), ("coin", "ragdoll"),
]  # fmt: skip


@pytest.mark.parametrize(("subject", "scenario"), TAKES)
def test_no_error_of_the_dynamics_about_a_simulation(subject: str, scenario: str) -> None:
    take = Take(subject, scenario, 0, 0)
    played = simulated(take)
    for fps in (60, 250, 500):
        result = judged(take, played, fps)
        assert [a for a in result.alarms if a.code.startswith(("DYN", "CON003"))] == [], fps
        assert result.residuals["unexplained_force_max_bw"] < 0.02
