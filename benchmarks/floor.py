"""Do the clips of the paper's evaluation keep to the floor? All takes of `reproduce yamane2010`.

    python -m benchmarks.floor [--data FOLDER] [--only penguin/ …] [--save FOLDER]

Every capture of the plan (six styles, five actions, and dances, on lamp, penguin and squirrel)
goes through all stages. Depth is that of the whole body: the lowest point of every geom in every
frame, by the validator's own geometry, which shares no code with the stages.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget import capture, kinematics
from physretarget.demo import models_folder
from physretarget.ground.undersides import lowest_heights, solids
from physretarget.mjcf import Character
from physretarget.pipeline import Retargeted, retarget
from physretarget.reproduce.plan import Take, make_plan
from physretarget.reproduce.takes import learned, planted
from physretarget.validation import Report, validate

Array = NDArray[np.float64]

SEVERE = ("CON001", "CON002", "CON003", "DYN001", "DYN002", "DYN003", "DYN007")
"""Findings that the table counts."""


@dataclass(frozen=True, kw_only=True)
class Floor:
    """What one clip does to the floor.

    ``depth`` m, of the geom ``where`` in ``frame``; ``skate`` m/s of planted points; ``shake``
    RMS of the markers' jerk, m/s³; ``codes`` findings of each code.
    """

    name: str
    seconds: float
    frames: int
    depth: float
    where: str
    frame: int
    skate: float
    slide: float
    sink: float
    mismatch: float
    displacement: float
    ballistic: float
    shake: float
    codes: Counter[str]
    errors: int
    computed: float

    @property
    def row(self) -> str:
        counts = " ".join(f"{code} {self.codes[code]}" for code in SEVERE if self.codes[code])
        cells = [
            self.name,
            f"{self.seconds:.1f}",
            f"{1000 * self.depth:.1f}",
            f"{self.where} @{self.frame}" if self.depth > 0.001 else "",
            f"{100 * self.skate:.1f}",
            f"{1000 * self.slide:.2f} / {1000 * self.sink:.2f}",
            f"{self.mismatch:.0%}",
            f"{self.displacement:.1%}",
            f"{self.ballistic:.2f}",
            f"{self.shake:.0f}",
            f"{self.errors}",
            counts,
            f"{self.computed:.2f}",
        ]
        return "| " + " | ".join(cells) + " |"


HEADER = (
    "| take | s | depth, mm | where | skating, cm/s | slide / sink, mm | mismatch falls by "
    "| root moved | flight off ballistic, m/s² | jerk, m/s³ | errors | of these codes "
    "| computed, s |\n|" + "---|" * 13
)


def deepest(character: Character, qpos: Array) -> tuple[float, str, int]:
    """How far any geom is below the floor (m), its name and the frame."""
    every = solids(character)
    pose = kinematics.forward(character.tree, qpos)
    low = lowest_heights(every, pose) - character.floor_height
    frame, which = np.unravel_index(int(low.argmin()), low.shape)
    return max(0.0, -float(low[frame, which])), every[int(which)].name, int(frame)


def shaking(character: Character, qpos: Array, time: Array) -> float:
    """RMS over markers and frames of the third derivative of where they are, m/s³."""
    pose = kinematics.forward(character.tree, qpos)
    at = kinematics.points(pose, character.markers.body, character.markers.local)
    jerk = np.diff(at, n=3, axis=0) / np.median(np.diff(time)) ** 3
    return float(np.sqrt(np.mean(np.sum(jerk**2, axis=-1))))


def judged(name: str, result: Retargeted, report: Report) -> Floor:
    character = result.character
    contacted, physical = result.contacted, result.physical
    assert contacted is not None
    assert physical is not None
    depth, where, frame = deepest(character, result.clip.qpos)
    _, skate = planted(character, result.clip.qpos, contacted.active, result.motion.time)
    errors = [f for f in report.findings if f.severity == "error"]
    return Floor(
        name=name,
        seconds=result.clip.duration,
        frames=result.clip.frames,
        depth=depth,
        where=where,
        frame=frame,
        skate=skate,
        slide=contacted.slide_max_m,
        sink=contacted.sink_max_m,
        mismatch=physical.improvement,
        displacement=float(np.abs(physical.displacement).max()) / character.height,
        ballistic=physical.ballistic_vertical_after,
        shake=shaking(character, result.clip.qpos, result.motion.time),
        codes=Counter(f.code for f in errors),
        errors=report.errors,
        computed=sum(result.seconds.values()),
    )


def run(take: Take, models: Path, save: Path | None) -> Floor:
    mapper = learned(models, take.character)
    result = retarget(capture.load(take.capture), mapper)
    report = validate(result.clip, mapper.character)
    if save is not None:
        save.mkdir(parents=True, exist_ok=True)
        assert result.contacted is not None
        kept: dict[str, Any] = {
            "time": result.motion.time,
            "active": result.contacted.active,
            "displacement": result.physical.displacement if result.physical else np.zeros(0),
        }
        kept.update({str(stage): qpos for stage, qpos in result.stages().items()})
        np.savez(save / (take.name.replace("/", "-") + ".npz"), **kept)
    return judged(take.name, result, report)


SEQUENCES = (
    "| sequence | takes | s | depth, mm | where | skating, cm/s | slide / sink, mm "
    "| mismatch falls by | root moved | errors | of these codes | computed, s per s |\n|"
    + "---|"
    * 12
)


def sequences(every: list[Floor]) -> list[str]:
    """One line per character and style: the worst of its takes; errors are summed."""
    lines = [SEQUENCES]
    for name in dict.fromkeys(one.name.rpartition("/")[0] for one in every):
        takes = [one for one in every if one.name.rpartition("/")[0] == name]
        seconds = sum(one.seconds for one in takes)
        worst = max(takes, key=lambda one: one.depth)
        codes = sum((one.codes for one in takes), Counter())
        counts = " ".join(f"{code} {codes[code]}" for code in SEVERE if codes[code])
        cells = [
            name,
            f"{len(takes)}",
            f"{seconds:.1f}",
            f"{1000 * worst.depth:.1f}",
            f"{worst.name.rpartition('/')[2]}, {worst.where}" if worst.depth > 0.001 else "",
            f"{100 * max(one.skate for one in takes):.1f}",
            f"{1000 * max(o.slide for o in takes):.2f} / {1000 * max(o.sink for o in takes):.2f}",
            f"{min(one.mismatch for one in takes):.0%}",
            f"{max(one.displacement for one in takes):.1%}",
            f"{sum(one.errors for one in takes)}",
            counts,
            f"{sum(one.computed for one in takes) / seconds:.2f}",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def all_takes(data: Path) -> list[Floor]:
    """Every take of the evaluation."""
    models = models_folder()
    return [run(take, models, None) for take in make_plan(data, models).takes]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    beside = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("PHYSRETARGET_DATA", str(beside)))
    )
    parser.add_argument("--only", nargs="*", default=[""], help="parts of the takes' names")
    parser.add_argument("--sequences", action="store_true", help="one line per style at the end")
    parser.add_argument("--save", type=Path, help="keep every stage's poses there")
    options = parser.parse_args()
    models = models_folder()
    plan = make_plan(options.data, models)
    print(HEADER, flush=True)
    every = []
    for take in plan.takes:
        if any(part in take.name for part in options.only):
            every.append(run(take, models, options.save))
            print(every[-1].row, flush=True)
    if options.sequences:
        print("\n".join(["", *sequences(every)]))


if __name__ == "__main__":
    main()
