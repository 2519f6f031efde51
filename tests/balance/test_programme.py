"""The convex programme on cases that can be done by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from physretarget.ocp.balance import Programme, Support, Weights, minimise, unexplained
from physretarget.ocp.basis import differences

EASY = Weights(residual=1e3, spike=0.0, roughness=0.0, ends=0.0, limit=100.0)


def _programme(wrench: np.ndarray, half: float, tau2: float, step: float) -> Programme:
    """A point mass at height 1 over a square of half width ``half``, second differences τ²."""
    frames = len(wrench)
    corners = np.array([[x, y, -1.0] for x in (-half, half) for y in (-half, half)])
    return Programme(
        wrench=wrench,
        support=Support(np.tile(corners, (frames, 1, 1)), np.ones((frames, 4), bool), 1.0),
        patience=np.ones(frames),
        second=sparse.csr_array(differences(frames, step)[1] * tau2),
        columns=np.arange(frames),
        first=sparse.csr_array((frames, frames)),
        excursion=np.zeros((frames, 6)),
        cost=np.tile(np.diag([1.0, 1.0, 1.0, 50.0, 50.0, 50.0]), (frames, 1, 1)),
    )


def _standing(frames: int, offset: float) -> np.ndarray:
    """Weight borne ``offset`` (heights) beside the middle: the moment that this requires."""
    wrench = np.zeros((frames, 6))
    wrench[:, 2] = 1.0
    wrench[:, 4] = -offset
    return wrench


def test_a_lean_that_the_support_bears_stays() -> None:
    found = minimise(_programme(_standing(30, 0.1), 0.2, 0.04, 1 / 60), EASY)
    assert np.abs(found.excursion).max() < 2e-4
    assert np.abs(found.residual).max() < 1e-5


def test_a_lean_beyond_the_support_is_moved_onto_its_edge() -> None:
    """Standing still the zero-moment point is under the centre of mass: no other way is shorter."""
    found = minimise(_programme(_standing(240, 0.3), 0.2, 0.04, 1 / 60), EASY)
    middle = found.excursion[100:140]  # towards the ends it may fall: nothing follows
    assert middle[:, 0] == pytest.approx(-0.1, abs=2e-3)
    assert np.abs(found.residual).max() < 1e-4


def test_a_sinusoidal_pendulum_in_closed_form() -> None:
    """The zero-moment point p = c - τ² c̈ of a sway b sin ωt has the amplitude b (1 + τ² ω²).

    On a line of support the centre of mass must sway by the required amplitude over that factor
    (Kajita 2003, the cart on a table).
    """
    step, tau2, omega, amplitude = 1 / 120, 0.04, 2 * np.pi * 1.0, 0.1
    time = np.arange(480) * step
    wrench = _standing(len(time), 0.0)
    wrench[:, 4] = -amplitude * np.sin(omega * time)
    programme = _programme(wrench, 1e-6, tau2, step)
    found = minimise(programme, EASY)
    closed = -amplitude / (1 + tau2 * omega**2) * np.sin(omega * time)
    middle = slice(180, 300)
    assert found.excursion[middle, 0] == pytest.approx(closed[middle], abs=2e-3)
    assert np.abs(found.residual).max() < 1e-4


def test_in_flight_the_excursion_takes_back_what_nothing_pushes() -> None:
    """Without support force and moment must vanish: ü is minus what is required over τ²."""
    frames, tau2 = 40, 0.04
    inner = np.arange(1, frames - 1)  # one-sided differences at the ends repeat their neighbours
    wrench = np.zeros((len(inner), 6))
    wrench[:, [0, 4]] = 0.2 * np.random.default_rng(0).normal(size=(len(inner), 2))
    programme = replace(
        _programme(wrench, 0.1, tau2, 1 / 60),
        support=Support(np.zeros((len(inner), 1, 3)), np.zeros((len(inner), 1), bool), 1.0),
        second=sparse.csr_array((differences(frames, 1 / 60)[1] * tau2)[inner]),
        columns=inner,
        first=sparse.csr_array((frames, frames)),
        excursion=np.zeros((frames, 6)),
        cost=np.tile(np.eye(6), (frames, 1, 1)),
    )
    found = minimise(programme, EASY)
    assert np.abs(wrench[:, 0] + programme.second @ found.excursion[:, 0]).max() < 1e-4
    assert np.abs(found.residual).max() < 1e-4


def test_the_limit_holds() -> None:
    tight = Weights(residual=1e3, spike=0.0, roughness=0.0, ends=0.0, limit=0.05)
    found = minimise(_programme(_standing(60, 0.4), 0.1, 0.04, 1 / 60), tight)
    assert np.sqrt(np.sum(found.excursion[:, :3] ** 2, axis=1)).max() <= 0.05 + 1e-6
    assert np.abs(found.residual).max() > 0.1


@pytest.mark.parametrize(("offset", "rest"), [(0.0, 0.0), (0.2, 0.0), (0.3, None), (-0.5, None)])
def test_what_is_unexplained(offset: float, rest: float | None) -> None:
    programme = _programme(_standing(2, offset), 0.2, 0.04, 1 / 60)
    left = unexplained(programme.wrench, programme.support)
    if rest is None:  # as far as the edge is missed, at most
        assert 0.01 < left[0] <= abs(offset) - 0.2 + 1e-6
    else:
        assert left == pytest.approx(rest, abs=1e-5)


def test_a_pulling_floor_is_unexplained() -> None:
    wrench = np.zeros((1, 6))
    wrench[0, 2] = -0.7
    corners = np.array([[[0.2, 0.2, -1.0], [-0.2, -0.2, -1.0]]])
    left = unexplained(wrench, Support(corners, np.ones((1, 2), bool), 1.0))
    assert left == pytest.approx(0.7, abs=1e-5)


def test_much_in_one_frame_is_spread_over_many() -> None:
    """A lean that may not be mended enough: with ``spike`` no frame is left with most of it."""
    most, total = [], []
    for spike in (0.0, 5.0):
        weights = Weights(residual=0.1, spike=spike, roughness=0.01, ends=0.0, limit=0.1)
        wrench = _standing(60, 0.0)
        wrench[25:35, 4] = -0.6
        found = minimise(_programme(wrench, 0.1, 0.04, 1 / 60), weights)
        left = np.linalg.norm(found.residual, axis=1)
        most.append(left.max())
        total.append(left.sum())
    assert most[1] < 0.7 * most[0]
    assert total[1] > total[0]
