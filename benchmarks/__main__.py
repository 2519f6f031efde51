"""Run the benchmarks side by side and write docs/measured/performance.md.

    python -m benchmarks [--other PYTHON] [--out docs/measured/performance.md]

PYTHON is an interpreter of an environment with GPy and scikit-learn
(`python -m venv E && E/bin/pip install GPy scikit-learn`); without it their rows are left out.
Benchmarks that need captures which are not here say so.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import importlib
import io
import os
import platform
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import mujoco
import numpy
import scipy

from benchmarks import pipeline
from benchmarks.row import markdown

PRINTING = {
    "mapping": "Mappers: speed and errors",
    "ik_contact": "Inverse kinematics and contact",
    "root_height": "Root height beside scipy's least_squares",
    "validate": "Validation beside the bare mj_inverse loop",
    "sampling": "Simulation: iLQR beside cross-entropy over servo targets",
}


def machine() -> str:
    """Processor, cores, and the versions that matter."""
    model = platform.processor() or platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next((t.split(":")[1].strip() for t in lines if t.startswith("model name")), model)
    return (
        f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}, NumPy "
        f"{numpy.__version__}, SciPy {scipy.__version__}, MuJoCo {mujoco.__version__}, CasADi "
        f"{version('casadi')}"
    )


def printed(name: str, arguments: Sequence[str]) -> str:
    """What a benchmark prints that tells its results in lines."""
    sys.argv = [f"benchmarks.{name}", *arguments]
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        importlib.import_module(f"benchmarks.{name}").main()
    return told.getvalue().strip()


def page(other: str | None) -> str:
    load = os.getloadavg()[0]
    rows = pipeline.run(other)
    parts = [
        "# Performance",
        "",
        f"Made by `python -m benchmarks` on {datetime.date.today():%Y-%m-%d}: {machine()}. One "
        f"thread; processor time, best of a few runs; load average at the start {load:.1f}.",
        "",
        markdown(rows),
    ]
    for name, title in PRINTING.items():
        arguments = ["--long", "0"] if name == "root_height" else []
        lines = printed(name, arguments)
        parts += ["", f"## {title}", "", f"`python -m benchmarks.{name}`", "", "```", lines, "```"]
    return "\n".join(parts) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--other", help="interpreter of an environment with GPy, scikit-learn")
    parser.add_argument("--out", type=Path, default=Path("docs/measured/performance.md"))
    options = parser.parse_args()
    text = page(options.other)
    options.out.write_text(text, encoding="utf-8")
    print(f"{options.out} written.")


if __name__ == "__main__":
    main()
