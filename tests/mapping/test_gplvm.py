from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from physretarget.mapping import SharedGPLVM, fit, from_arrays
from physretarget.mapping.gplvm import JointLikelihood, fit_gplvm
from physretarget.mapping.kcca import canonical_directions, initial_latent
from physretarget.mapping.latent import latent_map
from physretarget.mapping.search import Likelihood, Prior, SearchSettings, locate_as_paper


def clip(frames: int = 120, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A smooth motion of four hidden degrees of freedom, seen by an actor and a character."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / 30
    hidden = np.sin(2 * np.pi * np.outer(t, [0.3, 0.5, 0.8, 1.1]) + rng.uniform(0, 6, 4))
    mix_y, mix_z = rng.normal(size=(4, 20)), rng.normal(size=(4, 9))
    return np.tanh(0.6 * hidden @ mix_y), 0.1 * np.tanh(0.4 * hidden @ mix_z)


def keys(count: int = 24) -> tuple[np.ndarray, np.ndarray]:
    y, z = clip()
    chosen = np.linspace(0, len(y) - 1, count).astype(int)
    return y[chosen], z[chosen]


def test_learning_gradient_is_the_derivative() -> None:
    rng = np.random.default_rng(3)
    y, z = rng.normal(size=(7, 11)), rng.normal(size=(7, 5))
    joint = JointLikelihood(y @ y.T, z @ z.T, 11, 5, 3)
    at = np.concatenate([rng.uniform(-2, 0.5, 10), rng.normal(size=21)])
    _, gradient = joint(at)
    numeric = approx_fprime(at, lambda v: joint(v)[0], 1e-6)
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4, atol=1e-3)


def test_learning_value_is_the_likelihood_of_the_paper() -> None:
    """Against densities written out with a plain inverse and determinant."""
    rng = np.random.default_rng(4)
    y, z, x = rng.normal(size=(6, 8)), rng.normal(size=(6, 3)), rng.normal(size=(6, 2))
    logs = rng.uniform(-1, 1, 10)
    joint = JointLikelihood(y @ y.T, z @ z.T, 8, 3, 2)
    expected = 0.5 * np.sum(x**2)
    for o, log in ((y, logs[:5]), (z, logs[5:])):
        a, b, c, noise, linear = np.exp(log)
        k = np.array([[a * np.exp(-b / 2 * np.sum((p - q) ** 2)) + c for q in x] for p in x])
        k += noise * np.eye(6) + linear * x @ x.T
        for column in o.T:
            expected += 0.5 * np.log(np.linalg.det(k)) + 0.5 * column @ np.linalg.inv(k) @ column
        expected += log[0] + log[1] + log[2] - log[3] + log[4]
    assert joint(np.concatenate([logs, x.ravel()]))[0] == pytest.approx(expected, rel=1e-10)


def test_mapping_gradient_is_the_derivative() -> None:
    y, z = keys()
    model = fit_gplvm(y, z, dims=5, iterations=50)
    rng = np.random.default_rng(5)
    frames = model.space_y.normal(y[:4] + 0.05 * rng.normal(size=(4, y.shape[1])))
    prior = Prior(0.1 * rng.normal(size=(4, 5)), rng.uniform(1.0, 50.0, 4))
    cost = Likelihood.of(model.actor, frames, prior)
    x = model.latent[[0, 5, 9, 2]] + 0.3 * rng.normal(size=(4, 5))
    for t in range(4):
        row = np.array([t])
        _, gradient = cost(x[[t]], row)
        step = 1e-5 * np.eye(5)
        numeric = [
            (cost((x[t] + s)[None], row)[0][0] - cost((x[t] - s)[None], row)[0][0]) / 2e-5
            for s in step
        ]
        np.testing.assert_allclose(gradient[0], numeric, atol=1e-5 * np.abs(gradient).max())


def test_key_poses_come_back() -> None:
    y, z = keys()
    mapped = fit("sgplvm", y, z).predict(y)
    assert np.sqrt(np.mean((mapped.mean - z) ** 2)) < 0.1 * z.std()


def test_frames_between_key_poses_are_mapped_and_less_certain_away_from_them() -> None:
    y, z = clip()
    model = fit("sgplvm", *keys())
    mapped = model.predict(y)
    assert np.sqrt(np.mean((mapped.mean - z) ** 2)) < 0.2 * z.std()
    far = model.predict(y[:5] + 3.0)
    assert np.isfinite(far.mean).all()
    assert far.variance.mean() > 3 * mapped.variance.mean()


def test_smoother_with_more_latent_dimensions() -> None:
    y, _ = clip(300)
    acceleration = {}
    for dims in (2, 30):
        mapped = fit("sgplvm", *keys(), dims=dims).predict(y)
        acceleration[dims] = np.abs(np.diff(mapped.mean, 2, axis=0)).mean()
    assert acceleration[30] < 0.5 * acceleration[2]


def test_same_input_same_bytes_and_arrays_rebuild_it() -> None:
    y, _ = clip()
    one, two = (fit("sgplvm", *keys(), seed=7) for _ in range(2))
    rebuilt = from_arrays(one.to_arrays())
    expected = one.predict(y).mean
    assert expected.tobytes() == two.predict(y).mean.tobytes()
    np.testing.assert_allclose(rebuilt.predict(y).mean, expected, atol=1e-9)


@pytest.mark.parametrize("count", [2, 3, 60])
def test_few_and_many_key_poses_more_dimensions_than_poses(count: int) -> None:
    y, z = keys(count)
    mapped = fit("sgplvm", y, z, dims=30, iterations=40).predict(y)
    assert np.sqrt(np.mean((mapped.mean - z) ** 2)) < 0.3 * z.std()


def test_duplicates_and_constant_features() -> None:
    y, z = keys(6)
    y, z = np.repeat(y, 3, axis=0), np.repeat(z, 3, axis=0)
    y[:, :5], z[:, 0] = 1.0, 2.0
    mapped = fit("sgplvm", y, z).predict(y)
    assert np.sqrt(np.mean((mapped.mean - z) ** 2)) < 0.1 * z.std()
    same = fit("sgplvm", np.ones((4, 5)), np.ones((4, 2))).predict(np.ones((3, 5)))
    np.testing.assert_allclose(same.mean, 1.0)


def test_streaming_is_the_batch() -> None:
    y, _ = clip()
    model = fit("sgplvm", *keys())
    single = np.concatenate([model.predict(frame[None]).mean for frame in y])
    np.testing.assert_allclose(single, model.predict(y).mean, rtol=0, atol=1e-5)


def test_the_papers_search_is_there_and_jumps_more() -> None:
    y, _ = clip(300)
    model = fit_gplvm(*keys(12), dims=4)
    paper = replace(model, search=SearchSettings(guide=0.0))
    steps = [np.abs(np.diff(m.predict(y).mean, 2, axis=0)).mean() for m in (model, paper)]
    assert steps[0] <= steps[1]
    rebuilt = from_arrays(paper.to_arrays()).predict(y[:20]).mean
    np.testing.assert_allclose(rebuilt, paper.predict(y[:20]).mean, atol=1e-6)


def test_sweeps_never_make_the_likelihood_worse() -> None:
    y, _ = clip()
    model = fit_gplvm(*keys(10), dims=4)
    frames = model.space_y.normal(y)
    cost = Likelihood.of(model.actor, frames, Prior.unit(len(y), 4))
    everyone = np.arange(len(y))
    alone = locate_as_paper(model.actor, model.keys_y, frames, SearchSettings(sweeps=0))
    swept = locate_as_paper(model.actor, model.keys_y, frames, SearchSettings())
    assert (cost(swept, everyone)[0] <= cost(alone, everyone)[0] + 1e-12).all()


def test_canonical_directions_find_what_is_shared() -> None:
    rng = np.random.default_rng(6)
    shared = rng.normal(size=40)
    y = np.stack([shared, rng.normal(size=40)], axis=1)
    z = np.stack([rng.normal(size=40), shared], axis=1)
    first = canonical_directions(y, z)[:, 0]
    assert abs(np.corrcoef(first, shared)[0, 1]) > 0.8
    start = initial_latent(y, z, 45, np.random.default_rng(0))
    assert start.shape == (40, 45)
    assert np.mean(start[:, 0] ** 2) == pytest.approx(1.0)


def test_latent_map_is_a_plane_with_low_variance_at_key_poses() -> None:
    y, _ = clip()
    model = fit("sgplvm", *keys(), dims=2)
    assert isinstance(model, SharedGPLVM)
    latent = model.predict(y).latent
    assert latent is not None
    drawn = latent_map(model, latent, cells=20)
    assert drawn.variance.shape == (20, 20)
    np.testing.assert_allclose(drawn.axes @ drawn.axes.T, np.eye(2), atol=1e-12)
    assert model.decode(model.latent).variance.max() < np.median(drawn.variance)


def test_long_clips_are_mapped_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    model = fit("sgplvm", *keys(), dims=3)
    y, _ = clip()
    whole = model.predict(y)
    monkeypatch.setattr("physretarget.mapping.gplvm._BLOCK", 50)
    blocks = model.predict(y)
    assert blocks.latent is not None
    assert blocks.latent.shape == (len(y), 3)
    np.testing.assert_allclose(blocks.mean, whole.mean, atol=2e-3 * np.ptp(whole.mean))
    np.testing.assert_allclose(blocks.variance, whole.variance, rtol=0.02)
