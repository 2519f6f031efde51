"""Root height: ours beside scipy's least_squares (the paper's lsqnonlin) on the same residuals.

    python benchmarks/root_height.py [--seconds 30] [--long 600] [CLIP.npz ...]

Without clips a box hops with wrong flights. CLIPs are arrays qpos, time, active of the lamp after
contact adjustment.
"""

from __future__ import annotations

import argparse
import resource
import time as clock
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares

from physretarget.mjcf import Character
from physretarget.ocp import PRESETS, RootHeight, RootHeightSettings, optimise
from physretarget.ocp.basis import gaussian_basis, sparse_of
from physretarget.ocp.problem import build
from physretarget.ocp.scene import scene_of

MODELS = Path(__file__).resolve().parents[1] / "models"

HOPPER = """<mujoco model="hopper"><option gravity="0 0 -9.81"/><worldbody>
<geom name="floor" type="plane" size="5 5 .1" friction="0.8"/>
<body name="box" pos="0 0 0.25"><freejoint/>
<geom type="box" size=".12 .1 .05" pos="0 0 -.2" mass="2"/>
<geom type="box" size=".05 .05 .2" pos="0 0 .05" mass="1"/>
<site name="contact_a" pos=".12 .1 -.25"/><site name="contact_b" pos=".12 -.1 -.25"/>
<site name="contact_c" pos="-.12 .1 -.25"/><site name="contact_d" pos="-.12 -.1 -.25"/>
</body></worldbody></mujoco>"""

Clip = tuple[np.ndarray, np.ndarray, np.ndarray]


def hops(seconds: float, fps: float = 30.0) -> Clip:
    """A box that hops: flights of 0.2 to 0.3 s, risen 0.5 to 1.3 times as high as they should."""
    rng = np.random.default_rng(0)
    time = np.arange(round(seconds * fps)) / fps
    height, active = np.zeros(time.size), np.ones((time.size, 4), dtype=bool)
    start = 0.5
    while start < seconds - 0.8:
        duration = rng.uniform(0.2, 0.3)
        flying = (time > start) & (time < start + duration)
        u = (time[flying] - start) / duration
        height[flying] = rng.uniform(0.5, 1.3) * 9.81 * duration**2 / 2 * u * (1 - u)
        active[flying] = False
        start += duration + rng.uniform(0.4, 0.8)
    qpos = np.zeros((time.size, 7))
    qpos[:, 3] = 1.0
    qpos[:, 2] = 0.25 + height + 0.001 * gaussian_filter1d(rng.normal(size=time.size), 2)
    return qpos, time, active


def judged(character: Character, clip: Clip, settings: RootHeightSettings | None = None) -> str:
    """Optimise once; the time is that of the processor, whatever else the machine does."""
    began = clock.process_time()
    result = optimise(character, *clip, settings=settings)
    return line(character, result, float(clip[1][-1]), clock.process_time() - began)


def line(character: Character, result: RootHeight, duration: float, spent: float) -> str:
    size, weight = character.height, character.weight
    before, after = result.mismatch_before / weight, result.mismatch_after / weight
    bound = result.bound_rms / weight
    ratio = f"{result.bound_ratio:.1f} x" if bound > 1e-3 else "over 0,"
    lifted = np.abs(result.displacement).max() / size
    return (
        f"mismatch {before:.2f} -> {after:.3f} BW ({result.improvement:.0%} less; "
        f"{ratio} bound {bound:.3f} BW), unsupported {result.pull_before / weight:.2f} -> "
        f"{result.pull_after / weight:.3f} BW, ballistic {result.ballistic_before:.2f} -> "
        f"{result.ballistic_after:.2f} m/s² (vertical {result.ballistic_vertical_before:.2f} -> "
        f"{result.ballistic_vertical_after:.2f}), displaced {lifted:.1%}, affine law off by "
        f"{result.verified:.0e} N, {spent:.2f} s, {duration / spent:.0f} x real time"
    )


def reference(character: Character, clip: Clip) -> str:
    """scipy's trust-region least squares with our exact sparse Jacobian, hardest contact only."""
    qpos, time, active = clip
    settings = RootHeightSettings()
    scene = scene_of(character, qpos, time, active)
    problem, basis = build(scene, settings), gaussian_basis(time, settings.interval)
    operators = [sparse_of(basis, b) for b in (basis.value, basis.rate, basis.curvature)]
    f0 = problem.model.residual

    def residuals(w: np.ndarray) -> np.ndarray:
        return problem.evaluate(basis.motion(w), f0)[0].T.ravel()

    def jacobian(w: np.ndarray) -> sparse.csr_matrix:
        slopes = problem.evaluate(basis.motion(w), f0)[1]
        rows = [
            sum(operators[a].multiply(slopes[:, r, a][:, None]) for a in range(3))
            for r in range(problem.rows)
        ]
        return sparse.csr_matrix(sparse.vstack(rows))

    began = clock.process_time()
    found = least_squares(
        residuals, np.zeros(basis.count), jac=jacobian, method="trf", x_scale="jac", max_nfev=50
    )
    spent = clock.process_time() - began
    displacement, _, acceleration = basis.motion(found.x)
    force = problem.contact_wrench(basis.motion(found.x))[0][:, 2]
    required = scene.force[:, 2] + scene.mass * acceleration
    after = np.sqrt(np.mean((required - force) ** 2)) / character.weight
    lifted = np.abs(displacement).max() / character.height
    return (
        f"mismatch after {after:.3f} BW, cost {found.cost:.3f}, displaced {lifted:.1%}, "
        f"{found.nfev} evaluations, {spent:.2f} s"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--long", type=float, default=600.0, help="0 to leave it out")
    parser.add_argument("clips", nargs="*", type=Path)
    options = parser.parse_args()
    character = Character.from_xml(HOPPER)
    clip = hops(options.seconds)
    for name in PRESETS:
        print(f"hopper, {name}: {judged(character, clip, RootHeightSettings.preset(name))}")
    print(f"hopper, scipy least_squares, cold: {reference(character, clip)}")
    if options.long > 0:
        print(f"hopper, {options.long:.0f} s: {judged(character, hops(options.long))}")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"peak memory {peak:.0f} MB")
    lamp = Character.load(MODELS / "lamp.xml")
    for path in options.clips:
        with np.load(path) as data:
            clip = data["qpos"], data["time"], data["active"]
        print(f"{path.stem}: {judged(lamp, clip)}")


if __name__ == "__main__":
    main()
