"""The page of one simulation: the clip as a ghost over what MuJoCo played, and what it took."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.replay.figures import figure
from physretarget.replay.scene import Mark, Scene
from physretarget.report.charts import Chart, Series
from physretarget.report.page import finding_plots, render_page
from physretarget.simulate import Simulation

__all__ = ["render_simulation", "simulation_scene"]

Array = NDArray[np.float64]

_GHOST = (0.55, 0.60, 0.68)
_PLAYED = (0.42, 0.52, 0.70)


def render_simulation(played: Simulation, clip: Clip, character: Character) -> str:
    """The page of one simulation.

    Args:
        played: the simulation.
        clip: what was to be played; its frames are the page's clock.
        character: who plays it.

    Returns:
        The page, HTML.
    """
    scene = simulation_scene(played, clip, character)
    charts = _charts(played, clip, character)
    measures = played.measures
    return render_page(
        "simulation.html.j2",
        scene,
        plots=[*finding_plots(scene.marks), *charts],
        context={
            "title": scene.title,
            "model_name": character.name,
            "ending": _ending(played),
            "fell": not played.survived,
            "tiles": [
                {"label": name, "value": value, "unit": unit, "note": note, "good": good,
                 "frame": None}
                for name, value, unit, note, good in (
                    ("Trackability", f"{measures.trackability:.2f}", "",
                     "1 plays as it is", measures.trackability >= 0.5),
                    ("Survived", f"{measures.survived_s:.2f}", "s",
                     f"of {measures.duration_s:.2f} s", played.survived),
                    ("Deviation", f"{100 * measures.tracking_share:.2f}", "%",
                     "of the height, RMS", measures.tracking_share <= 0.05),
                    ("Assist", f"{measures.assist_force_rms_bw:.3f}", "BW", "RMS force",
                     measures.assist_force_rms_bw <= 0.05),
                    ("Torques at their limit", f"{100 * measures.torque_saturated_fraction:.1f}",
                     "%", "of joints and time", None),
                    ("Past joint limits", f"{measures.joint_limit_excess_max_rad:.3f}", "rad",
                     "at most", measures.joint_limit_excess_max_rad <= 0.02),
                )
            ],
            "plots": [*finding_plots(scene.marks), *charts],
            "notes": played.notes,
        },
    )  # fmt: skip


def simulation_scene(played: Simulation, clip: Clip, character: Character) -> Scene:
    """What was played, and the clip as a ghost in the same place; the moment of a fall is marked.

    After a fall the body stays as it was lost while the ghost goes on.
    """
    qpos, frames = clip.qpos.copy(), clip.frames
    qpos[:, character.root_qpos + 2] += played.lift_m
    shown = played.clip.qpos[_steps(played, clip)]
    marks: tuple[Mark, ...] = ()
    if played.ending == "lost":
        since = clip.time - clip.time[0]
        fall = min(int(np.searchsorted(since, played.measures.survived_s)), frames - 1)
        message = f"the body is lost at {played.measures.survived_s:.2f} s"
        marks = (Mark("SIM001", "error", message, fall, frames - 1, fall),)
    return Scene(
        title=f"Simulation of {clip.name}",
        time=clip.time,
        figures=(
            figure(character, shown, name="simulation", tint=_PLAYED),
            figure(character, qpos, name="clip", tint=_GHOST, repaint=True, opacity=0.35),
        ),
        marks=marks,
        layout="overlay",
    )


def _steps(played: Simulation, clip: Clip) -> NDArray[np.int64]:
    """The simulation's frame at each frame of the clip; its last after it ended."""
    steps = np.round((clip.time - clip.time[0]) / played.timestep).astype(np.int64)
    return np.asarray(np.minimum(steps, len(played.clip.qpos) - 1), np.int64)


def _charts(played: Simulation, clip: Clip, character: Character) -> list[Chart]:
    """Deviation, assist, and how much of their limits the torques use, at the clip's frames."""
    steps = _steps(played, clip)
    over = clip.time - clip.time[0] > played.measures.survived_s + played.timestep

    def told(values: Array, how: Callable[..., Any]) -> Array:
        """Per frame: of the steps since the frame before."""
        found = np.full(clip.frames, np.nan)
        for frame, step in enumerate(steps):
            first = steps[frame - 1] if frame else 0
            if not over[frame] and len(values):
                first = min(first, len(values) - 1)
                found[frame] = how(values[first : max(step, first + 1)])
        return found

    dof, weight = character.root_dof, character.weight
    force = np.linalg.norm(played.qfrc_applied[:, dof : dof + 3], axis=1) / weight
    moment = np.linalg.norm(played.qfrc_applied[:, dof + 3 : dof + 6], axis=1)
    moment /= weight * character.com_height
    limited = np.flatnonzero(np.isfinite(played.torque_limit))
    used = np.abs(played.qfrc_applied[:, limited]) / played.torque_limit[limited]
    # One error for each torque, which lasts a few steps.
    each = max(1, len(played.qfrc_applied) // max(1, len(played.errors) - 1))
    errors = 100 * np.repeat(played.errors[1:], each) / character.height
    charts = [
        Chart(
            "deviation", "Deviation from the clip", "% of height",
            (Series("markers, RMS", told(errors, np.max), "blue"),),
        ),
        Chart(
            "torque", "Torques over their limits", "",
            (Series("largest", told(used.max(axis=1, initial=0.0), np.max), "violet"),
             Series("share of joints at theirs", told((used >= 1.0).mean(axis=1), np.mean), "red",
                    fill=True)),
            levels=((1.0, "limit"),),
        ),
    ]  # fmt: skip
    if force.any():
        charts.append(
            Chart(
                "assist",
                "Assist on the root",
                "BW, BW·h",
                (
                    Series("force", told(force, np.mean), "green"),
                    Series("moment", told(moment, np.mean), "amber", dashed=True),
                ),
            )
        )
    return charts


def _ending(played: Simulation) -> str:
    measures = played.measures
    if played.survived:
        return f"plays to its end, {measures.duration_s:.2f} s"
    how = "is lost" if played.ending == "lost" else "was interrupted"
    return f"{how} at {measures.survived_s:.2f} s of {measures.duration_s:.2f} s"
