"""Inputs that once broke a reader, in ``broke/<reader>/``; found by fuzzing, see fuzz/README.md."""

from __future__ import annotations

import importlib.util
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

from physretarget.errors import PhysretargetError

HERE = Path(__file__).parent
INPUTS = sorted(path for path in (HERE / "broke").rglob("*") if path.is_file())


@pytest.fixture(scope="session")
def targets() -> ModuleType:
    pytest.importorskip("ezc3d")
    path = HERE.parents[1] / "fuzz" / "targets.py"
    spec = importlib.util.spec_from_file_location("fuzz_targets", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", INPUTS, ids=lambda p: f"{p.parent.name}-{p.name}")
def test_what_once_broke_a_reader_is_read_or_refused(path: Path, targets: ModuleType) -> None:
    resource = pytest.importorskip("resource")
    unit = 1 if sys.platform == "darwin" else 1024
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
    start = time.process_time()
    error = targets.try_input(path.parent.name, path.read_bytes())
    assert error is None or (isinstance(error, PhysretargetError) and "\n" not in str(error))
    assert time.process_time() - start < 5
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit - before < 300e6


@pytest.mark.parametrize("target", ["npz", "npy", "csv", "pkl", "config", "baseline", "bvh", "mot"])
def test_a_fuzzers_function_tells_an_error_from_a_fault(target: str, targets: ModuleType) -> None:
    assert isinstance(targets.try_input(target, b"\x00no such thing"), PhysretargetError)
    with pytest.raises(KeyError):
        targets.try_input("no reader", b"")
