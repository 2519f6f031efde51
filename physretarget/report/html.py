"""HTML reports: one file each, with the replay, the charts and the findings on one clock.

Templates escape everything by default: names of clips, bodies and key poses may be hostile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

from physretarget import assets
from physretarget._version import __version__
from physretarget.clip import Clip
from physretarget.replay.clip import report_forces
from physretarget.replay.figures import Modelled, figure
from physretarget.replay.payload import payload, script_json
from physretarget.replay.scene import Forces, Mark, Scene
from physretarget.replay.web import asset, player_css, player_scripts
from physretarget.report.charts import (
    Chart,
    Lanes,
    Series,
    contact_lanes,
    finding_lanes,
    latent_plot,
)
from physretarget.report.retarget_data import RetargetReport
from physretarget.report.words import GROUPS, TILES, duration, look, number, pretty, quantity
from physretarget.validation import Report

Array = NDArray[np.float64]
MAX_ROWS = 300
STRIP_COLUMNS = 8


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
    """
    document = _document(report)
    active = contact_active if contact_active is not None else _clip_contacts(clip, character)
    marks = document_marks(document)
    scene = Scene(
        title=title or clip.name,
        time=clip.time,
        figures=(
            figure(
                character,
                clip.qpos,
                name=_file_name(document["model"].get("path")) or "character",
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
    wide += [*_finding_plots(marks), *_contact_plots(character, active)]
    return _page(
        "validation.html.j2",
        scene,
        plots=[*wide, *rest],
        context={
            "title": scene.title,
            "model_name": _file_name(document["model"].get("path")) or "model",
            "tiles": _measure_tiles(document),
            "plots": wide,
            "more_plots": rest,
            "filter_note": _filter_note(document),
            "sections": _facts(_document_sections(document)),
            **_judgement(document),
        },
    )


def render_retarget_html(data: RetargetReport) -> str:
    """The page of one retargeting: replay, stages, forces, momentum, latent space, findings."""
    document = None if data.report is None else _document(data.report)
    marks = () if document is None else document_marks(document)
    scene = retarget_scene(data, marks)
    force = _force_plots(data)
    more: list[Chart | Lanes] = [*_displacement_plots(data)]
    more += _contact_plots(data.character, data.contact_active)
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
    findings = _finding_plots(marks)
    latent = [latent_plot(item) for item in data.latent]
    return _page(
        "retarget.html.j2",
        scene,
        plots=[*force, *more, *momentum, *variance, *findings],
        latent=[plot.points for plot in latent],
        strip=_strip(data),
        context={
            "title": data.title,
            "capture": data.capture,
            "character_name": data.character_name,
            "rows": data.stages,
            "tiles": [
                {
                    "label": item.label,
                    "value": number(item.value),
                    "unit": item.unit,
                    "note": item.note,
                    "good": item.good,
                    "frame": None,
                }
                for item in data.numbers
            ],
            "notes": data.notes,
            "force_plots": force,
            "more_plots": more,
            "momentum_plots": momentum,
            "variance_plots": variance,
            "finding_plots": findings,
            "latent": latent,
            "sections": _facts({**_document_sections(document), **data.sections}),
            **_judgement(document),
        },
    )


# ---- the scene ------------------------------------------------------------------------------


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


def _strip(data: RetargetReport) -> dict[str, Any]:
    last = len(data.stages) - 1
    rows = [{"figure": 0, "label": "actor", "note": ""}]
    rows += [
        # Figure 1 is the last stage, the earlier ones follow from 2.
        {"figure": 1 if k == last else k + 2, "label": stage.label, "note": stage.note}
        for k, stage in enumerate(data.stages)
    ]
    times = data.strip_times
    if times is None:
        part = (np.arange(STRIP_COLUMNS) + 0.5) / STRIP_COLUMNS
        times = tuple(float(t) for t in data.time[0] + part * (data.time[-1] - data.time[0]))
    return {"rows": rows, "times": list(times)}


def document_marks(document: Mapping[str, Any]) -> tuple[Mark, ...]:
    """The findings of a JSON report that have a place in time, in the document's order."""
    return tuple(
        Mark(
            code=f["code"],
            severity=f["severity"],
            message=f["message"],
            frame_first=f["frame_first"],
            frame_last=f["frame_first"] if f.get("frame_last") is None else f["frame_last"],
            frame=f.get("frame"),
        )
        for f in document["findings"]
        if f.get("frame_first") is not None
    )


def _clip_contacts(clip: Clip, character: Modelled) -> NDArray[np.bool_] | None:
    """The clip's contact flags, where its points are the character's."""
    if clip.contact_active is None or clip.contact_points != tuple(character.contacts.names):
        return None
    return clip.contact_active


def _forces(report: Any, clip: Clip) -> Forces | None:
    """Arrows from a report's own series; its JSON form carries none."""
    return report_forces(report, clip.frames) if isinstance(report, Report) else None


# ---- charts ---------------------------------------------------------------------------------


def _finding_plots(marks: Sequence[Mark]) -> list[Lanes]:
    lanes = finding_lanes(marks)
    return [Lanes("findings", "Findings over time", lanes)] if lanes else []


def _contact_plots(character: Modelled, active: NDArray[np.bool_] | None) -> list[Lanes]:
    if active is None or active.shape[1] == 0:
        return []
    lanes = contact_lanes(character.contacts.names, active)
    return [Lanes("contacts", "Contacts", lanes, note="green while a point stands")]


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


def _force_plots(data: RetargetReport) -> list[Chart]:
    """Yamane 2010 Figure 9: before and after on one scale."""
    force = data.force
    if force is None:
        return []
    pairs = {
        "before": ("Before the optimisation", force.required_before, force.contact_before),
        "after": ("After the optimisation", force.required_after, force.contact_after),
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


def _ranges(plots: Sequence[Chart | Lanes]) -> dict[str, list[float]]:
    """The y range of every shared scale."""
    values: dict[str, list[Array]] = {}
    for plot in plots:
        if isinstance(plot, Chart) and plot.scale:
            values.setdefault(plot.scale, []).extend(s.values for s in plot.series)
    ranges = {}
    for scale, tracks in values.items():
        joined = np.concatenate(tracks)
        low, high = min(float(np.nanmin(joined)), 0.0), float(np.nanmax(joined))
        margin = 0.05 * max(high - low, 1e-6)
        ranges[scale] = [low - margin, high + margin]
    return ranges


# ---- the words ------------------------------------------------------------------------------


def _document(report: Any) -> Mapping[str, Any]:
    document: Mapping[str, Any] = report if isinstance(report, Mapping) else report.to_dict()
    return document


def _judgement(document: Mapping[str, Any] | None) -> dict[str, Any]:
    """What the template needs of a report, whether or not there is one."""
    if document is None:
        document = {"summary": None, "findings": [], "coverage": [], "measures": {}}
    findings, coverage = document["findings"], document["coverage"]
    return {
        "judged": document["summary"] is not None,
        "summary": document["summary"],
        "findings": [_finding_row(f) for f in findings[:MAX_ROWS]],
        "findings_hidden": max(len(findings) - MAX_ROWS, 0),
        "coverage": sorted(coverage, key=lambda c: (c["status"] == "checked", c["code"])),
        "covered": sum(c["status"] == "checked" for c in coverage),
        "measures": [
            {
                "name": name,
                "value": number(m["value"], 4),
                "unit": pretty(m["unit"]),
                "frame": m.get("frame"),
            }
            for name, m in document["measures"].items()
        ],
    }


def _finding_row(finding: Mapping[str, Any]) -> dict[str, Any]:
    first, last = finding.get("frame_first"), finding.get("frame_last")
    seconds, worst = finding.get("time_s"), finding.get("frame")
    value, unit = quantity(finding.get("value"), finding.get("unit") or "")
    limit, limit_unit = quantity(finding.get("limit"), finding.get("unit") or "")
    span = "" if first is None else f"frame {first}"
    if first is not None and last is not None and last != first:
        span = f"frames {first}–{last}"
    return {
        **{key: finding.get(key) or "" for key in ("code", "rule", "severity", "message", "body")},
        "frame_first": first if worst is None else worst,
        "frames": span,
        "when": "whole clip" if seconds is None else f"{seconds:.2f} s",
        "value": "" if finding.get("value") is None else f"{value} {unit}".strip(),
        "limit": "" if finding.get("limit") is None else f"{limit} {limit_unit}".strip(),
    }


def _measure_tiles(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    tiles = []
    for name, label in TILES.items():
        measure = document["measures"].get(name)
        if measure is None or measure["value"] is None:
            continue
        value, unit = quantity(measure["value"], measure["unit"])
        tiles.append(
            {
                "label": label,
                "value": value,
                "unit": unit,
                "note": "",
                "good": None,
                "frame": measure.get("frame"),
            }
        )
    return tiles[:8]


def _filter_note(document: Mapping[str, Any]) -> str:
    hz = document.get("settings", {}).get("lowpass_hz")
    if hz is None:
        return "Every figure is taken without a filter."
    return f"Every figure is taken after a low-pass of {number(float(hz))} Hz."


def _document_sections(document: Mapping[str, Any] | None) -> dict[str, dict[str, object]]:
    if document is None:
        return {}
    titles = {"clip": "Clip", "model": "Model", "settings": "Settings of the validation"}
    sections: dict[str, dict[str, object]] = {
        title: dict(document[key]) for key, title in titles.items() if key in document
    }
    return {**sections, "Tool": dict(document.get("tool", {}))}


def _facts(sections: Mapping[str, Mapping[str, object]]) -> list[tuple[str, list[Any]]]:
    """Sections as readable pairs; empty ones are left out."""
    return [
        (name, [(key.replace("_", " "), _fact(key, value)) for key, value in pairs.items()])
        for name, pairs in sections.items()
        if pairs
    ]


def _fact(key: str, value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_fact(k, v)}" for k, v in value.items()) or "–"
    if isinstance(value, list | tuple):
        return " · ".join(_fact(key, item) for item in value) or "–"
    if key == "duration_s" and isinstance(value, float):
        return duration(value)
    return number(value, 4)


def _file_name(path: Any) -> str:
    return str(path or "").replace("\\", "/").rsplit("/", 1)[-1]


# ---- the page -------------------------------------------------------------------------------


@cache
def templates() -> Environment:
    return Environment(
        loader=PackageLoader("physretarget.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _source(name: str) -> str:
    loader = templates().loader
    assert loader is not None
    return loader.get_source(templates(), name)[0]


def _page(
    template: str,
    scene: Scene,
    *,
    plots: Sequence[Chart | Lanes],
    context: Mapping[str, Any],
    latent: Sequence[dict[str, Any]] = (),
    strip: dict[str, Any] | None = None,
) -> str:
    ranges = _ranges(plots)
    charts = {plot.id: plot.data() for plot in plots}
    for chart in charts.values():
        if chart.get("scale") in ranges:
            chart["range"] = ranges[chart["scale"]]
    data = {
        "scene": payload(scene),
        "charts": charts,
        "latent": list(latent),
        "strip": strip,
        "spans": [[m.frame_first, m.frame_last] for m in scene.marks],
        "autoplay": strip is not None,
    }
    ours = Markup(asset("filmstrip.js")), Markup(_source("report.js"))
    return (
        templates()
        .get_template(template)
        .render(
            version=__version__,
            css={
                "uplot": Markup(assets.text("uPlot.min.css")),
                "player": player_css(),
                "report": Markup(_source("report.css")),
            },
            scripts=(*player_scripts(), Markup(assets.text("uPlot.iife.min.js")), *ours),
            data_json=Markup(script_json(data)),
            **context,
        )
    )


__all__ = ["document_marks", "render_html", "render_retarget_html", "retarget_scene"]
