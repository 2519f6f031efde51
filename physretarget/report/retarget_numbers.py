"""The tiles of a retargeting's page: what each stage reached, measured as that stage ended.

A later stage moves the character again: what the clip itself is worth is the validator's to say.
"""

from __future__ import annotations

import numpy as np

from physretarget.acting import over_budget
from physretarget.contact import Contacted
from physretarget.momentum import Placed
from physretarget.ocp import RootHeight
from physretarget.pipeline import Retargeted
from physretarget.report.retarget_data import KeyNumber
from physretarget.simulate import SimulationMeasures
from physretarget.wholebody import WholeBody

__all__ = ["key_numbers"]

BALANCED = 0.1
"""Mean unexplained wrench, in body weights, below which a clip counts as in balance: rule DYN001
warns from 0.1 on in a single frame."""


def key_numbers(result: Retargeted) -> tuple[KeyNumber, ...]:
    """Of every stage that ran, in order."""
    height = result.character.height
    numbers: list[KeyNumber] = []
    if result.placed is not None:
        numbers.append(_placed(result.placed))
    if result.contacted is not None:
        numbers.append(_contacted(result.contacted))
    if result.physical is not None:
        numbers += _physical(result.physical, height)
    if result.balanced is not None:
        numbers.append(_balanced(result.balanced, height, over_budget(result.acting)))
    if result.simulated is not None:
        numbers.append(_simulated(result.simulated.measures))
    return tuple(numbers)


def _placed(placed: Placed) -> KeyNumber:
    error = 100 * placed.error
    return KeyNumber(
        label="Forward momentum",
        stage="placed",
        value=_at_least(error),
        unit="%",
        note="RMS off its target",
        good=error <= 2.0,
    )


def _contacted(contacted: Contacted) -> KeyNumber:
    return KeyNumber(
        label="Planted points move",
        stage="contacted",
        value=_at_least(1000 * contacted.slide_max_m),
        unit="mm",
        note="at most, within a stance",
        good=contacted.slide_max_m < 0.002,
    )


def _physical(physical: RootHeight, height: float) -> list[KeyNumber]:
    fall = physical.improvement
    lift = float(np.abs(physical.displacement).max())
    numbers = [
        KeyNumber(
            label="Vertical mismatch",
            stage="physical",
            value=-100 * fall,
            unit="%",
            note=f"{physical.mismatch_before:.1f} N to {physical.mismatch_after:.1f} N RMS",
            good=fall >= 0.6,
        ),
        KeyNumber(
            label="Root displaced",
            stage="physical",
            value=100 * lift / height,
            unit="% of height",
            note=f"{1000 * lift:.0f} mm at most",
            good=lift <= 0.15 * height,
        ),
    ]
    if np.isfinite(physical.bound_rms):
        numbers.append(_bound(physical))
    if np.isfinite(physical.ballistic_after):
        numbers.append(
            KeyNumber(
                label="Off ballistic flight",
                stage="physical",
                value=physical.ballistic_after,
                unit="m/s²",
                note=f"{physical.ballistic_before:.1f} before",
                good=physical.ballistic_after <= 1.0,
            )
        )
    return numbers


def _bound(physical: RootHeight) -> KeyNumber:
    near = physical.bound_ratio < 100
    return KeyNumber(
        label="Convex bound",
        stage="physical",
        value=_at_least(physical.bound_rms),
        unit="N",
        note=f"mismatch is {physical.bound_ratio:.1f} × as much"
        if near
        else "no displacement with these contacts gets below",
    )


def _balanced(balanced: WholeBody, height: float, beyond: tuple[str, ...]) -> KeyNumber:
    """Good only if the acting did not pay for it."""
    before, after = balanced.unexplained_before.mean(), balanced.unexplained_after.mean()
    moved = 100 * float(np.sqrt(np.mean(balanced.moved**2))) / height
    return KeyNumber(
        label="Out of balance",
        stage="balanced",
        value=_at_least(float(after)),
        unit="BW",
        note=f"{before:.2f} BW before; pose moved by {moved:.1f} % of height",
        good=bool(after <= BALANCED) and not beyond,
    )


def _simulated(measures: SimulationMeasures) -> KeyNumber:
    return KeyNumber(
        label="Trackability",
        stage="simulated",
        value=round(measures.trackability, 2),
        unit="",
        note=f"{measures.survived_s:.2f} of {measures.duration_s:.2f} s played, "
        f"{100 * measures.tracking_share:.1f} % of height off, "
        f"assist {measures.assist_force_rms_bw:.2f} BW",
        good=measures.trackability >= 0.5,
    )


def _at_least(value: float, smallest: float = 0.01) -> float | str:
    """Figures below what matters are not worth their digits."""
    return value if value >= smallest else f"< {smallest:g}"
