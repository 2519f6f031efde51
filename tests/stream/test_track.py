from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.mapping import track as tracking
from physretarget.mapping.gplvm import SharedGPLVM, fit_gplvm

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def model() -> SharedGPLVM:
    """Of key poses along a curve."""
    rng = np.random.default_rng(2)
    phase = np.linspace(0.0, 6.0, 40)
    base = np.stack([np.sin(phase), np.cos(phase), phase / 6.0, np.sin(2.0 * phase)], axis=1)
    y, z = base @ rng.normal(size=(4, 12)), np.tanh(base @ rng.normal(size=(4, 9)))
    return fit_gplvm(y, z, dims=5, iterations=30)


@pytest.fixture
def tracker(model: SharedGPLVM) -> tracking._LatentTracker:
    found = tracking.track(model)
    assert isinstance(found, tracking._LatentTracker)
    return found


def between(model: SharedGPLVM, k: int) -> Array:
    """Actor features half way from one key pose to the next, in natural units."""
    return model.space_y.natural(0.5 * (model.keys_y[k] + model.keys_y[k + 1]))


def test_gradient_is_that_of_the_value(
    model: SharedGPLVM, tracker: tracking._LatentTracker
) -> None:
    y = model.space_y.normal(between(model, 7))
    led, variance = tracker._led(y)
    frame = tracking._Frame(tracker, y, led, model.search.guide / variance)
    x, step = led + 0.1, 1e-5
    found = frame.gradient(frame.at(x))
    for k in range(len(x)):
        way = step * np.eye(len(x))[k]
        wanted = (frame.at(x + way).value - frame.at(x - way).value) / (2.0 * step)
        assert found[k] == pytest.approx(wanted, rel=1e-4, abs=1e-3)


def test_decodes_as_the_model_does(model: SharedGPLVM, tracker: tracking._LatentTracker) -> None:
    x = model.latent[3] + 0.05
    found, wanted = tracker._decoded(x, 0.02), model.decode(x[None], 0.02)
    assert found.mean == pytest.approx(wanted.mean, abs=1e-10)
    assert found.variance == pytest.approx(wanted.variance, rel=1e-8)


def test_the_guide_is_the_models(model: SharedGPLVM, tracker: tracking._LatentTracker) -> None:
    y = between(model, 11)
    led, variance = tracker._led(model.space_y.normal(y))
    wanted = model.guide.predict(model.space_y.normal(y)[None])
    assert led == pytest.approx(wanted.mean[0], abs=1e-10)
    assert variance == pytest.approx(
        float(wanted.variance[0]), rel=1e-4
    )  # of numbers that all but cancel


def test_a_learned_curvature_explains_the_last_step() -> None:
    rng = np.random.default_rng(5)
    root = rng.normal(size=(6, 6))
    curvature, step = root @ root.T + np.eye(6), rng.normal(size=6)
    learned = tracking._learned(np.eye(6), step, curvature @ step)
    assert learned @ (curvature @ step) == pytest.approx(step)
    assert learned == pytest.approx(learned.T)
    assert np.linalg.eigvalsh(learned).min() > 0
    uphill = tracking._learned(np.eye(6), step, -curvature @ step)
    assert np.array_equal(uphill, np.eye(6))


def test_followed_frames_end_where_the_batch_search_ends(
    model: SharedGPLVM, tracker: tracking._LatentTracker
) -> None:
    ends = [between(model, 4), between(model, 5)]
    frames = np.array([ends[0] + s * (ends[1] - ends[0]) for s in np.linspace(0, 1, 10)])
    found = np.array([tracker.next(frame).mean[0] for frame in frames])
    miss = found - model.predict(frames).mean
    assert np.abs(miss).max() < 0.01 * model.space_z.scale
