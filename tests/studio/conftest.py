from __future__ import annotations

from pathlib import Path

import pytest

from physretarget import capture
from physretarget.demo import models_folder
from physretarget.mjcf import Character
from physretarget.studio import Session, Take


@pytest.fixture(scope="session")
def penguin() -> Character:
    return Character.load(models_folder() / "penguin.xml")


@pytest.fixture(scope="session")
def takes(motions: Path) -> tuple[Take, ...]:
    """A walk and a jump."""
    names = ("humanoid3d_walk.txt", "humanoid3d_jump.txt")
    return tuple(Take.of(capture.load(motions / name)) for name in names)


@pytest.fixture
def session(penguin: Character, takes: tuple[Take, ...], tmp_path: Path) -> Session:
    """Two captures, and no file yet."""
    return Session(penguin, tmp_path / "mine.keyposes.toml", takes)
