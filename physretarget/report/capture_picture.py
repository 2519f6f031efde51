"""A picture of a capture: the actor fitted to it from two sides, its path, its feet over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from physretarget import capture
from physretarget.capture.actor import PARENTS, SEGMENT, ActorMotion
from physretarget.files import beside
from physretarget.kinematics import forward, points

__all__ = ["draw_capture"]


def draw_capture(path: str | Path, target: Path, **options: Any) -> None:
    """Draw a capture as a PNG.

    Args:
        path: The capture.
        target: Where the picture goes.
        options: As for :func:`physretarget.capture.load`.
    """
    from matplotlib.figure import Figure

    motion = capture.load(path, **options)
    middle = int(np.flatnonzero(motion.valid)[motion.valid.sum() // 2])
    figure = Figure(figsize=(11, 7), layout="constrained")
    grid = figure.add_gridspec(2, 3, height_ratios=(2.2, 1))
    for column, (across, title) in enumerate(((0, "from the right"), (1, "from the front"))):
        _body(figure.add_subplot(grid[0, column]), motion, middle, across, title)
    _path(figure.add_subplot(grid[0, 2]), motion)
    _feet(figure.add_subplot(grid[1, :]), motion)
    doubt = f"  Doubt: {motion.doubts[0]}" if motion.doubts else ""
    figure.suptitle(f"{Path(path).name}: {motion.shape.height:.2f} m tall.{doubt}", wrap=True)
    with beside(target, suffix=".png") as fresh:
        figure.savefig(fresh, format="png", dpi=110)


def _body(axes: Any, motion: ActorMotion, frame: int, across: int, title: str) -> None:
    """The actor's bones in one frame, seen along or across where it faces."""
    pose = forward(motion.shape.tree(), motion.qpos[frame : frame + 1])
    ahead = pose.rotation[0, 1, :2, 0]
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    way = (ahead, np.array([-ahead[1], ahead[0]]))[across]
    place = pose.position[0, 1:]
    flat = np.c_[(place[:, :2] - place[0, :2]) @ way, place[:, 2]]
    for segment, parent in enumerate(PARENTS):
        if parent >= 0:
            axes.plot(*flat[[parent, segment]].T, color="#37506b", linewidth=3)
    segments, local = motion.shape.contact_points()
    soles = points(pose, segments[:4] + 1, local[:4])[0]
    axes.plot((soles[:, :2] - place[0, :2]) @ way, soles[:, 2], "o", color="#b3541e", markersize=4)
    axes.axhline(0, color="#888888", linewidth=1)
    axes.set(title=title, ylabel="m", aspect="equal")


def _path(axes: Any, motion: ActorMotion) -> None:
    root = np.where(motion.valid[:, None], motion.qpos[:, :2], np.nan)
    axes.plot(root[:, 0], root[:, 1], color="#37506b")
    axes.plot(*motion.qpos[0, :2], "o", color="#37506b")
    axes.set(title="path of the hips from above", xlabel="m", ylabel="m")
    axes.set_aspect("equal", adjustable="datalim")


def _feet(axes: Any, motion: ActorMotion) -> None:
    pose = forward(motion.shape.tree(), motion.qpos)
    segments, local = motion.shape.contact_points()
    height = points(pose, segments[:4] + 1, local[:4])[..., 2]
    for first, name, colour in ((0, "left", "#37506b"), (2, "right", "#b3541e")):
        axes.plot(motion.time, height[:, first : first + 2].min(axis=1), label=name, color=colour)
    axes.axhline(0, color="#888888", linewidth=1)
    axes.plot(
        motion.time, pose.position[:, 1 + SEGMENT["pelvis"], 2], color="#999999", label="hips"
    )
    axes.set(title="height of the lower foot point, and of the hips", xlabel="s", ylabel="m")
    axes.legend(loc="upper right", fontsize=8)
