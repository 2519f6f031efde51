from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.stats import multivariate_normal

from physretarget.errors import InputError, UsageError
from physretarget.mapping import NAMES, fit, from_arrays
from physretarget.mapping.compare import leave_out
from physretarget.mapping.gp import fit_gp, marginal
from physretarget.mapping.kernels import Kernel, squared_distances
from physretarget.mapping.lbfgs import minimise
from physretarget.mapping.regression import Posterior


def pairs(count: int = 40, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    hidden = rng.uniform(-1, 1, size=(count, 3))
    y = hidden @ np.random.default_rng(9).normal(size=(3, 12))
    return y, 0.1 * np.tanh(hidden @ np.random.default_rng(8).normal(size=(3, 6)))


@pytest.mark.parametrize("name", NAMES)
def test_every_mapper_learns_predicts_and_survives_storage(name: str) -> None:
    y, z = pairs()
    new_y, new_z = pairs(25, seed=1)
    mapper = fit(name, y, z)
    assert mapper.name == name
    mapped = mapper.predict(new_y)
    assert mapped.mean.shape == new_z.shape
    assert mapped.variance.shape == (25,)
    assert np.sqrt(np.mean((mapped.mean - new_z) ** 2)) < 0.7 * z.std()
    arrays = mapper.to_arrays()
    assert all(isinstance(a, np.ndarray) and a.dtype != object for a in arrays.values())
    np.testing.assert_allclose(from_arrays(arrays).predict(new_y).mean, mapped.mean, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_bad_input_is_named(name: str) -> None:
    y, z = pairs(5)
    with pytest.raises(InputError, match="at least two"):
        fit(name, y[:1], z[:1])
    with pytest.raises(InputError, match="one row each"):
        fit(name, y, z[:4])
    with pytest.raises(InputError, match="not finite"):
        fit(name, np.where(y == y[0, 0], np.nan, y), z)
    frames = y.copy()
    frames[3, 1] = np.inf
    with pytest.raises(InputError, match="frame 3: features are not finite"):
        fit(name, y, z).predict(frames)
    with pytest.raises(InputError, match=r"\(T, 12\)"):
        fit(name, y, z).predict(y[:, :3])


def test_unknown_names() -> None:
    y, z = pairs(5)
    with pytest.raises(UsageError, match="sgplvm, gp, ridge, pca, nn3, nn10"):
        fit("magic", y, z)
    with pytest.raises(InputError, match="not a learned mapper"):
        from_arrays({"mapper": np.array("magic")})
    with pytest.raises(InputError, match="lacks the array"):
        from_arrays({"mapper": np.array("gp")})


def test_gp_gradient_value_and_posterior() -> None:
    rng = np.random.default_rng(1)
    y, z = rng.normal(size=(9, 4)), rng.normal(size=(9, 3))
    squared, inner = squared_distances(y, y), y @ y.T
    logs = np.array([0.3, -1.0, -2.0, -3.0, -0.5])
    value, gradient = marginal(logs, squared, inner, z @ z.T, 3)
    numeric = approx_fprime(logs, lambda v: marginal(v, squared, inner, z @ z.T, 3)[0], 1e-6)
    np.testing.assert_allclose(gradient, numeric, rtol=1e-4)
    gram = Kernel.from_logs(logs).gram(squared, inner)
    density = -sum(multivariate_normal(cov=gram).logpdf(column) for column in z.T)
    assert value + 0.5 * 27 * np.log(2 * np.pi) == pytest.approx(density, rel=1e-9)
    # posterior against the conditional of one joint Gaussian
    kernel, new = Kernel.from_logs(logs), rng.normal(size=(1, 4))
    every = np.concatenate([y, new])
    joint = kernel.gram(squared_distances(every, every), every @ every.T)
    mean, variance = Posterior.of(kernel, y, z).at(new)
    solved = np.linalg.solve(joint[:9, :9], joint[:9, 9])
    np.testing.assert_allclose(mean[0], solved @ z, rtol=1e-9)
    assert variance[0] == pytest.approx(joint[9, 9] - solved @ joint[:9, 9], rel=1e-9)


def test_gp_knows_where_it_does_not_know() -> None:
    y, z = pairs()
    mapper = fit_gp(y, z)
    near, far = mapper.predict(y).variance, mapper.predict(y + 20.0).variance
    assert far.min() > 10 * near.max()


def test_nearest_of_a_key_pose_is_itself() -> None:
    y, z = pairs()
    np.testing.assert_allclose(fit("nn3", y, z).predict(y).mean, z, atol=1e-5)


def test_pca_is_exact_on_a_linear_map() -> None:
    y, _ = pairs()
    z = y @ np.random.default_rng(2).normal(size=(12, 5)) + 3.0
    new = pairs(10, seed=5)[0]
    expected = new @ np.random.default_rng(2).normal(size=(12, 5)) + 3.0
    np.testing.assert_allclose(fit("pca", y, z).predict(new).mean, expected, atol=1e-6)


@pytest.mark.parametrize("name", ["gp", "sgplvm"])
def test_beyond_the_key_poses_the_map_goes_on(name: str) -> None:
    """Twice as far as any key pose a linear map is still followed, where the paper's falls back."""
    rng = np.random.default_rng(4)
    hidden = rng.normal(size=(40, 3))
    to_y, to_z = rng.normal(size=(3, 12)), rng.normal(size=(3, 9))
    mapper = fit(name, hidden @ to_y, hidden @ to_z, dims=5)
    far = 2.0 * hidden[:8]
    miss = mapper.predict(far @ to_y).mean - far @ to_z
    assert np.sqrt(np.mean(miss**2)) < 0.15 * np.sqrt(np.mean((far @ to_z) ** 2))


def test_ridge_holds_back_what_does_not_repeat() -> None:
    """Noise of the key poses is not learned: nearer to the truth than the plain linear map."""
    rng = np.random.default_rng(5)
    y = rng.normal(size=(30, 24))
    true = rng.normal(size=(24, 6)) * np.array([1.0] * 3 + [0.0] * 21)[:, None]
    mapper = fit("ridge", y, y @ true + 0.5 * rng.normal(size=(30, 6)))
    plain = fit("pca", y, y @ true + 0.5 * rng.normal(size=(30, 6)))
    new = rng.normal(size=(200, 24))
    errors = [np.sqrt(np.mean((m.predict(new).mean - new @ true) ** 2)) for m in (mapper, plain)]
    assert errors[0] < 0.9 * errors[1]
    again = from_arrays(mapper.to_arrays())
    assert again.name == "ridge"
    np.testing.assert_array_equal(again.predict(new).mean, mapper.predict(new).mean)


def test_leave_out_by_pose_and_by_group() -> None:
    y, z = pairs(20)
    by_pose = leave_out("gp", y, z)
    assert by_pose.seen < by_pose.unseen_rms < z.std()
    assert 0.5 < by_pose.inside <= 1.0
    by_group = leave_out("nn3", y, z, groups=["a"] * 10 + ["b"] * 10)
    assert by_group.unseen.shape == (20,)
    assert np.isnan(by_group.inside)


def test_batched_minimiser_solves_rosenbrock_from_many_starts() -> None:
    def rosenbrock(x: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = x.T
        scale = 1.0 + rows
        value = (1 - a) ** 2 + scale * (b - a**2) ** 2
        by_b = 2 * scale * (b - a**2)
        return value, np.stack([-2 * (1 - a) - 2 * a * by_b, by_b], axis=1)

    start = np.random.default_rng(0).normal(size=(50, 2))
    found = minimise(rosenbrock, start, iterations=300, decrease=0.0, tolerance=1e-8)
    np.testing.assert_allclose(found.x, 1.0, atol=1e-4)
    alone = minimise(rosenbrock, start[:1], iterations=300, decrease=0.0, tolerance=1e-8)
    np.testing.assert_array_equal(alone.x[0], found.x[0])
