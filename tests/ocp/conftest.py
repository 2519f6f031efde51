"""A box on four contact points that hops with wrong flights: the smallest thing to mend."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from physretarget.mjcf import Character

XML = """<mujoco model="hopper"><option gravity="0 0 -9.81"/><worldbody>
<geom name="floor" type="plane" size="5 5 .1" friction="0.8"/>
<body name="box" pos="0 0 0.25"><freejoint/>
<geom type="box" size=".12 .1 .05" pos="0 0 -.2" mass="2"/>
<geom type="box" size=".05 .05 .2" pos=".03 .01 .05" mass="1"/>
<site name="contact_a" pos=".12 .1 -.25"/><site name="contact_b" pos=".12 -.1 -.25"/>
<site name="contact_c" pos="-.12 .1 -.25"/><site name="contact_d" pos="-.12 -.1 -.25"/>
</body></worldbody></mujoco>"""


@pytest.fixture
def hopper() -> Callable[[], Character]:
    return lambda: Character.from_xml(XML)


@pytest.fixture
def hops() -> Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]:
    return _hops


def _hops(
    seconds: float = 4.0, fps: float = 30.0, seed: int = 0, noise: float = 0.001
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """qpos (T, 7), time (T,), active (T, 4): hops of 0.2 to 0.3 s that rise too little or much."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * fps)) / fps
    height = np.zeros(time.size)
    active = np.ones((time.size, 4), dtype=bool)
    start = 0.5
    while start < seconds - 0.8:
        duration = rng.uniform(0.2, 0.3)
        apex = rng.uniform(0.5, 1.3) * 9.81 * duration**2 / 8
        flying = (time > start) & (time < start + duration)
        u = (time[flying] - start) / duration
        height[flying] = 4 * apex * u * (1 - u)
        active[flying] = False
        start += duration + rng.uniform(0.4, 0.8)
    height += noise * gaussian_filter1d(rng.normal(size=time.size), 2)
    qpos = np.zeros((time.size, 7))
    qpos[:, 3] = 1.0
    qpos[:, 2] = 0.25 + height
    qpos[:, 0] = 0.1 * time
    return qpos, time, active
