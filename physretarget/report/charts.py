"""Charts of the HTML reports as data: the browser draws them on the replay's clock."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import runs
from physretarget.replay.payload import pack
from physretarget.replay.scene import Mark
from physretarget.report.retarget_data import LatentMap

Array = NDArray[np.float64]
# Colours are names; the style sheet gives each a value for light and for dark pages.
Ink = Literal["blue", "red", "green", "amber", "violet", "grey"]


@dataclass(frozen=True, eq=False)
class Series:
    """One line: ``values`` (T,), NaN for gaps. ``fill`` shades down to zero."""

    label: str
    values: Array
    ink: Ink
    dashed: bool = False
    fill: bool = False


@dataclass(frozen=True, eq=False)
class Chart:
    """Lines over the clip's time; ``levels`` are horizontal reference lines with a label.

    Charts with the same ``scale`` share the range of their y axis.
    """

    id: str
    title: str
    unit: str
    series: tuple[Series, ...]
    note: str = ""
    levels: tuple[tuple[float, str], ...] = ()
    scale: str = ""

    def data(self) -> dict[str, Any]:
        """JSON-able form."""
        return {
            "id": self.id,
            "title": self.title,
            "unit": self.unit,
            "levels": [[value, label] for value, label in self.levels],
            "range": None,
            "scale": self.scale,
            "series": [
                {
                    "label": s.label,
                    "ink": s.ink,
                    "dashed": s.dashed,
                    "fill": s.fill,
                    "values": pack(s.values),
                }
                for s in self.series
            ],
        }


@dataclass(frozen=True, eq=False)
class Lane:
    """One row of spans over time: (first frame, last frame, ink, label), inclusive."""

    label: str
    spans: tuple[tuple[int, int, str, str], ...]


@dataclass(frozen=True, eq=False)
class Lanes:
    """Rows of spans on the clock: contacts, findings."""

    id: str
    title: str
    lanes: tuple[Lane, ...]
    note: str = ""

    def data(self) -> dict[str, Any]:
        """JSON-able form."""
        return {
            "id": self.id,
            "title": self.title,
            "lanes": [{"label": x.label, "spans": [list(s) for s in x.spans]} for x in self.lanes],
        }


@dataclass(frozen=True, eq=False)
class LatentPlot:
    """A latent map ready for the template: coordinates in the SVG's 0..100 box, y down."""

    label: str
    image: str
    path: str
    own: tuple[tuple[float, float, str], ...]
    other: tuple[tuple[float, float, str], ...]
    points: dict[str, Any] = field(repr=False)


def contact_lanes(names: Sequence[str], active: NDArray[np.bool_]) -> tuple[Lane, ...]:
    """A lane per contact point, green while it stands."""
    return tuple(
        Lane(
            name.removeprefix("contact_").replace("_", " "),
            tuple((a, b, "green", "stands") for a, b in runs(active[:, k])),
        )
        for k, name in enumerate(names)
    )


def finding_lanes(marks: Iterable[Mark]) -> tuple[Lane, ...]:
    """A lane per code, the gravest first."""
    inks = {"error": "red", "warning": "amber", "info": "blue"}
    order = {"error": 0, "warning": 1, "info": 2}
    spans: dict[str, list[tuple[int, int, str, str]]] = {}
    worst: dict[str, int] = {}
    for mark in marks:
        span = (mark.frame_first, mark.frame_last, inks[mark.severity], mark.message)
        spans.setdefault(mark.code, []).append(span)
        worst[mark.code] = min(worst.get(mark.code, 9), order[mark.severity])
    codes = sorted(spans, key=lambda code: (worst[code], code))
    return tuple(Lane(code, tuple(spans[code])) for code in codes)


def latent_plot(latent: LatentMap) -> LatentPlot:
    """Project a latent map into the box of its drawing and paint its variance."""
    x0, x1, y0, y1 = latent.extent
    size = np.array([max(x1 - x0, 1e-12), max(y1 - y0, 1e-12)])

    def boxed(points: Array) -> Array:
        part = (np.asarray(points, dtype=np.float64) - (x0, y0)) / size
        return np.stack([100 * part[:, 0], 100 * (1 - part[:, 1])], axis=1)

    way = boxed(latent.trajectory)
    keys = [
        (round(float(x), 2), round(float(y), 2), name, bool(own))
        for (x, y), name, own in zip(boxed(latent.key_poses), latent.names, latent.own, strict=True)
    ]
    return LatentPlot(
        label=latent.label,
        image=variance_image(latent.variance),
        path="M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in way),
        own=tuple((x, y, name) for x, y, name, own in keys if own),
        other=tuple((x, y, name) for x, y, name, own in keys if not own),
        points=pack(way),
    )


def variance_image(variance: Array) -> str:
    """The variance map as a PNG data address: pale where key poses are near."""
    from matplotlib import colormaps
    from matplotlib.image import imsave

    low, high = float(np.min(variance)), float(np.max(variance))
    part = (variance - low) / max(high - low, 1e-12)
    # Only the paler part of the map: lines must stay readable on it.
    pixels = colormaps["PuBu"](0.02 + 0.58 * part)[::-1]
    content = io.BytesIO()
    # No version of the drawing library in the bytes: same inputs, same page.
    nameless: dict[str, Any] = {"Software": None}
    imsave(content, pixels, format="png", metadata=nameless)
    return "data:image/png;base64," + base64.b64encode(content.getvalue()).decode("ascii")
