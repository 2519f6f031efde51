from __future__ import annotations

import numpy as np
import pytest

from physretarget import kinematics
from physretarget.demo import models_folder
from physretarget.ground.wrench import external_wrench
from physretarget.mjcf import Character
from physretarget.wholebody.wrench import wrench_slopes

BALL = """<mujoco><worldbody><body><freejoint/><geom size=".1" mass="1"/>
<body pos="0 0 .3"><joint type="ball" pos="0 0 -.1"/><geom type="capsule" size=".03 .1" mass=".5"/>
<body pos=".1 0 .2"><joint type="slide" axis="1 .2 0"/>
<joint type="hinge" axis="0 1 0" pos=".05 0 0"/>
<geom type="box" size=".1 .05 .02" mass=".7"/></body></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize("name", ["ball", "lamp", "penguin"])
@pytest.mark.parametrize("size", [0.02, 0.5])
def test_slopes_are_derivatives_of_the_wrench(name: str, size: float) -> None:
    """For turns of a degree and of half a radian between frames."""
    character = (
        Character.from_xml(BALL)
        if name == "ball"
        else Character.load(models_folder() / f"{name}.xml")
    )
    rng, tree, step = np.random.default_rng(0), character.tree, 1 / 60
    start = np.tile(character.reference_qpos, (6, 1))
    qpos = kinematics.integrate(tree, start, rng.normal(0, size, (6, tree.nv)))
    change, eps = rng.normal(size=(6, tree.nv)), 1e-6

    def wrench(moved):
        found = external_wrench(character, kinematics.forward(tree, moved), step)
        return np.concatenate([found.force, found.moment], axis=1), found.com

    ahead, behind = (wrench(kinematics.integrate(tree, qpos, s * eps * change)) for s in (1, -1))
    twin, shift = ((a - b) / (2 * eps) for a, b in zip(ahead, behind, strict=True))
    slopes = wrench_slopes(character, qpos, kinematics.forward(tree, qpos), step)
    found = sum(
        np.einsum("tki,ti->tk", part, change[k : k + 4])
        for k, part in enumerate((slopes.behind, slopes.here, slopes.ahead))
    )
    assert found == pytest.approx(twin[1:-1], rel=1e-5, abs=1e-6 * np.abs(twin).max())
    moved = np.einsum("tki,ti->tk", slopes.shift, change) * character.com_height
    assert moved == pytest.approx(shift, abs=1e-8)
