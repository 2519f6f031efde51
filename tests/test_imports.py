"""Who may import whom, and the names that scripts outside rely on."""

from __future__ import annotations

import ast
import graphlib
import importlib
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

PUBLIC = {
    "physretarget": [
        "__version__", "ActorMotion", "Character", "Clip", "Report", "RetargetSettings",
        "Retargeted", "Settings", "TrainedMapper", "convert", "forces", "learn", "load_capture",
        "load_clip", "load_keyposes", "retarget", "validate",
    ],
    "physretarget.errors": [
        "PhysretargetError", "InputError", "UnsafeInputError", "UsageError", "MissingExtraError",
        "SolverError",
    ],
    "physretarget.kinematics": ["Tree", "forward", "points", "jacobian", "integrate", "solve"],
    "physretarget.capture": ["load", "read", "READERS", "find_reader"],
    "physretarget.capture.actor": ["ActorMotion", "ActorShape", "SEGMENTS", "REFERENCE_ACTOR"],
    "physretarget.clip": ["Clip", "load_clip"],
    "physretarget.conversion": ["convert"],
    "physretarget.mjcf": ["Character", "actor_character", "derivatives", "required_wrench"],
    "physretarget.features": ["features", "local_frame"],
    "physretarget.keyposes": ["load_keyposes", "check", "sheet", "training_pairs"],
    "physretarget.kinetics": ["forces", "GroundForces", "FootForce", "ground_wrench"],
    "physretarget.mapping": ["fit", "from_arrays", "NAMES", "Mapper", "Mapped"],
    "physretarget.trained": ["TrainedMapper", "learn"],
    "physretarget.ik": ["solve"],
    "physretarget.momentum": ["place"],
    "physretarget.contact": ["Phases", "detect_phases", "read_phases", "write_phases", "adjust"],
    "physretarget.ocp": ["optimise", "RootHeightSettings", "PRESETS"],
    "physretarget.pipeline": ["retarget", "RetargetSettings", "Retargeted", "STAGES"],
    "physretarget.validation": ["validate", "Report", "Settings", "RULES"],
}  # fmt: skip


@pytest.mark.parametrize("module", PUBLIC)
def test_public_names(module: str) -> None:
    found = importlib.import_module(module)
    assert [name for name in PUBLIC[module] if not hasattr(found, name)] == []


def test_import_contracts_are_kept() -> None:
    program = shutil.which("lint-imports", path=str(Path(sys.executable).parent))
    if program is None:
        pytest.skip("import-linter is not installed: it comes with the extra 'test'")
    done = subprocess.run(
        [program, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def _imports() -> dict[str, set[str]]:
    """Every module of the package, and those that it imports anywhere: at the top, within
    functions, for type checkers."""
    files = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in (ROOT / "physretarget").rglob("*.py")
    }
    found: dict[str, set[str]] = {name: set() for name in files}
    for name, path in files.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path} has a relative import"
                for alias in node.names:
                    inner = f"{node.module}.{alias.name}"
                    found[name].add(inner if inner in files else str(node.module))
    return {name: (others & files.keys()) - {name} for name, others in found.items()}


def test_no_module_imports_itself_by_way_of_others() -> None:
    imports = _imports()
    assert "physretarget.kinematics" in imports["physretarget.validation.standing"]
    assert "physretarget.mapping" in imports["physretarget.mapping.compare"], "within a function"
    assert "physretarget.mjcf" in imports["physretarget.features"], "for type checkers"
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_the_library_starts_without_its_heavy_parts() -> None:
    """What a user of the readers alone pays: no MuJoCo, no CasADi, no drawing."""
    code = (
        "import sys, physretarget.capture, physretarget.clip, physretarget.mapping\n"
        "print([m for m in ('mujoco', 'casadi', 'matplotlib', 'typer') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_public_names_stay_what_they_are() -> None:
    """A room of the same name, once imported, would take the place of a function."""
    import importlib
    import pkgutil

    import physretarget

    rooms = {each.name for each in pkgutil.iter_modules(physretarget.__path__)}
    public = set(physretarget.__all__)
    assert not public & rooms
    for name in public:
        first = getattr(physretarget, name)
        importlib.invalidate_caches()
        assert getattr(physretarget, name) is first
