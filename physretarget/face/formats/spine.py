"""Spine JSON (3.x and 4.x), read only: the bone timelines of every animation, one shot each.

Before 4.0 a rotation takes the shorter way round and handles are shares of their span; since then
values are as they stand and handles absolute. A file without a version is told by its key fields.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from os import PathLike
from typing import Any

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key, TangentType
from physretarget.face.formats.source import Source, mapping, number, numbers, sequence
from physretarget.face.shot import Shot

_COMPONENTS = {
    "rotate": ("value",),
    "translate": ("x", "y"),
    "scale": ("x", "y"),
    "shear": ("x", "y"),
    "translatex": ("value",),
    "translatey": ("value",),
    "scalex": ("value",),
    "scaley": ("value",),
    "shearx": ("value",),
    "sheary": ("value",),
}
_Handles = tuple[float, float, float, float]  # offsets: out dx, out dy, in dx, in dy
_OLD_FIELDS = frozenset(("angle", "c2", "c3", "c4"))


def is_spine(content: Any) -> bool:
    """Whether parsed JSON looks like Spine."""
    return isinstance(content, dict) and "animations" in content and "bones" in content


def read_spine(path: str | PathLike[str] | Source) -> tuple[Shot, ...]:
    """Read every animation as a shot; channels are ``bone.timeline[.axis]``."""
    source = path if isinstance(path, Source) else Source.open(path)
    content = mapping(source, "file", source.json())
    skeleton = mapping(source, "skeleton", content.get("skeleton", {}))
    animations = mapping(source, "animations", content.get("animations"))
    version = skeleton.get("spine") or ("3" if _is_old(animations) else "4")
    absolute = not str(version).startswith(("2", "3"))
    shots = []
    for name, item in animations.items():
        bones = mapping(source, name, mapping(source, name, item).get("bones", {}))
        curves: dict[str, Curve] = {}
        for bone, timelines in bones.items():
            for kind, keys in mapping(source, bone, timelines).items():
                where = f"{name}: {bone}.{kind}"
                curves |= _timeline(source, where, f"{bone}.{kind}", kind, keys, absolute)
        shots.append(Shot(f"{source.path.stem}:{name}", curves, None, source.sha256))
    return tuple(shots)


def _is_old(content: Any) -> bool:
    """Whether any key, an entry of a list, has fields that version 4 does not know."""
    waiting = [content]  # not by recursion: files nest as deep as they like
    while waiting:
        part = waiting.pop()
        if isinstance(part, dict):
            waiting.extend(part.values())
        elif isinstance(part, list):
            keys = (key for key in part if isinstance(key, dict))
            if any(not _OLD_FIELDS.isdisjoint(key) for key in keys):
                return True
            waiting.extend(part)
    return False


def _shorter_way(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Angles (degrees) that follow each other by at most half a turn."""
    turned = points[:1]
    for time, angle in points[1:]:
        last = turned[-1][1]
        turned.append((time, last + (angle - last + 180.0) % 360.0 - 180.0))
    return turned


def _timeline(
    source: Source, where: str, label: str, kind: str, keys: Any, absolute: bool
) -> dict[str, Curve]:
    items = [mapping(source, where, key) for key in sequence(source, where, keys)]
    if kind not in _COMPONENTS or not items:
        return {}
    names = _COMPONENTS[kind]
    curves = {}
    for axis, component in enumerate(names):
        fields = (component, "angle") if kind == "rotate" else (component,)
        rest = 1.0 if kind.startswith("scale") else 0.0
        points = [_point(source, where, item, fields, rest) for item in items]
        if kind == "rotate" and not absolute:
            points = _shorter_way(points)
        spans = list(_spans(source, where, items, points, axis, absolute))
        channel = label if len(names) == 1 else f"{label}.{component}"
        try:
            curves[channel] = _curve(points, spans)
        except InputError as error:
            raise InputError(f"{where}: {error}", path=source.path) from error
    return curves


def _point(
    source: Source, where: str, item: dict[str, Any], fields: tuple[str, ...], rest: float
) -> tuple[float, float]:
    value = next((item[f] for f in fields if f in item), rest)
    return number(source, where, item.get("time", 0.0)), number(source, where, value)


def _spans(
    source: Source,
    where: str,
    items: list[dict[str, Any]],
    points: list[tuple[float, float]],
    axis: int,
    absolute: bool,
) -> Iterator[_Handles | None]:
    """Tangents of every span, None where it is stepped."""
    for k, ((t0, v0), (t1, v1)) in enumerate(pairwise(points)):
        curve = items[k].get("curve", "linear")
        width, rise = t1 - t0, v1 - v0
        if curve == "stepped":
            yield None
        elif curve == "linear":
            yield (width / 3, rise / 3, -width / 3, -rise / 3)
        elif absolute:
            c = numbers(source, f"{where}, key {k}", curve)
            if len(c) < 4 * (axis + 1):
                source.fail(f"{where}, key {k}", "its curve has too few numbers.")
            x1, y1, x2, y2 = c[4 * axis : 4 * axis + 4]
            x1, x2 = min(max(x1, t0), t1), min(max(x2, t0), t1)
            yield (max(x1 - t0, 0.0), y1 - v0, min(x2 - t1, 0.0), y2 - v1)
        else:
            rests = (("c2", 0.0), ("c3", 1.0), ("c4", 1.0))
            given = (
                curve
                if isinstance(curve, list)
                else [curve, *(items[k].get(c, rest) for c, rest in rests)]
            )
            x1, y1, x2, y2 = numbers(source, f"{where}, key {k}", given, 4)
            x1, x2 = min(max(x1, 0.0), 1.0), min(max(x2, 0.0), 1.0)
            yield (x1 * width, y1 * rise, (x2 - 1) * width, (y2 - 1) * rise)


def _curve(points: list[tuple[float, float]], spans: list[_Handles | None]) -> Curve:
    keys = []
    for k, (time, value) in enumerate(points):
        before = spans[k - 1] if k else (0.0, 0.0, 0.0, 0.0)
        after = spans[k] if k < len(spans) else (0.0, 0.0, 0.0, 0.0)
        in_type: TangentType = "stepped" if before is None else "fixed"
        out_type: TangentType = "stepped" if after is None else "fixed"
        into = (0.0, 0.0) if before is None else (min(before[2], 0.0), before[3])
        out = (0.0, 0.0) if after is None else (max(after[0], 0.0), after[1])
        keys.append(Key(time, value, into, out, in_type, out_type, True))
    return Curve(tuple(keys))
