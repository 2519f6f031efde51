"""The page of one retargeting: replay, stages, forces, momentum, latent space, findings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.replay.figures import figure
from physretarget.replay.scene import Mark, Scene
from physretarget.report.charts import Chart, Lanes, Series, latent_plot
from physretarget.report.document import (
    as_document,
    document_marks,
    document_sections,
    facts,
    judgement,
    measure_tiles,
)
from physretarget.report.page import contact_plots, finding_plots, render_page
from physretarget.report.retarget_data import RetargetReport, StageMotion
from physretarget.report.stills import Row, stills
from physretarget.report.words import number

STRIP_COLUMNS = 8


def acting_rows(stages: tuple[StageMotion, ...]) -> list[dict[str, str]]:
    """Errors and acting of every stage, as text."""
    rows = []
    for stage in stages:
        acting = stage.acting
        if acting is None:
            return []

        def shown(value: float | None, form: str) -> str:
            return "–" if value is None else format(value, form)

        rows.append(
            {
                "stage": stage.label,
                "since": acting.since or "",
                "errors": shown(stage.errors, "d"),
                "moved": shown(acting.moved, ".1%"),
                "gaze": shown(acting.gaze_error_deg, ".1f"),
                "gaze_speed": shown(acting.gaze_speed_deg_s, ".0f"),
                "joint_speed": shown(acting.joint_speed_rad_s, ".1f"),
                "joint_step": shown(math.degrees(acting.joint_step_rad), ".1f"),
                "lag": shown(acting.lag_s, "+.3f"),
                "hop": shown(acting.hop, ".1%"),
            }
        )
    return rows


def render_retarget_html(data: RetargetReport, *, painted: bool = False) -> str:
    """The page of one retargeting: replay, stages, forces, momentum, latent space, findings.

    ``painted``: the film strip is there before the browser has drawn it, where OpenGL works.
    """
    document = None if data.report is None else as_document(data.report)
    marks = () if document is None else document_marks(document)
    scene = retarget_scene(data, marks)
    force = _force_plots(data)
    more: list[Chart | Lanes] = [*_displacement_plots(data)]
    more += contact_plots(data.character, data.contact_active)
    momentum = [
        Chart(
            id=f"momentum-{k}",
            title=f"{'Angular' if 'm²' in curves.unit else 'Linear'} momentum, {curves.axis}",
            unit=curves.unit,
            series=(
                # Dashes come last, on top: two equal curves must both be seen.
                Series(data.character_name, curves.achieved, "red"),
                Series("actor, scaled", curves.target, "blue", dashed=True),
            ),
        )
        for k, curves in enumerate(data.momentum)
    ]
    variance = _variance_plots(data)
    findings = finding_plots(marks)
    latent = [latent_plot(item) for item in data.latent]
    return render_page(
        "retarget.html.j2",
        scene,
        plots=[*force, *more, *momentum, *variance, *findings],
        latent=[plot.points for plot in latent],
        strip=_strip(data, scene, painted=painted),
        context={
            "title": data.title,
            "capture": data.capture,
            "character_name": data.character_name,
            "rows": data.stages,
            "deeds": acting_rows(data.stages),
            "tiles": [
                {
                    "label": item.label,
                    "stage": item.stage,
                    "value": number(item.value),
                    "unit": item.unit,
                    "note": item.note,
                    "good": item.good,
                    "frame": None,
                }
                for item in data.numbers
            ],
            "clip_tiles": [] if document is None else measure_tiles(document),
            "notes": data.notes,
            "force_plots": force,
            "more_plots": more,
            "momentum_plots": momentum,
            "variance_plots": variance,
            "finding_plots": findings,
            "latent": latent,
            "sections": facts({**document_sections(document), **data.sections}),
            **judgement(document),
        },
    )


def retarget_scene(data: RetargetReport, marks: tuple[Mark, ...] = ()) -> Scene:
    """Actor and character side by side; the stages before the last start hidden."""
    last = len(data.stages) - 1
    actor = figure(
        data.actor,
        data.actor_qpos,
        name="Actor",
        offset=(0.0, 0.7, 0.0),
        tint=(0.42, 0.52, 0.70),
        contact_active=data.actor_contact_active,
    )
    stages = [
        figure(
            data.character,
            stage.qpos,
            name=data.character_name if k == last else stage.label,
            offset=(0.0, -0.5 - 0.6 * (last - k), 0.0),
            hidden=k != last,
            contact_active=data.contact_active if k == last else None,
            forces=data.forces if k == last else None,
        )
        for k, stage in enumerate(data.stages)
    ]
    # The clip stands right beside its actor, the way there comes after.
    figures = (actor, stages[-1], *stages[:-1])
    return Scene(title=data.title, time=data.time, figures=figures, marks=marks, layout="split")


def _strip(data: RetargetReport, scene: Scene, *, painted: bool) -> dict[str, Any]:
    """Actor and stages from top to bottom, each by its number in the scene, and the times."""
    last = len(data.stages) - 1
    rows: list[dict[str, Any]] = [{"figure": 0, "label": "actor", "note": ""}]
    rows += [
        # Figure 1 is the last stage, the earlier ones follow from 2.
        {"figure": 1 if k == last else k + 2, "label": stage.label, "note": stage.note}
        for k, stage in enumerate(data.stages)
    ]
    times = data.strip_times
    if times is None:
        part = (np.arange(STRIP_COLUMNS) + 0.5) / STRIP_COLUMNS
        times = tuple(float(t) for t in data.time[0] + part * (data.time[-1] - data.time[0]))
    pictures = _stills(data, scene, rows, np.array(times)) if painted else [""] * len(rows)
    shown = [row | {"still": still} for row, still in zip(rows, pictures, strict=True)]
    return {"rows": shown, "times": list(times)}


def _stills(
    data: RetargetReport, scene: Scene, rows: list[dict[str, Any]], times: NDArray[np.float64]
) -> tuple[str, ...]:
    frames = np.abs(data.time[:, None] - times).argmin(axis=0)
    return stills(
        [
            Row(
                look="character" if row["figure"] else "actor",
                figure=scene.figures[row["figure"]],
                frames=frames,
            )
            for row in rows
        ]
    )


def _force_plots(data: RetargetReport) -> list[Chart]:
    """Yamane 2010 Figure 9: before and after on one scale."""
    force = data.force
    if force is None:
        return []
    pairs = {
        "before": ("Before, stage contacted", force.required_before, force.contact_before),
        "after": ("After, stage physical", force.required_after, force.contact_after),
    }
    charts = []
    for when, (title, required, supplied) in pairs.items():
        lines = [
            Series("contact model", supplied, "red"),
            Series("required", required, "blue", dashed=True),
        ]
        if when == "after" and force.bound is not None:
            lines.insert(0, Series("best possible", force.bound, "green"))
        rest = float(np.sqrt(np.nanmean((required - supplied) ** 2)))
        charts.append(
            Chart(
                id=f"force-{when}",
                title=title,
                unit="BW",
                series=tuple(lines),
                note=f"mismatch {number(rest)} BW RMS",
                levels=((1.0, "body weight"),),
                scale="force",
            )
        )
    return charts


def _displacement_plots(data: RetargetReport) -> list[Chart]:
    if data.force is None or data.force.displacement is None:
        return []
    line = Series("root moved by", 1000.0 * data.force.displacement, "green", fill=True)
    return [
        Chart(
            id="displacement",
            title="What the optimisation changed: the height of the root",
            unit="mm",
            series=(line,),
        )
    ]


def _variance_plots(data: RetargetReport) -> list[Chart]:
    if data.pose_variance is None:
        return []
    line = Series("uncertainty", data.pose_variance, "violet", fill=True)
    return [
        Chart(
            id="variance",
            title="Uncertainty of the mapped pose",
            unit="m",
            series=(line,),
            note="high where no key pose is near: pose a frame there next",
        )
    ]
