"""The mutation runner changes what it says it changes, and sees what tests see."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.mutation import Mutant, caught, mutants, passes

MODULE = '''"""Doc with 3 in it."""
LIMIT = 0.5  # of µ
COUNT = 4
ZERO = 0


def over(value: float, spare: float = 0.0) -> bool:
    """Whether 2 is above 1."""
    if value < 0:
        raise ValueError("negative")
    if spare > 0:
        value -= spare
    return value > LIMIT
'''


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "small_module.py").write_text(MODULE, encoding="utf-8")
    (tmp_path / "test_small.py").write_text(
        "from small_module import over\n"
        "def test_limit():\n"
        "    assert over(0.6) and not over(0.4)\n",
        encoding="utf-8",
    )
    return tmp_path


def made(folder: Path) -> list[Mutant]:
    return list(mutants(folder / "small_module.py", "small_module.py"))


def test_constants_are_doubled_and_halved_and_branches_dropped(folder: Path) -> None:
    assert [m.what for m in made(folder)] == [
        "0.5 doubled", "0.5 halved", "4 doubled", "4 halved", "branch dropped: if spare > 0",
    ]  # fmt: skip
    text = MODULE.encode()
    changed = {m.what: m.apply(text).decode() for m in made(folder)}
    assert "LIMIT = 1.0  # of µ" in changed["0.5 doubled"]
    assert "COUNT = 2\n" in changed["4 halved"]
    assert "if False:\n        value -= spare" in changed["branch dropped: if spare > 0"]
    for after in changed.values():
        compile(after, "changed", "exec")


def test_what_no_test_notices_survives(folder: Path) -> None:
    assert passes(folder, ["test_small.py"], 60)
    found = {m.what: caught(m, folder, ["test_small.py"], 60) for m in made(folder)}
    assert found == {
        "0.5 doubled": True, "0.5 halved": True, "4 doubled": False, "4 halved": False,
        "branch dropped: if spare > 0": False,
    }  # fmt: skip
    assert (folder / "small_module.py").read_text(encoding="utf-8") == MODULE
