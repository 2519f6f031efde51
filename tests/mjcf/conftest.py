from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.kinematics import integrate
from physretarget.mjcf import Character


def _models() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "mjcf_models", Path(__file__).parent / "models.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


MODELS = _models()


@pytest.fixture(scope="session")
def hopper() -> Character:
    return Character.from_xml(MODELS.HOPPER)


@pytest.fixture(scope="session")
def fixed_arm() -> Character:
    return Character.from_xml(MODELS.FIXED_ARM, name="arm")


@pytest.fixture(scope="session")
def two_trees() -> Character:
    return Character.from_xml(MODELS.TWO_TREES)


@pytest.fixture(params=["hopper", "fixed_arm", "two_trees"])
def any_character(request: pytest.FixtureRequest) -> Character:
    character = request.getfixturevalue(request.param)
    assert isinstance(character, Character)
    return character


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def smooth_clip():
    """Makes (qpos, time): every dof on a smooth path of its own, large rotations included."""

    def make(
        character: Character, *, seconds: float = 2.0, fps: float = 240.0, seed: int = 3
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        generator = np.random.default_rng(seed)
        time = np.arange(round(seconds * fps)) / fps
        nv = character.model.nv
        amplitude = generator.uniform(0.2, 0.8, nv)
        pulse = generator.uniform(2.0, 6.0, nv)
        phase = generator.uniform(0.0, 6.0, nv)
        step = amplitude * np.sin(pulse * time[:, None] + phase)
        start = np.repeat(character.reference_qpos[None], len(time), axis=0)
        return integrate(character.tree, start, step), time

    return make
