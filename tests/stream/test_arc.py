from __future__ import annotations

import math

import pytest

from physretarget.stream.arc import SEAM, Arc, Throw


def test_a_throw_is_a_parabola_between_its_ends() -> None:
    throw = Throw(1.0, 2.0, 0.3)
    assert [throw.at(t) for t in (0.5, 1.0, 1.25, 1.5, 2.0, 3.0)] == pytest.approx(
        [0.0, 0.0, 0.225, 0.3, 0.0, 0.0]
    )


def test_the_highest_of_several_throws_counts() -> None:
    arc = Arc()
    throws = (Throw(0.0, 1.0, 0.1), Throw(0.2, 0.8, 0.3))
    arc.foresee(0.0, throws)
    assert arc.foresee(0.1, throws) == pytest.approx(throws[0].at(0.1))
    assert arc.foresee(0.5, throws) == pytest.approx(0.3)


def test_another_forecast_is_eased_in() -> None:
    arc, step = Arc(), 1e-3
    arc.foresee(0.0, (Throw(0.0, 1.0, 0.2),))
    before = arc.eased(arc.foresee(0.5, arc.throws), 0.0)
    late = Throw(0.0, 1.2, 0.3)
    after = arc.eased(arc.foresee(0.5, (late,)), step)
    assert after == pytest.approx(before, abs=5e-3)
    gap = after - late.at(0.5)
    again = arc.eased(arc.foresee(0.5 + SEAM, (late,)), SEAM)
    assert again - late.at(0.5 + SEAM) == pytest.approx(gap / math.e)


def test_a_stance_ends_the_throw_softly() -> None:
    arc = Arc()
    arc.foresee(0.0, (Throw(0.0, 1.0, 0.2),))
    height = arc.eased(arc.foresee(0.5, ()), 0.0)
    assert height == pytest.approx(0.2)
    assert arc.eased(arc.foresee(2.0, ()), 1.5) == pytest.approx(0.0, abs=1e-9)
