"""Contact phases found in the motion against load on the plates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physretarget.groundtruth.coverage import Coverage
from physretarget.groundtruth.trial import Bools, Floats, Trial
from physretarget.kinematics import runs


@dataclass(frozen=True, kw_only=True)
class ContactTiming:
    """Over the covered frames, both feet.

    ``agreement``: share of foot frames on which plate and motion agree; ``touch_down`` and
    ``lift_off``: errors in s of every event that lies inside the covered frames, positive if
    found late; ``missed``: loads without a contact; ``invented``: contacts without a load.
    """

    agreement: float
    touch_down: tuple[float, ...]
    lift_off: tuple[float, ...]
    missed: int
    invented: int


def contact_timing(trial: Trial, covered: Coverage) -> ContactTiming:
    """Compare per foot; stances beside the plates are not counted."""
    time, whole = trial.motion.time, covered.whole
    down: list[float] = []
    up: list[float] = []
    missed = invented = 0
    for foot in range(2):
        loaded = covered.loaded[:, foot] & whole
        found = covered.contact[:, foot] & whole
        stances = runs(found)
        for first, last in runs(loaded):
            over = [run for run in stances if run[0] <= last and run[1] >= first]
            if not over:
                missed += 1
                continue
            if _inside(whole, first, over[0][0]):
                down.append(float(time[over[0][0]] - time[first]))
            if _inside(whole, last, over[-1][1]):
                up.append(float(time[over[-1][1]] - time[last]))
        invented += sum(not loaded[first : last + 1].any() for first, last in stances)
    same: Bools = covered.loaded[whole] == covered.contact[whole]
    return ContactTiming(
        agreement=float(same.mean()) if same.size else float("nan"),
        touch_down=tuple(down),
        lift_off=tuple(up),
        missed=missed,
        invented=invented,
    )


def _inside(whole: Bools, *events: int) -> bool:
    """Whether what happens at these frames was seen to happen: neighbours are covered too."""
    last = len(whole) - 1
    return all(0 < i < last and bool(whole[i - 1] and whole[i + 1]) for i in events)


def size(errors: Floats | tuple[float, ...]) -> float | None:
    """Mean size of errors in s, None of none."""
    return float(np.mean(np.abs(errors))) if len(errors) else None
