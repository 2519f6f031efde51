from __future__ import annotations

import numpy as np
import pytest

from physretarget.mapping import fit, from_arrays
from physretarget.mapping.calibration import SIGMAS, Calibration, calibrate, holes
from physretarget.mapping.gplvm import fit_gplvm
from physretarget.mapping.kernels import Kernel
from physretarget.mapping.regression import Posterior


def pairs(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Four hidden degrees of freedom, and a kink that no smooth kernel expects."""
    rng = np.random.default_rng(seed)
    hidden = rng.normal(size=(count, 4))
    y = np.tanh(0.4 * hidden @ rng.normal(size=(4, 18)))
    return y, 0.1 * np.abs(hidden) @ rng.normal(size=(4, 9))


def test_the_factor_is_that_of_a_known_law() -> None:
    """A mapper that misses by three of its own sigmas, half of the coordinates by less."""
    rng = np.random.default_rng(1)
    keys = rng.normal(size=(600, 3))
    scale = np.array([4.0, 4.0, 2.0, 2.0])
    truth = rng.normal(size=(600, 4)) * scale

    def predict(keep: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((len(frames), 4)), np.ones(len(frames))

    found = calibrate(predict, keys, truth)
    np.testing.assert_allclose(found.factor * found.share, scale**2, rtol=0.12)
    assert found.share.mean() == pytest.approx(1.0)


def test_what_is_left_out_is_not_used() -> None:
    keys = np.random.default_rng(2).normal(size=(25, 3))
    groups = holes(keys)
    assert sorted(np.concatenate(groups)) == list(range(25))
    asked = []

    def predict(keep: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert not any((keys[keep] == frame).all(axis=1).any() for frame in frames)
        asked.append(len(frames))
        return np.zeros((len(frames), 2)), np.ones(len(frames))

    calibrate(predict, keys, np.ones((25, 2)))
    assert asked == [len(group) for group in groups]


@pytest.mark.parametrize("name", ["gp", "sgplvm"])
def test_intervals_hold_new_poses_and_the_mean_stays(name: str) -> None:
    y, z = pairs(140)
    mapper = fit(name, y[:70], z[:70])
    mapped = mapper.predict(y[70:])
    inside = np.abs(mapped.mean - z[70:]) <= SIGMAS * np.sqrt(mapped.coordinate_variance)
    assert 0.85 < inside.mean() < 0.995
    plain = fit(name, y[:70], z[:70], calibrated=False).predict(y[70:])
    np.testing.assert_array_equal(plain.mean, mapped.mean)
    rebuilt = from_arrays(mapper.to_arrays()).predict(y[70:])
    np.testing.assert_allclose(rebuilt.coordinate_variance, mapped.coordinate_variance)


def test_few_poses_say_nothing() -> None:
    y, z = pairs(6)
    assert fit_gplvm(y, z).calibration.factor == 1.0
    np.testing.assert_array_equal(Calibration.none(3).share, 1.0)


def test_an_uncertain_input_makes_the_mean_uncertain() -> None:
    """Against the derivative by finite differences, and against sampled inputs."""
    rng = np.random.default_rng(3)
    inputs, targets = rng.normal(size=(15, 3)), rng.normal(size=(15, 5))
    posterior = Posterior.of(Kernel(1.0, 0.4, 0.1, 1e-2, 0.3), inputs, targets)
    x = rng.normal(size=(4, 3))
    step = 1e-6 * np.eye(3)
    derivative = np.array([(posterior.at(x + s)[0] - posterior.at(x - s)[0]) / 2e-6 for s in step])
    np.testing.assert_allclose(
        posterior.slope(x), np.sum(derivative**2, axis=(0, 2)) / 5, rtol=1e-5
    )
    drawn = posterior.at(x[0] + 0.01 * rng.normal(size=(20000, 3)))[0]
    assert drawn.var(axis=0).mean() == pytest.approx(1e-4 * posterior.slope(x)[0], rel=0.05)
