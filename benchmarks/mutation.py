"""Would a test notice? Constants doubled and halved, branches dropped, one at a time.

    python -m benchmarks.mutation [--seed 0] [--count 40] [--only support] [--list]

Works on a copy of the package in a temporary folder. A mutant is caught when a test fails or the
time runs out; what survives is printed with its line, to be tested or deleted. A mutant that
changes nothing (a branch that only saves time) survives rightly: read before counting.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("physretarget/ground", "physretarget/validation")
TESTS = (
    "tests/ground", "tests/validation/test_rules.py", "tests/validation/test_physics.py",
    "tests/validation/test_stance.py", "tests/validation/test_continuity.py",
    "tests/validation/test_least_torque.py", "tests/validation/test_causes.py",
    "tests/validation", "tests/simulation",
)  # fmt: skip
"""The quick ones first: most mutants need no others."""
LEFT_OUT = ("tests/validation/test_command.py",)
"""Tests of the command line: slow, and they state no physics."""
BESIDE = ("tests", "models", "benchmarks", "docs", "pyproject.toml", "constraints.txt", "README.md")


@dataclass(frozen=True)
class Mutant:
    """One change: ``old`` at a place becomes ``new``. Offsets are in bytes of the file."""

    path: str
    line: int
    start: int
    end: int
    new: str
    what: str

    def apply(self, text: bytes) -> bytes:
        return text[: self.start] + self.new.encode() + text[self.end :]


def mutants(path: Path, name: str) -> Iterator[Mutant]:
    """All mutants of a module.

    Numbers: those of module-level statements and the fractions anywhere, but 0; doubled and
    halved. Branches: every ``if`` never taken, but those that guard imports or raise.
    """
    text = path.read_bytes()
    offsets = [0]
    for line in text.splitlines(keepends=True):
        offsets.append(offsets[-1] + len(line))
    tree = ast.parse(text)

    def mutant(node: ast.expr, new: str, what: str) -> Mutant:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = offsets[node.lineno - 1] + node.col_offset
        end = offsets[node.end_lineno - 1] + node.end_col_offset
        return Mutant(name, node.lineno, start, end, new, what)

    for node, inside in _walk(tree):
        if isinstance(node, ast.Constant):
            value = node.value
            if isinstance(value, bool) or not isinstance(value, int | float) or value == 0:
                continue
            if inside and isinstance(value, int):
                continue
            half = value // 2 if isinstance(value, int) else value / 2
            yield mutant(node, repr(2 * value), f"{value!r} doubled")
            yield mutant(node, repr(half), f"{value!r} halved")
        if isinstance(node, ast.If) and not _guards(node):
            yield mutant(node.test, "False", f"branch dropped: if {ast.unparse(node.test)}")


def _walk(tree: ast.Module) -> Iterator[tuple[ast.AST, bool]]:
    """Every node and whether it stands in a function."""

    def below(node: ast.AST, inside: bool) -> Iterator[tuple[ast.AST, bool]]:
        yield node, inside
        inside = inside or isinstance(node, ast.FunctionDef | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            yield from below(child, inside)

    return below(tree, False)


def _guards(node: ast.If) -> bool:
    """Whether it only refuses input or guards imports: nothing about physics."""
    first = node.body[0]
    return isinstance(first, ast.Raise | ast.Import | ast.ImportFrom)


def all_mutants(only: str = "") -> list[Mutant]:
    found: list[Mutant] = []
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if only in name:
                found += mutants(path, name)
    return found


def caught(mutant: Mutant, folder: Path, tests: Sequence[str], limit: float) -> bool:
    """Run the tests on the copy with this one change in it."""
    target = folder / mutant.path
    original = target.read_bytes()
    target.write_bytes(mutant.apply(original))
    try:
        return not passes(folder, tests, limit)
    finally:
        target.write_bytes(original)


def passes(folder: Path, tests: Sequence[str], limit: float) -> bool:
    """Whether the tests pass in that folder within the time (s)."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *tests]
    command += [f"--deselect={t}" for t in LEFT_OUT]
    env = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    if "PHYSRETARGET_DATA" not in env:
        env["PHYSRETARGET_DATA"] = str(ROOT.parent / "shared" / "data")
    try:
        done = subprocess.run(command, cwd=folder, env=env, timeout=limit, capture_output=True)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def copied(folder: Path) -> None:
    """The package as a copy, everything beside it as links."""
    ignore = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "physretarget", folder / "physretarget", ignore=ignore)
    for name in BESIDE:
        if (ROOT / name).exists():
            (folder / name).symlink_to(ROOT / name)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--only", default="", help="a part of the paths of files to change")
    parser.add_argument("--tests", nargs="*", default=[t for t in TESTS if (ROOT / t).exists()])
    parser.add_argument("--list", action="store_true", help="print the sample, run nothing")
    given = parser.parse_args()
    everything = all_mutants(given.only)
    sample = random.Random(given.seed).sample(everything, min(given.count, len(everything)))
    print(f"{len(sample)} of {len(everything)} mutants")
    if given.list:
        for m in sample:
            print(f"{m.path}:{m.line}: {m.what}")
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        copied(folder)
        began = time.monotonic()
        if not passes(folder, given.tests, 600):
            sys.exit("the tests fail without any change: nothing can be said.")
        limit = 3 * (time.monotonic() - began) + 10
        survivors = []
        for number, m in enumerate(sample, 1):
            found = caught(m, folder, given.tests, limit)
            print(f"{number:3d} {'caught  ' if found else 'SURVIVED'} {m.path}:{m.line}: {m.what}",
                  flush=True)  # fmt: skip
            if not found:
                survivors.append(m)
    share = 1 - len(survivors) / max(len(sample), 1)
    print(f"{share:.0%} of {len(sample)} caught (seed {given.seed})")


if __name__ == "__main__":
    main()
