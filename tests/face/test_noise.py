"""Noise read off a capture, and what it does to the weight of its frames."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.face.curve import Curve
from physretarget.face.measure import pseudo_capture, turning_point_timing, turning_points
from physretarget.face.noise import measure_noise, reliability, smoothed


def moving(seconds=40.0):
    rng = np.random.default_rng(5)
    times = np.cumsum(rng.uniform(0.3, 0.9, int(seconds / 0.6)))
    return Curve.through(times, rng.uniform(0, 1, len(times)), "flat")


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_both_parts_are_found_again(fps):
    curve = moving()
    rng = np.random.default_rng(0)
    _, noisy = pseudo_capture(curve, fps, rng, noise=0.01, jitter=0.8)
    found = measure_noise(noisy, smoothed(noisy[None], fps)[0], fps)
    assert found.jitter == pytest.approx(0.8 / np.sqrt(3), rel=0.35)
    assert found.steady == pytest.approx(0.01, rel=0.5)


def test_steady_noise_is_not_taken_for_jitter():
    rng = np.random.default_rng(0)
    _, noisy = pseudo_capture(moving(), 60, rng, noise=0.01, jitter=0.0)
    assert measure_noise(noisy, smoothed(noisy[None], 60)[0], 60).jitter < 0.15


def test_fast_frames_count_less_and_rest_counts_fully():
    values = np.concatenate([np.zeros(40), np.linspace(0, 1, 10), np.ones(40)])
    noise = measure_noise(values, values, 30)
    assert (noise.steady, noise.jitter) == (0, 0)
    weight = reliability(values, type(noise)(0.0, 0.5), 0.01)
    assert weight[:30] == pytest.approx(np.ones(30))
    assert weight[45] < 0.1
    assert measure_noise(values[:9], values[:9], 30).jitter == 0


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
