"""How good the clips are: tables over real captures, to be run again after any tuning.

    python -m benchmarks.quality [--data FOLDER] [--out docs/measured/quality.md]

Captures: those of the pybullet wheel, and of FOLDER ($PHYSRETARGET_DATA) where it is present.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.floor import all_takes, sequences
from benchmarks.row import number
from physretarget import capture, ik, mapping
from physretarget.demo import models_folder, motions_folder
from physretarget.features import features
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.trained import TrainedMapper, learn
from physretarget.validation import Report, validate

MODELS = models_folder()
WHEEL = ("jump", "dance_a", "walk", "run", "spinkick", "kick", "spin")
DATA = (
    "bvh/bandai/dataset-1_bow_happy_001.bvh",
    "bvh/bandai/dataset-1_walk_sad_001.bvh",
    "bvh/bandai/dataset-1_run_angry_001.bvh",
    "bvh/cmu/131_02.bvh",
    "c3d/85_02.c3d",
    "c3d/cmu_dribble_shoot_basketball.c3d",
    "grf/opencap_subject4/DJ1.trc",
)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A capture's clip and its report."""

    name: str
    result: Retargeted
    report: Report


def captures(data: Path | None) -> list[Path]:
    found = [motions_folder() / f"humanoid3d_{name}.txt" for name in WHEEL]
    return found + [data / name for name in DATA if data and (data / name).is_file()]


def judged(path: Path, mapper: TrainedMapper) -> Judged:
    result = retarget(capture.load(path), mapper, settings=RetargetSettings())
    return Judged(name=path.name, result=result, report=validate(result.clip, mapper.character))


def line(one: Judged) -> str:
    result, lamp = one.result, one.result.character
    placed, contacted, physical = result.placed, result.contacted, result.physical
    assert placed is not None
    assert contacted is not None
    assert physical is not None
    fall = 1 - physical.mismatch_after / physical.mismatch_before
    bound = f"{physical.bound_ratio:.2f}" if physical.bound_rms > 0.05 else "(bound 0)"
    flight = "no flight"
    if np.isfinite(physical.ballistic_before):
        flight = (
            f"{physical.ballistic_before:.1f} → {physical.ballistic_after:.2f} "
            f"({physical.ballistic_vertical_before:.1f} → {physical.ballistic_vertical_after:.2f})"
        )
    cells = [
        one.name.removeprefix("dataset-1_"),
        f"{result.clip.duration:.1f}",
        f"{placed.error:.2%}",
        f"{1000 * contacted.slide_max_m:.2f}",
        f"{1000 * contacted.sink_max_m:.2f}",
        f"{physical.mismatch_before:.1f} → {physical.mismatch_after:.1f}",
        f"{fall:.0%}",
        f"{np.abs(physical.displacement).max() / lamp.height:.1%}",
        bound,
        flight,
        f"{one.report.errors} / {one.report.warnings}",
        f"{sum(result.seconds.values()):.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


HEADER = (
    "| capture | s | forward momentum error | slide, mm | sink, mm | vertical mismatch, N "
    "| falls by | root moved, of height | over the bound | flight: off ballistic, m/s² (vertical) "
    "| errors / warnings | computed, s |\n|" + "---|" * 12
)


def returned(character: Character) -> list[str]:
    """Key poses mapped from their own frames: RMS over features, after the mapping and after IK."""
    lines = ["| mapper | after mapping | after mapping and IK |", "|---|---|---|"]
    poses = load_keyposes([MODELS / "lamp.keyposes.toml"], character)
    for name in mapping.NAMES:
        trained = learn(character, poses, mapper=name)
        mean = trained.mapper.predict(trained.y).mean
        posed = [
            ik.solve(character, one[None], start=start[None]).qpos[0]
            for one, start in zip(mean, trained.qpos, strict=True)
        ]
        misses = [mean - trained.z, features(character, np.array(posed)) - trained.z]
        shares = [np.sqrt(np.mean(m**2)) / character.height for m in misses]
        lines.append(f"| {name} | {shares[0]:.3%} | {shares[1]:.3%} |")
    return lines


def page(data: Path | None) -> str:
    lamp = Character.load(MODELS / "lamp.xml")
    poses = load_keyposes([MODELS / "lamp.keyposes.toml"], lamp)
    mapper = learn(lamp, poses)
    every = [judged(path, mapper) for path in captures(data)]
    return "\n".join(
        [
            "# How good the clips are",
            "",
            "Made by `python -m benchmarks.quality`, not by hand: the lamp "
            f"({number(lamp.height)} m, {number(lamp.mass)} kg, {number(lamp.weight)} N) learned "
            f"from {len(poses.poses)} key poses, all stages, default settings.",
            "",
            "Forward momentum: MuJoCo's, after the transform, against its target (RMS; aim 2 %). "
            "Slide and sink: the most that any planted point moves within a stance (aim 2 mm) or "
            "is below the floor (5 mm), after stage contact. Vertical mismatch: required minus "
            "contact-model force, RMS, before and after the optimisation of the root's height "
            "(aim: falls by 60 %, root moved by at most 15 % of the height). Over the bound: the "
            "mismatch after, divided by the least that any displacement with the same contact "
            "times could reach. Off ballistic: RMS of the centre of mass's acceleration plus g "
            "over flight frames (aim 1 m/s²; the root's height can mend the vertical part alone).",
            "",
            HEADER,
            *(line(one) for one in every),
            "",
            "## Key poses come back",
            "",
            "RMS over features of key poses mapped from their own frames, as a share of the lamp's "
            "height (aim: 2 % with the default mapper `sgplvm`).",
            "",
            *returned(lamp),
            "",
            *(on_the_floor(data) if data else []),
        ]
    )


def on_the_floor(data: Path) -> list[str]:
    """All sequences of the paper's evaluation: how deep, how fast on the floor."""
    return [
        "## On the floor: the sequences of the paper's evaluation",
        "",
        "The takes of `physretarget reproduce yamane2010` (`python -m benchmarks.floor` lists "
        "each): the worst of each sequence's takes after the last stage. Depth: the lowest point "
        "of any geom of the whole body, by the validator's geometry (aim: 10 mm at most). "
        "Skating: the fastest planted point (aim: 5 cm/s at most). Slide and sink as above. "
        "Errors are those of validation, at most ten of each code counted per take.",
        "",
        *sequences(all_takes(data)),
        "",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    beside = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("PHYSRETARGET_DATA", str(beside)))
    )
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    text = page(options.data if options.data.is_dir() else None)
    if options.out:
        options.out.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
