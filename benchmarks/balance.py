"""What the balance mends, and what it costs: every take of the evaluation, before and after.

    python -m benchmarks.balance [--data FOLDER] [--only penguin/ …] [--picture FILE.png]

The clip of stage ``contacted``, with which it begins, beside that of ``balanced``, judged by the
validator. ``--picture``
draws a penguin's walk and the lamp's jump, before above after.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from benchmarks.floor import deepest, shaking
from physretarget import capture
from physretarget.demo import models_folder, motions_folder
from physretarget.gl import Canvas, choose_backend
from physretarget.mjcf import Character
from physretarget.pipeline import Retargeted, retarget
from physretarget.reproduce.plan import Take, make_plan
from physretarget.reproduce.takes import learned, planted
from physretarget.validation import Report, validate

Array = NDArray[np.float64]

WHEEL = ("jump", "walk", "run", "kick")
INFEASIBLE = 0.1
"""BW that no force explains."""
C3D = ("85_02", "cmu_dribble_shoot_basketball")


@dataclass(frozen=True, kw_only=True)
class Side:
    """A clip before or after: errors, their codes, frames that have any, m below the floor,
    fastest planted point (m/s), RMS jerk of the markers (m/s³)."""

    errors: int
    codes: Counter[str]
    bad: int
    depth: float
    skate: float
    shake: float


@dataclass(frozen=True, kw_only=True)
class Pair:
    name: str
    frames: int
    duration: float
    before: Side
    after: Side
    moved: float
    most: float
    computed: float
    infeasible: tuple[float, ...]
    gaze: float


def takes(data: Path) -> list[Take]:
    """The evaluation's takes, and on every character some jumps, kicks and C3D captures."""
    found = list(make_plan(data, models_folder()).takes)
    more = [motions_folder() / f"humanoid3d_{name}.txt" for name in WHEEL]
    more += [data / "c3d" / f"{name}.c3d" for name in C3D]
    for character in dict.fromkeys(take.character for take in found):
        for path in more:
            if path.is_file():
                name = path.stem.removeprefix("humanoid3d_")
                found.append(Take(character=character, style="others", action=name, capture=path))
    return found


def side(result: Retargeted, qpos: Array) -> Side:
    character, time = result.character, result.motion.time
    assert result.contacted is not None
    report = validate(replace(result.clip, qpos=qpos), character)
    errors = [f for f in report.findings if f.severity == "error"]
    return Side(
        errors=report.errors,
        codes=Counter(f.code for f in errors),
        bad=int(_frames(report, len(time)).sum()),
        depth=deepest(character, qpos)[0],
        skate=planted(character, qpos, result.contacted.active, time)[1],
        shake=shaking(character, qpos, time),
    )


def _frames(report: Report, frames: int) -> NDArray[np.bool_]:
    bad = np.zeros(frames, dtype=bool)
    for finding in report.findings:
        if finding.severity == "error" and finding.frame_first is not None:
            bad[finding.frame_first : (finding.frame_last or finding.frame_first) + 1] = True
    return bad


def pair(take: Take) -> Pair:
    result = retarget(capture.load(take.capture), learned(models_folder(), take.character))
    assert result.contacted is not None
    assert result.balanced is not None
    by_stage = {each.stage: each for each in result.acting}
    gaze = [by_stage[name].gaze_speed_deg_s for name in ("contacted", "balanced")]
    height = result.character.height
    return Pair(
        name=take.name,
        frames=result.clip.frames,
        duration=result.clip.duration,
        before=side(result, result.contacted.qpos),
        after=side(result, result.balanced.qpos),
        moved=float(np.sqrt(np.mean(result.balanced.moved**2))) / height,
        most=float(result.balanced.moved.max()) / height,
        computed=result.seconds["balance"],
        infeasible=tuple(
            float(np.sum(left > INFEASIBLE))
            for left in (result.balanced.unexplained_before, result.balanced.unexplained_after)
        ),
        gaze=gaze[1] / max(gaze[0], 1.0),
    )


HEADER = (
    "| takes | number | s | errors | frames with errors | takes with errors "
    "| pose moved, of height (RMS / most) | depth, mm | skating, cm/s | jerk, m/s³ "
    "| computed, s per s | frames above 0.1 BW | peak gaze speed, of before (mean / most) |\n|"
    + "---|"
    * 13
)


def row(name: str, some: list[Pair]) -> str:
    frames, seconds = sum(p.frames for p in some), sum(p.duration for p in some)
    sides = [[p.before for p in some], [p.after for p in some]]
    bad = " → ".join(f"{sum(s.bad for s in each) / frames:.1%}" for each in sides)
    moved = float(np.sqrt(np.mean([p.moved**2 for p in some])))
    cells = [
        name,
        f"{len(some)}",
        f"{seconds:.0f}",
        " → ".join(str(sum(s.errors for s in each)) for each in sides),
        bad,
        " → ".join(str(sum(s.errors > 0 for s in each)) for each in sides),
        f"{moved:.1%} / {max(p.most for p in some):.1%}",
        " → ".join(f"{1000 * max(s.depth for s in each):.1f}" for each in sides),
        " → ".join(f"{100 * max(s.skate for s in each):.1f}" for each in sides),
        " → ".join(f"{np.mean([s.shake for s in each]):.0f}" for each in sides),
        f"{sum(p.computed for p in some) / seconds:.2f}",
        " → ".join(f"{sum(p.infeasible[k] for p in some) / frames:.2%}" for k in (0, 1)),
        f"{np.mean([p.gaze for p in some]):.2f} / {max(p.gaze for p in some):.2f}",
    ]
    return "| " + " | ".join(cells) + " |"


def table(every: list[Pair]) -> list[str]:
    lines = [HEADER]
    for character in dict.fromkeys(p.name.split("/")[0] for p in every):
        own = [p for p in every if p.name.startswith(f"{character}/")]
        for action in dict.fromkeys(_group(p) for p in own):
            lines.append(row(f"{character}, {action}", [p for p in own if _group(p) == action]))
    lines.append(row("all", every))
    codes = [sum((getattr(p, s).codes for p in every), Counter()) for s in ("before", "after")]
    lines += ["", "| code | before | after |", "|---|---|---|"]
    lines += [f"| {code} | {codes[0][code]} | {codes[1][code]} |" for code in sorted(codes[0])]
    return lines


def _group(one: Pair) -> str:
    _, style, action = one.name.split("/")
    return "others" if style == "others" else action.split("_")[0]


def picture(data: Path, out: Path) -> None:
    """Two clips, before above after."""
    shots = (
        ("penguin", data / "bvh/bandai/dataset-1_walk_normal_001.bvh", (0.3, 0.6), 180.0),
        ("lamp", motions_folder() / "humanoid3d_jump.txt", (0.05, 0.95), 110.0),
    )
    rows = []
    for name, path, (first, last), azimuth in shots:
        result = retarget(capture.load(path), learned(models_folder(), name))
        assert result.contacted is not None
        assert result.balanced is not None
        at = np.linspace(first, last, 9) * (result.clip.frames - 1)
        for qpos in (result.contacted.qpos, result.balanced.qpos):
            rows.append(
                _strip(result.character, qpos, result.contacted.qpos, at.astype(int), azimuth)
            )
    Image.fromarray(np.concatenate(rows)).save(out, optimize=True)


def _strip(
    character: Character, qpos: Array, beside: Array, frames: NDArray[np.int64], azimuth: float
) -> NDArray[np.uint8]:
    model, data, camera = character.model, mujoco.MjData(character.model), mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = 2.6 * character.height, azimuth, -8.0
    shown = []
    with Canvas(model, 170, 190, backend=choose_backend()) as canvas:
        for frame in frames:
            data.qpos[:] = qpos[frame]
            mujoco.mj_forward(model, data)
            root = beside[frame, character.root_qpos : character.root_qpos + 2]
            camera.lookat[:] = [*root, 0.55 * character.height]
            canvas.look(data, camera)
            shown.append(canvas.draw())
    return np.concatenate(shown, axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    beside = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("PHYSRETARGET_DATA", str(beside)))
    )
    parser.add_argument("--only", nargs="*", default=[""], help="beginnings of takes' names")
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    if options.picture:
        picture(options.data, options.picture)
        return
    some = [t for t in takes(options.data) if any(t.name.startswith(o) for o in options.only)]
    print("\n".join(table([pair(take) for take in some])))


if __name__ == "__main__":
    main()
