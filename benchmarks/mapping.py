"""Learning and mapping: speed, and errors of all mappers on the lamp's key poses.

    python benchmarks/mapping.py [--other PYTHON]

PYTHON is an interpreter of another environment with GPy and scikit-learn, which then run on the
same key poses in the same run (`python -m venv E && E/bin/pip install GPy scikit-learn`).
"""

from __future__ import annotations

import argparse
import itertools
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from physretarget import keyposes, mapping
from physretarget.mapping.compare import leave_out
from physretarget.mjcf import Character

MODELS = Path(__file__).resolve().parents[1] / "models"

OTHERS = """
import sys, time, warnings
import numpy as np
warnings.simplefilter("ignore")
data = np.load(sys.argv[1])
y, z = data["y"], data["z"]
ny, nz = (y - y.mean(0)) / (y - y.mean(0)).std(), (z - z.mean(0)) / (z - z.mean(0)).std()
try:
    import GPy
    from GPy.models import MRD
    np.random.seed(0)
    model = MRD([ny, nz], input_dim=min(30, len(y) - 1), num_inducing=len(y))
    began = time.perf_counter()
    model.optimize(max_iters=300)
    print(f"GPy {GPy.__version__} MRD, 300 iterations: {time.perf_counter() - began:.2f} s")
except Exception as error:
    print(f"GPy MRD does not run here: {error!r}"[:300])
try:
    import sklearn
    from sklearn.gaussian_process import GaussianProcessRegressor as Regressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    wide = (1e-6, 1e6)
    kernel = ConstantKernel(1.0, wide) * RBF(10.0, wide) + WhiteKernel(1e-4, (1e-6, 1e-3))
    began = time.perf_counter()
    gp = Regressor(kernel, n_restarts_optimizer=2, random_state=0).fit(ny, nz)
    spent = time.perf_counter() - began
    misses = []
    for i in range(len(y)):
        keep = np.arange(len(y)) != i
        one = Regressor(gp.kernel_, optimizer=None).fit(ny[keep], nz[keep])
        misses.append(one.predict(ny[i:i + 1])[0] - nz[i])
    rms = np.sqrt(np.mean(np.square(misses))) * (z - z.mean(0)).std()
    print(f"scikit-learn {sklearn.__version__} GP: fit {spent:.2f} s, unseen {1000 * rms:.1f} mm"
          " (kernel fitted with all key poses)")
except Exception as error:
    print(f"scikit-learn does not run here: {error!r}"[:300])
"""


def best_of(count: int, work: Callable[[], object]) -> float:
    """Least wall time of several runs, seconds."""
    spent = []
    for _ in range(count):
        began = time.perf_counter()
        work()
        spent.append(time.perf_counter() - began)
    return min(spent)


def frames_between(y: np.ndarray, steps: int) -> np.ndarray:
    """A made-up performance: from key pose to key pose along smooth blends (T, DY)."""
    share = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, steps, endpoint=False))
    legs = [a + share[:, None] * (b - a) for a, b in itertools.pairwise(y)]
    return np.concatenate(legs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--other", help="interpreter of an environment with GPy, scikit-learn")
    options = parser.parse_args()
    lamp = Character.load(MODELS / "lamp.xml")
    y, z = keyposes.training_pairs(keyposes.load(MODELS / "lamp.keyposes.toml", lamp), lamp)
    y, z = y[:30], z[:30]
    print(f"{len(y)} key poses, {y.shape[1]} actor and {z.shape[1]} character features")
    for dims, iterations in ((30, 70), (30, 300), (15, 70), (2, 70)):
        spent = best_of(
            3, lambda d=dims, i=iterations: mapping.fit("sgplvm", y, z, dims=d, iterations=i)
        )
        print(f"learn sgplvm, {dims} dimensions, {iterations} iterations: {spent:.3f} s")
    frames = frames_between(y, 31)
    for name in mapping.NAMES:
        mapper = mapping.fit(name, y, z)
        spent = best_of(3, lambda m=mapper: m.predict(frames))
        one = best_of(20, lambda m=mapper: m.predict(frames[:1]))
        print(
            f"map {name}: {len(frames) / spent:.0f} frames/s, "
            f"{len(frames) / spent / 30:.0f} x real time at 30 fps; one frame {1000 * one:.2f} ms"
        )
    for name in mapping.NAMES:
        found = leave_out(name, y, z)
        print(
            f"{name}: seen key poses {1000 * found.seen:.2f} mm "
            f"({found.seen / lamp.height:.2%} of the height), unseen "
            f"{1000 * found.unseen_rms:.1f} mm, within 2 sigma {found.inside:.0%}"
        )
    if options.other:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "pairs.npz"
            np.savez(path, y=y, z=z)
            subprocess.run([options.other, "-c", OTHERS, str(path)], check=True)


if __name__ == "__main__":
    main()
