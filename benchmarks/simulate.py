"""How near simulations come to their clips, and what they cost: one row a clip.

    python -m benchmarks.simulate [--data FOLDER] [--only penguin …] [--out PAGE.md]
    python -m benchmarks.simulate --model MODEL.xml --clips CLIP... [--fps F] [--quat wxyz]

Without clips: retargetings of bows, guides, walks, runs, kicks, jumps and dances on the three
characters, and the G1's clips. Every simulation is replayed by plain MuJoCo before it is told of,
and followed by its gains from a start 5 mm aside, on a floor of the model's friction and on one of
0.8. ``--assist`` lets a wrench help.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.balance import takes
from physretarget import capture
from physretarget.clip import Clip, load_clip
from physretarget.demo import models_folder
from physretarget.mjcf import Character
from physretarget.options.simulation import SimulationOptions
from physretarget.pipeline import retarget
from physretarget.reproduce.takes import learned
from physretarget.simulate import Simulation, follow, model_of, replay, settings_of, simulate
from physretarget.validation import validate

HEAD = (
    "| clip | errors of the clip | survived | deviation, % of the height | worst | torques at "
    "their limit, % | past joint limits, rad | DYN errors at 60 and 250 fps | CPU-s per s "
    "| 5 mm aside, at the end | and friction 0.8 |\n" + "|---" * 11 + "|"
)
PAGE = """# Clips that MuJoCo plays

Made by `python -m benchmarks.simulate --out docs/measured/simulate.md`: clips of the last stage on
three characters and a robot's clips, played forward by torques alone (docs/validate.md). In
brackets the deviation that is aimed at. The last two columns follow the gains from 5 mm aside:
distance of the root from the recorded end.
"""
ASIDE = 0.005
FRICTION = 0.8
ACTIONS = (
    "angry/bow", "normal/guide", "others/walk", "normal/run", "others/run", "others/kick",
    "others/jump", "dance/dance_a",
)  # fmt: skip
TARGETS = {
    "bow": 0.005, "guide": 0.005, "wave": 0.005, "walk": 0.02, "kick": 0.02, "run": 0.05,
    "jump": 0.06, "dance": 0.06,
}  # fmt: skip
"""What a simulation should keep to, in heights; a lamp hops wherever others walk."""


def collection(data: Path, only: tuple[str, ...] = ("",)) -> Iterator[tuple[str, Character, Clip]]:
    """Clips of the three characters and the G1, by name."""
    for take in takes(data):
        chosen = take.name.split("/", 1)[1] in ACTIONS
        if chosen and any(take.name.startswith(each) for each in only):
            mapper = learned(models_folder(), take.character)
            yield take.name, mapper.character, retarget(capture.load(take.capture), mapper).clip
    model = data / "robot" / "g1_no_mesh_box_feet.xml"
    if not model.is_file():
        return
    character = Character.load(model)
    for path in sorted(model.parent.glob("g1_*.csv")):
        name = path.stem.replace("_", "/", 1)
        if any(name.startswith(each) for each in only):
            yield name, character, load_clip(path, character=character, fps=30.0, quat="wxyz")


def target(name: str) -> float:
    """What a clip's simulation should keep to, in heights."""
    hops = name.startswith("lamp") and "run" not in name
    found = next((v for k, v in TARGETS.items() if k in name), 0.06)
    return max(found, 0.06) if hops and found > 0.005 else found


def dynamics_errors(clip: Clip, character: Character) -> str:
    """Errors of rules DYN of a simulation seen at 60 and at 250 frames per second."""
    told = []
    for fps in (60.0, 250.0):
        at = np.arange(0.0, clip.duration, 1 / fps)
        steps = np.round(at / (clip.time[1] - clip.time[0])).astype(np.int64)
        if len(steps) < 8:
            return "too short"
        seen = replace(clip, qpos=clip.qpos[steps], time=clip.time[steps])
        errors = [f.code for f in validate(seen, character).findings if f.severity == "error"]
        told.append(", ".join(sorted({code for code in errors if code.startswith("DYN")})) or "–")
    return " / ".join(told)


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


def row(name: str, clip: Clip, played: Simulation, character: Character) -> str:
    """One simulation as a row of the table."""
    measures = played.measures
    with tempfile.TemporaryDirectory() as folder:
        played.save(Path(folder) / "SIM.npz")
        with np.load(Path(folder) / "SIM.npz") as loaded:
            sim = dict(loaded)
    assert (replay(sim, model_of(sim, character.path)) == sim["qpos"]).all()
    gone = [departure(sim, character, friction) for friction in (None, FRICTION)]
    words = [f"{1e3 * d:.1f} mm" if d < 0.25 * character.height else "lost" for d in gone]
    return (
        f"| {name} | {validate(clip, character).errors} | "
        f"{measures.survived_s:.2f} of {measures.duration_s:.2f} s | "
        f"{100 * measures.tracking_share:.2f} (≤ {100 * target(name):g}) | "
        f"{100 * played.errors.max() / character.height:.1f} | "
        f"{100 * measures.torque_saturated_fraction:.2f} | "
        f"{measures.joint_limit_excess_max_rad:.3f} | {dynamics_errors(played.clip, character)} | "
        f"{played.cpu_s / max(measures.survived_s, 1e-3):.1f} | {words[0]} | {words[1]} |"
    )


def summary(every: list[tuple[str, Simulation]]) -> str:
    """What became of all of them, in a sentence."""
    ended = sum(played.survived for _, played in every)
    near = sum(p.survived and p.measures.tracking_share <= target(name) for name, p in every)
    seconds = sum(p.measures.survived_s for _, p in every)
    return (
        f"**{ended} of {len(every)} come to their end, {near} of them within their target; "
        f"{sum(p.cpu_s for _, p in every) / seconds:.1f} CPU-seconds per second over all.** Every "
        "simulation is reproduced bit for bit by plain MuJoCo from its torques."
    )


def main() -> None:
    """Simulate the clips given, or the collection, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    beside = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("PHYSRETARGET_DATA", str(beside)))
    )
    parser.add_argument("--only", nargs="*", default=[""], help="beginnings of names")
    parser.add_argument("--model", type=Path)
    parser.add_argument("--clips", type=Path, nargs="+", default=[])
    parser.add_argument("--fps", type=float)
    parser.add_argument("--quat")
    parser.add_argument("--assist", action="store_true")
    parser.add_argument("--out", type=Path)
    told = parser.parse_args()
    settings = settings_of(SimulationOptions(assist=told.assist))
    if told.model is None:
        clips = collection(told.data, tuple(told.only))
    else:
        character = Character.load(told.model)
        clips = (
            (
                path.stem,
                character,
                load_clip(path, character=character, fps=told.fps, quat=told.quat),
            )
            for path in told.clips
        )
    print(HEAD)
    rows, every = [], []
    for name, character, clip in clips:
        played = simulate(clip, character, settings)
        every.append((name, played))
        rows.append(row(name, clip, played, character))
        print(rows[-1], flush=True)
    print("\n" + summary(every))
    if told.out is not None:
        text = f"{PAGE}\n{summary(every)}\n\n{HEAD}\n" + "\n".join(rows) + "\n"
        told.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
