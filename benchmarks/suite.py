"""A night of 200 clips: first run, second run, and which changes the report names.

    python -m benchmarks.suite DATA [--clips 200] [--workers 2] [--scheduler local]

DATA has ``robot/*.csv`` with its G1 model and ``bvh/bandai/*.bvh`` (see the tests' data). Clips
are windows of the real ones, each a little different, plus retargets to the lamp; one is then
made worse, one repaired, one removed and one broken.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

MODELS = Path(__file__).parent.parent / "models"
WINDOW = 90  # frames of a clip, 3 s


def make(data: Path, folder: Path, clips: int) -> Path:
    """Write the library and its suite file."""
    sources = sorted((data / "robot").glob("*.csv"))
    captures = sorted((data / "bvh" / "bandai").glob("*.bvh"))
    (folder / "g1").mkdir(parents=True)
    (folder / "captures").mkdir()
    for capture in captures:
        shutil.copy(capture, folder / "captures")
    for k in range(clips - len(captures)):
        qpos = np.loadtxt(sources[k % len(sources)], delimiter=",")
        start = (k // len(sources) * 7) % max(len(qpos) - WINDOW, 1)
        part = qpos[start : start + WINDOW]
        part[:, 7 + k % 29] += 1e-4 * (k + 1)
        np.savetxt(folder / "g1" / f"{sources[k % len(sources)].stem}_{k:03d}.csv", part,
                   delimiter=",", fmt="%.8f")  # fmt: skip
    model = next((data / "robot").glob("*.xml"))
    suite = folder / "night.toml"
    suite.write_text(
        f'[suite]\nname = "night"\n\n[[case]]\nclips = ["g1/*.csv"]\nmodel = "{model}"\n'
        'profile = "robot"\nfps = 30\nlowpass = 6\nquat = "wxyz"\nowner = "robotics"\n\n'
        f'[[retarget]]\ncaptures = ["captures/*.bvh"]\ncharacter = "{MODELS / "lamp.xml"}"\n'
        f'keyposes = ["{MODELS / "lamp.keyposes.toml"}"]\nowner = "animation"\n'
    )
    return suite


def run(suite: Path, *options: str, command: str = "run") -> tuple[float, int]:
    """Seconds of wall clock of the whole command, and its exit code."""
    started = time.perf_counter()
    code = subprocess.run(
        [sys.executable, "-m", "physretarget", "suite", command, str(suite), *options],
        stdout=subprocess.DEVNULL, check=False,
    ).returncode  # fmt: skip
    return time.perf_counter() - started, code


def change(folder: Path) -> dict[str, str]:
    """One clip worse, one repaired, one removed, one broken: what the report must say."""
    clips = sorted((folder / "g1").glob("*.csv"))
    walks = [c for c in clips if "walk" in c.name]
    worse, removed, broken = walks[1], walks[2], walks[3]
    data = json.loads((folder / "night-report" / "data.json").read_text())
    state = {Path(c["clip"]).name: c["passed"] for c in data["clips"]}
    bad = next(c for c in clips if state[c.name] is False and c not in walks)
    good = next(c for c in clips if state[c.name])
    qpos = np.loadtxt(worse, delimiter=",")
    qpos[:, 2] -= 0.03 * np.linspace(0, 1, len(qpos))
    np.savetxt(worse, qpos, delimiter=",", fmt="%.8f")
    bad.write_text(good.read_text())
    removed.unlink()
    broken.write_text(broken.read_text()[:3000])
    return {
        worse.name: "worse", bad.name: "fixed", removed.name: "missing", broken.name: "errored",
    }  # fmt: skip


def main() -> None:
    """Print seconds, shares and verdicts."""
    parser = argparse.ArgumentParser()
    parser.add_argument("data", type=Path)
    parser.add_argument("--clips", type=int, default=200)
    parser.add_argument("--workers", default="2")
    parser.add_argument("--scheduler")
    told = parser.parse_args()
    options = ["--workers", told.workers]
    options += ["--scheduler", told.scheduler] if told.scheduler else []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "library"
        suite = make(told.data.resolve(), folder, told.clips)
        first, _ = run(suite, *options)
        second, _ = run(suite, *options)
        print(f"first run {first:.1f} s, second {second:.2f} s: {100 * second / first:.1f} %")
        run(suite, command="accept")
        wanted = change(folder)
        seconds, code = run(suite, *options)
        data = json.loads((folder / "night-report" / "data.json").read_text())
        found = {
            Path(c["clip"]).name: c["verdict"] for c in data["clips"] if c["verdict"] != "same"
        }
        print(f"after four changes {seconds:.1f} s, exit code {code}: {found}")
        print("exactly these" if found == wanted else f"WRONG, wanted {wanted}")


if __name__ == "__main__":
    main()
