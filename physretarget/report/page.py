"""One self-contained page: replay, charts and findings on one clock.

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
from physretarget.replay.figures import Modelled
from physretarget.replay.payload import payload, script_json
from physretarget.replay.scene import Mark, Scene
from physretarget.replay.web import asset, player_css, player_scripts
from physretarget.report.charts import Chart, Lanes, contact_lanes, finding_lanes

Array = NDArray[np.float64]


@cache
def templates() -> Environment:
    """The room's templates; what they print is escaped unless it is Markup."""
    return Environment(
        loader=PackageLoader("physretarget.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def render_page(
    template: str,
    scene: Scene,
    *,
    plots: Sequence[Chart | Lanes],
    context: Mapping[str, Any],
    latent: Sequence[dict[str, Any]] = (),
    strip: dict[str, Any] | None = None,
) -> str:
    """Fill a template and put the scene, the charts and all code inside it."""
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


def _source(name: str) -> str:
    loader = templates().loader
    assert loader is not None
    return loader.get_source(templates(), name)[0]


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


def finding_plots(marks: Sequence[Mark]) -> list[Lanes]:
    """One lane per code, where there are findings with a place in time."""
    lanes = finding_lanes(marks)
    return [Lanes("findings", "Findings over time", lanes)] if lanes else []


def contact_plots(character: Modelled, active: NDArray[np.bool_] | None) -> list[Lanes]:
    """One lane per contact point, where the contacts are known."""
    if active is None or active.shape[1] == 0:
        return []
    lanes = contact_lanes(character.contacts.names, active)
    return [Lanes("contacts", "Contacts", lanes, note="green while a point stands")]
