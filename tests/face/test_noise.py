"""Noise read off a capture; turning points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from physretarget.face.curve import Curve
from physretarget.face.measure import pseudo_capture, turning_point_timing, turning_points
from physretarget.face.noise import noise_level, smoothed


def moving(seconds=40.0):
    rng = np.random.default_rng(5)
    times = np.cumsum(rng.uniform(0.3, 0.9, int(seconds / 0.6)))
    return Curve.through(times, rng.uniform(0, 1, len(times)), "flat")


@pytest.mark.parametrize("fps", [30.0, 60.0])
@pytest.mark.parametrize("noise", [0.01, 0.03])
@pytest.mark.parametrize("jitter", [0.0, 0.8])
def test_steady_noise_is_found_again_beside_jitter(fps, noise, jitter):
    rng = np.random.default_rng(0)
    _, noisy = pseudo_capture(moving(), fps, rng, noise=noise, jitter=jitter)
    found = noise_level(noisy[None], smoothed(noisy[None], fps), fps, jitter**2 / 3)
    assert found[0] == pytest.approx(noise, rel=0.45)


@pytest.mark.parametrize("width", [1.0, 1.5])
def test_smoothing_does_not_hide_the_noise(width):
    rng = np.random.default_rng(1)
    rough = rng.normal(0, 0.02, (4, 600))
    found = [
        noise_level(v, smoothed(v, 30.0), 30.0)
        for v in (rough, gaussian_filter1d(rough, width, axis=1))
    ]
    assert found[0] == pytest.approx(np.full(4, 0.02), rel=0.3)
    assert found[1] == pytest.approx(np.full(4, 0.02), rel=0.55)  # a third is left per frame


def test_short_takes_have_no_noise_to_measure():
    assert noise_level(np.zeros((2, 6)), np.zeros((2, 6)), 30.0).tolist() == [0.0, 0.0]


def test_plateaus_are_one_turning_point():
    values = np.interp(np.arange(100), [0, 20, 40, 60, 99], [0, 1, 1, 0, 0.5])
    rows = turning_points(values, 0.2)
    assert rows[0].tolist() == [20, 40, 1]
    assert rows[1].tolist() == [60, 61, -1]  # within a tenth of what counts as standing out
    earlier = np.roll(values, -3)
    found = turning_point_timing(earlier, values, 0.2)
    assert found.count == 2
    assert found.missed == 0
    assert found.frames == pytest.approx(1.0, abs=0.51)  # the plateaus overlap
    assert turning_point_timing(np.zeros(100), values, 0.2).missed == 1
