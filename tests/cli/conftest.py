from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from physretarget import cli
from physretarget.demo import models_folder

MODELS = models_folder()
LAMP = ("--character", str(MODELS / "lamp.xml"), "--keyposes", str(MODELS / "lamp.keyposes.toml"))


@dataclass(frozen=True)
class Outcome:
    code: int
    out: str
    err: str


Run = Callable[..., Outcome]


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the program as its script does, in this process."""

    def call(*arguments: object) -> Outcome:
        monkeypatch.setattr(sys, "argv", ["physretarget", *map(str, arguments)])
        capfd.readouterr()
        code: object = 0
        try:
            cli.main()
        except SystemExit as end:
            code = end.code
        captured = capfd.readouterr()
        return Outcome(int(code or 0), captured.out, captured.err)  # type: ignore[call-overload]

    return call


JOINTS = (  # depth, name, offset in cm
    (0, "Hips", (0, 0, 0)),
    (1, "Spine", (0, 12, 0)),
    (2, "Chest", (0, 20, 0)),
    (3, "Neck", (0, 22, 0)),
    (4, "Head", (0, 10, 0)),
    (3, "LeftShoulder", (3, 18, 0)),
    (4, "LeftArm", (14, 0, 0)),
    (5, "LeftForeArm", (28, 0, 0)),
    (6, "LeftHand", (25, 0, 0)),
    (3, "RightShoulder", (-3, 18, 0)),
    (4, "RightArm", (-14, 0, 0)),
    (5, "RightForeArm", (-28, 0, 0)),
    (6, "RightHand", (-25, 0, 0)),
    (1, "LeftUpLeg", (9, 0, 0)),
    (2, "LeftLeg", (0, -42, 0)),
    (3, "LeftFoot", (0, -42, 0)),
    (4, "LeftToe", (0, -7, 13)),
    (1, "RightUpLeg", (-9, 0, 0)),
    (2, "RightLeg", (0, -42, 0)),
    (3, "RightFoot", (0, -42, 0)),
    (4, "RightToe", (0, -7, 13)),
)


def bvh_text(frames: int = 45, fps: int = 30) -> str:
    """A T-posed human that bows and bends its knees."""
    lines, open_depths = ["HIERARCHY"], 0
    for index, (depth, name, offset) in enumerate(JOINTS):
        while open_depths > depth:
            open_depths -= 1
            lines.append("}")
        lines += [
            f"{'JOINT' if depth else 'ROOT'} {name}",
            "{",
            "OFFSET {} {} {}".format(*offset),
            ("CHANNELS 6 Xposition Yposition Zposition " if not depth else "CHANNELS 3 ")
            + "Zrotation Xrotation Yrotation",
        ]
        open_depths = depth + 1
        last = index + 1 == len(JOINTS) or JOINTS[index + 1][0] <= depth
        if last:
            lines += ["End Site", "{", "OFFSET 0 4 0" if name == "Head" else "OFFSET 2 0 1", "}"]
    lines += ["}"] * open_depths
    bend = 20.0 * (1 - np.cos(2 * np.pi * np.arange(frames) / 40))
    at = {name: 3 + 3 * i for i, (_, name, _) in enumerate(JOINTS)}
    values = np.zeros((frames, 3 + 3 * len(JOINTS)))
    values[:, 1] = 91 - 84 * (1 - np.cos(np.radians(bend)))
    values[:, at["Spine"] + 1] = bend
    for side in ("Left", "Right"):
        values[:, at[side + "UpLeg"] + 1] = -bend
        values[:, at[side + "Leg"] + 1] = 2 * bend
        values[:, at[side + "Foot"] + 1] = -bend
        values[:, at[side + "Arm"]] = -70.0 if side == "Left" else 70.0
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {1 / fps:.7f}"]
    lines += [" ".join(f"{v:.4f}" for v in row) for row in values]
    return "\n".join(lines) + "\n"


@pytest.fixture
def good(tmp_path: Path) -> Path:
    """A small sound capture."""
    folder = tmp_path / "captures"
    folder.mkdir()
    path = folder / "bow.bvh"
    path.write_text(bvh_text())
    return path
