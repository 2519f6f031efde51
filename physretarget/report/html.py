"""The page of one validation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.clip import Clip
from physretarget.replay.clip import report_forces
from physretarget.replay.figures import Modelled, figure
from physretarget.replay.scene import Forces, Scene
from physretarget.report.charts import Chart, Lanes, Series
from physretarget.report.document import (
    as_document,
    document_marks,
    document_sections,
    facts,
    file_name,
    filter_note,
    judgement,
    measure_tiles,
)
from physretarget.report.page import contact_plots, finding_plots, render_page
from physretarget.report.words import GROUPS, look
from physretarget.validation import Report

Array = NDArray[np.float64]


def render_html(
    report: Any,
    clip: Clip,
    character: Modelled,
    *,
    contact_active: NDArray[np.bool_] | None = None,
    forces: Forces | None = None,
    title: str | None = None,
) -> str:
    """The page of one validation.

    Args:
        report: a :class:`~physretarget.validation.report.Report`, or its JSON document.
        clip: the motion that was judged.
        character: the model that it was judged with.
        contact_active: (T, K) of the character's contact points; the clip's own if None.
        forces: arrows to draw, in body weights.
        title: headline, the clip's name if None.

    Returns:
        The page, HTML.
    """
    document = as_document(report)
    active = contact_active if contact_active is not None else _clip_contacts(clip, character)
    marks = document_marks(document)
    scene = Scene(
        title=title or clip.name,
        time=clip.time,
        figures=(
            figure(
                character,
                clip.qpos,
                name=file_name(document["model"].get("path")) or "character",
                tint=(0.42, 0.52, 0.70),
                contact_active=active,
                forces=forces if forces is not None else _forces(report, clip),
            ),
        ),
        marks=marks,
    )
    charts = _series_charts(getattr(report, "series", {}), clip.frames)
    first = [chart for chart in charts if chart.id == "series-force"]
    rest = [chart for chart in charts if chart.id != "series-force"]
    wide: list[Chart | Lanes] = [*first]
    wide += [*finding_plots(marks), *contact_plots(character, active)]
    return render_page(
        "validation.html.j2",
        scene,
        plots=[*wide, *rest],
        context={
            "title": scene.title,
            "model_name": file_name(document["model"].get("path")) or "model",
            "tiles": measure_tiles(document),
            "plots": wide,
            "more_plots": rest,
            "filter_note": filter_note(document),
            "sections": facts(document_sections(document)),
            **judgement(document),
        },
    )


def _clip_contacts(clip: Clip, character: Modelled) -> NDArray[np.bool_] | None:
    """The clip's contact flags, where its points are the character's."""
    if clip.contact_active is None or clip.contact_points != tuple(character.contacts.names):
        return None
    return clip.contact_active


def _forces(report: Any, clip: Clip) -> Forces | None:
    """Arrows from a report's own series; its JSON form carries none."""
    return report_forces(report, clip.frames) if isinstance(report, Report) else None


def _series_charts(series: Mapping[str, Array], frames: int) -> list[Chart]:
    """A report's per-frame series, those of one group in one chart."""
    groups: dict[str, list[Series]] = {}
    units: dict[str, str] = {}
    for name, values in series.items():
        style = look(name)
        values = np.asarray(values)
        if style is None or values.shape != (frames,) or not np.isfinite(values).any():
            continue
        groups.setdefault(style.group, []).append(
            Series(style.label, values.astype(np.float64), style.ink, dashed=style.dashed)
        )
        units[style.group] = style.unit
    order = [*GROUPS, *(group for group in groups if group not in GROUPS)]
    return [
        Chart(
            id=f"series-{group}",
            title=GROUPS.get(group, groups[group][0].label),
            unit=units[group],
            series=tuple(groups[group]),
            levels=((1.0, "body weight"), (0.0, "")) if group == "force" else (),
        )
        for group in order
        if group in groups
    ]
