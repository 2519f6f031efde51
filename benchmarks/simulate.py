"""How near simulations come to their clips, and what they cost: one row a clip.

    python -m benchmarks.simulate MODEL.xml CLIP... [--fps F] [--quat wxyz] [--assist] [--seconds S]

Every simulation is replayed by plain MuJoCo before it is told of, and followed by its gains from a
start 5 mm aside, on a floor of the model's friction and on one of 0.8.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.clip import Clip, load_clip
from physretarget.mjcf import Character
from physretarget.options.simulation import SimulationOptions
from physretarget.simulate import Simulation, follow, model_of, replay, settings_of, simulate

HEAD = (
    "| clip | survived | deviation, % of the height | worst | assist, BW | CPU-s per s | "
    "5 mm aside, at the end | and friction 0.8 |\n|---|---|---|---|---|---|---|---|"
)
ASIDE = 0.005
FRICTION = 0.8


def departure(sim: Any, character: Character, friction: float | None) -> float:
    """Distance (m) of the root from the recorded end, started `ASIDE` under the recorded gains."""
    model = model_of(sim, character.path)
    if friction is not None:
        model.geom_friction[:, 0] = np.minimum(model.geom_friction[:, 0], friction)
    start = np.array(sim["sim_qpos0"])
    root = slice(character.root_qpos, character.root_qpos + 3)
    start[character.root_qpos] += ASIDE
    end: NDArray[np.float64] = follow(sim, model, start, sim["sim_qvel0"])[-1]
    return float(np.linalg.norm(end[root] - sim["qpos"][-1][root]))


def row(name: str, played: Simulation, character: Character) -> str:
    """One simulation as a row of the table."""
    measures = played.measures
    with tempfile.TemporaryDirectory() as folder:
        played.save(Path(folder) / "SIM.npz")
        with np.load(Path(folder) / "SIM.npz") as loaded:
            sim = dict(loaded)
    assert (replay(sim, model_of(sim, character.path)) == sim["qpos"]).all()
    gone = [departure(sim, character, friction) for friction in (None, FRICTION)]
    words = [f"{1e3 * d:.1f} mm" if d < character.height else "lost" for d in gone]
    return (
        f"| {name} | {measures.survived_s:.2f} of {measures.duration_s:.2f} s | "
        f"{100 * measures.tracking_share:.2f} | "
        f"{100 * played.errors.max() / character.height:.1f} | "
        f"{measures.assist_force_rms_bw:.3f} | "
        f"{played.cpu_s / max(measures.survived_s, 1e-3):.1f} | {words[0]} | {words[1]} |"
    )


def begun(clip: Clip, seconds: float | None) -> Clip:
    """The clip's first seconds."""
    if seconds is None:
        return clip
    kept = clip.time <= clip.time[0] + seconds
    return replace(clip, qpos=clip.qpos[kept], time=clip.time[kept], contact_active=None)


def main() -> None:
    """Simulate the clips given and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--fps", type=float)
    parser.add_argument("--quat")
    parser.add_argument("--assist", action="store_true")
    parser.add_argument("--seconds", type=float)
    told = parser.parse_args()
    character = Character.load(told.model)
    settings = settings_of(SimulationOptions(assist=told.assist))
    print(HEAD)
    for path in told.clips:
        clip = load_clip(path, character=character, fps=told.fps, quat=told.quat)
        played = simulate(begun(clip, told.seconds), character, settings)
        print(row(f"{character.name} {path.stem}", played, character), flush=True)


if __name__ == "__main__":
    main()
