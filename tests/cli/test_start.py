"""The program starts at once: a command is imported when it is asked for, and no other."""

from __future__ import annotations

import inspect
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer
import typer.main

from physretarget.cli import COMMANDS, app

HEAVY = ("mujoco", "casadi", "scipy", "numpy", "matplotlib", "fastapi", "sqlalchemy")
PROGRAM = [sys.executable, "-m", "physretarget"]


def _seconds(command: list[str]) -> float:
    """User time of a process, the least of three: others work on this machine too."""
    spent = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        subprocess.run(command, check=True, capture_output=True)
        spent.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before)
    return min(spent)


def test_help_takes_less_than_a_third_of_a_second() -> None:
    assert _seconds([*PROGRAM, "--help"]) < 0.3


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["suite", "--help"]])
def test_what_needs_no_solver_imports_none(arguments: list[str]) -> None:
    code = (
        "import sys\n"
        "from physretarget.cli import main\n"
        f"sys.argv = ['physretarget', *{arguments!r}]\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.strip() == "[]"


def test_importing_the_program_reads_no_arguments() -> None:
    """A program that imports ours gets the same commands whatever it is called with."""
    code = (
        "import sys\n"
        "sys.argv = ['physretarget', 'suite']\n"
        "import typer\n"
        "from physretarget.cli import app\n"
        "group = typer.main.get_command(app)\n"
        "print(group.load('rules').name)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "rules"


@pytest.mark.parametrize("name", COMMANDS)
def test_the_line_in_the_programs_help_is_the_commands_own(name: str) -> None:
    group: Any = typer.main.get_command(app)
    command = group.load(name)
    assert inspect.cleandoc(command.help).splitlines()[0] == COMMANDS[name][1]


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("physretarget re", {"retarget", "replay", "reproduce", "restore"}),
        ("physretarget validate --jo", {"--joint-order", "--jobs"}),
        ("physretarget validate --profile ro", {"robot"}),
        ("physretarget keyposes s", {"suggest", "sheet"}),
        ("physretarget retarget --until p", {"placed", "physical"}),
    ],
)
def test_tab_completes_commands_options_and_words(typed: str, expected: set[str]) -> None:
    environment = os.environ | {
        "_PHYSRETARGET_COMPLETE": "complete_bash",
        "COMP_WORDS": typed,
        "COMP_CWORD": str(len(typed.split()) - 1),
    }
    script = Path(sys.executable).parent / "physretarget"
    if not script.exists():
        pytest.skip("the program is not installed beside this Python")
    done = subprocess.run([script], env=environment, capture_output=True, text=True, check=False)
    assert set(done.stdout.split()) == expected
