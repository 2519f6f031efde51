"""Other tools' numbers and ours on the same motions at several frame rates.

Run: python benchmarks/other_definitions.py CLIP.csv --model MODEL.xml [--fps 30] [--lowpass 6]
     [--out docs/measured/other-definitions.md]
Prints the tables of that page, or writes them into it, between its comments, with its picture.
Two motions are made up, so that the truth is known; the third is the clip.
"""

from __future__ import annotations

import argparse
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

import physretarget
from physretarget.capture.actor import ActorShape
from physretarget.files import write_file
from physretarget.kinematics import continuous
from physretarget.mjcf import actor_character

RATES = (15, 30, 60, 120, 240)
SHOWN = (30, 120)
SLIDE = 0.2  # m/s
HOP = 0.4  # s in the air; take-off and landing fall on frames of every rate
GRAVITY = 9.81
NUMBERS = (
    ("PhysDiff skate, mm per frame", "literature", "physdiff_skate_mm", 2),
    ("holosoma sliding, share over 1 cm per frame", "literature", "holosoma_sliding_fraction", 3),
    ("PhysDiff penetrate, mm", "literature", "physdiff_penetrate_mm", 2),
    ("PhysDiff float, mm", "literature", "physdiff_float_mm", 2),
    ("EDGE PFC", "literature", "edge_pfc", 4),
    ("**ours** `skate_speed_max_m_s`", "measures", "skate_speed_max_m_s", 3),
    ("**ours** `skate_distance_m`", "measures", "skate_distance_m", 2),
    ("**ours** `penetration_max_m`", "measures", "penetration_max_m", 4),
    ("**ours** `float_time_s`", "measures", "float_time_s", 2),
    ("**ours** `flight_com_acceleration_error_rms`, m/s²", "measures",
     "flight_com_acceleration_error_rms", 2),
    ("**ours** `unexplained_force_rms_bw`", "measures", "unexplained_force_rms_bw", 3),
)  # fmt: skip

Motion = Callable[[np.ndarray], np.ndarray]  # times (T,) s to qpos (T, nq)


def slide() -> tuple[physretarget.Character, Motion]:
    """A standing body that slides forward over the floor at SLIDE m/s for 3 s."""
    actor = actor_character(ActorShape.reference())

    def pose(time: np.ndarray) -> np.ndarray:
        qpos = np.repeat(actor.reference_qpos[None], len(time), axis=0)
        qpos[:, 0] += SLIDE * time
        return qpos

    return actor, pose


def hop() -> tuple[physretarget.Character, Motion]:
    """A body that stands, flies HOP s exactly as thrown upwards, stands; no foot slides."""
    actor = actor_character(ActorShape.reference())

    def pose(time: np.ndarray) -> np.ndarray:
        qpos = np.repeat(actor.reference_qpos[None], len(time), axis=0)
        inside = np.clip(time - 1.2, 0.0, HOP)
        qpos[:, 2] += 0.5 * GRAVITY * inside * (HOP - inside)
        return qpos

    return actor, pose


def recorded(path: Path, model: Path, fps: float) -> tuple[physretarget.Character, Motion, float]:
    """The clip as a smooth curve through its frames, so that every rate samples one motion."""
    character = physretarget.Character.load(model)
    clip = physretarget.load_clip(path, character=character, fps=fps)
    qpos, quats = clip.qpos.copy(), character.tree.quats[0]
    qpos[:, quats] = continuous(qpos[:, quats])
    curve = CubicSpline(clip.time, qpos, axis=0)

    def pose(time: np.ndarray) -> np.ndarray:
        found = curve(time)
        found[:, quats] /= np.linalg.norm(found[:, quats], axis=-1, keepdims=True)
        return found

    return character, pose, clip.duration


def judge(
    character: physretarget.Character, pose: Motion, seconds: float, lowpass: float | None
) -> dict[int, dict[str, float | None]]:
    """Every number at every rate."""
    settings = physretarget.Settings(lowpass_hz=lowpass, also_literature=True)
    found: dict[int, dict[str, float | None]] = {}
    for rate in RATES:
        time = np.arange(int(seconds * rate + 1e-6) + 1) / rate
        clip = physretarget.Clip(qpos=pose(time), time=time, model_name=character.name)
        told = replace(settings, lowpass_hz=None if lowpass and lowpass >= 0.45 * rate else lowpass)
        report = physretarget.validate(clip, character, settings=told)
        found[rate] = {
            label: report.literature[key]["value"] if where == "literature"
            else report.measures[key].value
            for label, where, key, _ in NUMBERS
        }  # fmt: skip
    return found


def table(motions: Sequence[tuple[str, dict[int, dict[str, float | None]]]]) -> str:
    """Rows of numbers, two columns (30 and 120 frames/s) for each motion."""
    head = "".join(f" {name}, {rate}/s |" for name, _ in motions for rate in SHOWN)
    rows = [f"| number |{head}", "|---|" + "---:|" * (len(motions) * len(SHOWN))]
    for label, _, _, digits in NUMBERS:
        cells = (found[rate][label] for _, found in motions for rate in SHOWN)
        shown = ("–" if v is None else f"{v + 0.0:.{digits}f}" for v in cells)
        rows.append(f"| {label} | " + " | ".join(shown) + " |")
    return "\n".join(rows)


def picture(motions: Sequence[tuple[str, dict[int, dict[str, float | None]]]]) -> bytes:
    """Three ways to say how much feet slide, over the frame rate."""
    figure = Figure(figsize=(9.6, 2.9), dpi=96)
    panels = figure.subplots(1, 3)
    for axes, label, title in zip(
        panels,
        (NUMBERS[0][0], NUMBERS[1][0], NUMBERS[6][0]),
        ("PhysDiff skate, mm per frame", "holosoma, share over 1 cm/frame", "ours, m slid"),
        strict=True,
    ):
        for (name, found), colour in zip(motions, ("#1b6ca8", "#d1495b"), strict=True):
            values = [found[rate][label] for rate in RATES]
            axes.plot(RATES, values, "o-", ms=4, lw=1.4, color=colour, label=name)
        axes.set_xscale("log", base=2)
        axes.set_xticks(RATES, [str(rate) for rate in RATES])
        axes.set_ylim(bottom=0)
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("frames per second", fontsize=9)
        axes.tick_params(labelsize=8)
        axes.grid(color="#eeeeee", lw=0.6)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    panels[0].legend(fontsize=8, frameon=False)
    figure.tight_layout()
    content = io.BytesIO()
    figure.savefig(content, format="png", metadata={"Software": None})
    return content.getvalue()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("clip", type=Path)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--fps", type=float, default=30.0)
    parser.add_argument("--lowpass", type=float, default=6.0)
    parser.add_argument("--out", type=Path)
    told = parser.parse_args()
    character, pose, seconds = recorded(told.clip, told.model, told.fps)
    motions = [
        ("slide", judge(*slide(), 3.0, None)),
        ("hop", judge(*hop(), 3.0, None)),
        (told.clip.stem, judge(character, pose, seconds, told.lowpass)),
    ]
    text = table(motions)
    if told.out is None:
        print(text)
        return
    page = told.out.read_text(encoding="utf-8")
    marked = re.compile(r"(<!-- table[^>]*-->\n).*?(<!-- end of table -->)", re.DOTALL)
    page = marked.sub(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page)
    write_file(told.out, page.encode("utf-8"))
    image = told.out.parent / "images" / "other-definitions.png"
    write_file(image, picture([motions[0], motions[2]]))


if __name__ == "__main__":
    main()
