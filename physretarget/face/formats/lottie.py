"""Lottie JSON: the keyed transform channels of its layers, in and out.

Read are position, rotation, scale, opacity and anchor of layers, of groups inside shape layers
and slider effects; vector paths, colours and time remaps are not curves of one number and are
left out. A span's easing ``o``, ``i`` is relative to the span; it becomes absolute tangents.
Motion along a bent path (``to``/``ti``) is no Bézier in its components: each component's span is
fitted with one cubic and the largest deviation is stated in the shot's notes.

Written: one null layer per layer name; ``position.x/.y`` split, so that key times stay
independent; every other channel as a slider effect of the same name.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key, TangentType
from physretarget.face.formats.source import Source, mapping, number, numbers, sequence
from physretarget.face.shot import Shot
from physretarget.files import write_file

Array = NDArray[np.float64]
_PROPERTIES = {
    "p": "position",
    "r": "rotation",
    "s": "scale",
    "o": "opacity",
    "a": "anchor",
    "rz": "rotation",
}
_AXES = ("x", "y", "z")
_DEPTH = 64


@dataclass(frozen=True)
class _Span:
    """One keyframe as stored: the easing belongs to the span that begins here."""

    time: float
    value: list[float]
    out_x: list[float]
    out_y: list[float]
    in_x: list[float]
    in_y: list[float]
    held: bool
    bend_out: Array | None
    bend_in: Array | None


def is_lottie(content: Any) -> bool:
    """Whether parsed JSON looks like Lottie."""
    return isinstance(content, dict) and "layers" in content and "fr" in content


def read_lottie(path: str | PathLike[str] | Source) -> Shot:
    """Read every animated transform channel; names are ``layer/group.property[.axis]``."""
    source = path if isinstance(path, Source) else Source.open(path)
    content = mapping(source, "file", source.json())
    rate = number(source, "fr", content.get("fr"))
    if rate <= 0:
        source.fail("fr", f"a frame rate of {rate:g} is not usable.")
    curves: dict[str, Curve] = {}
    notes: list[str] = []
    for name, entry in _animated(source, content):
        for axis, curve in _channel(source, name, entry, rate, notes):
            label = f"{name}.{axis}" if axis else name
            unique, count = label, 2
            while unique in curves:
                unique, count = f"{label}#{count}", count + 1
            curves[unique] = curve
    return Shot(source.path.stem, curves, rate, source.sha256, tuple(notes))


def _animated(source: Source, content: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    layers = list(sequence(source, "layers", content.get("layers")))
    for asset in sequence(source, "assets", content.get("assets", [])):
        if isinstance(asset, dict) and "layers" in asset:
            layers += sequence(source, "asset layers", asset["layers"])
    for index, item in enumerate(layers):
        layer = mapping(source, f"layer {index}", item)
        name = str(layer.get("nm", "")).strip() or f"layer{index}"
        yield from _transform(source, name, mapping(source, name, layer.get("ks", {})))
        yield from _groups(source, name, layer.get("shapes", []), 0)
        for effect in sequence(source, name, layer.get("ef", [])):
            yield from _sliders(source, name, effect)


def _groups(
    source: Source, name: str, items: Any, depth: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    if depth > _DEPTH:
        source.fail(name, f"groups nested deeper than {_DEPTH}.")
    for item in sequence(source, name, items):
        shape = mapping(source, name, item)
        if shape.get("ty") == "tr":
            yield from _transform(source, name, shape)
        elif shape.get("ty") == "gr":
            inner = f"{name}/{str(shape.get('nm', '')).strip() or 'group'}"
            yield from _groups(source, inner, shape.get("it", []), depth + 1)


def _transform(
    source: Source, name: str, owner: dict[str, Any]
) -> Iterator[tuple[str, dict[str, Any]]]:
    for short, long in _PROPERTIES.items():
        entry = owner.get(short)
        if not isinstance(entry, dict):
            continue
        if entry.get("s") is True:
            for axis in _AXES:
                part = entry.get(axis)
                if isinstance(part, dict) and _is_keyed(part):
                    yield f"{name}.{long}.{axis}", part
        elif _is_keyed(entry):
            yield f"{name}.{long}", entry


def _sliders(source: Source, name: str, effect: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    group = mapping(source, name, effect)
    for part in sequence(source, name, group.get("ef", [])):
        slider = mapping(source, name, part)
        value = slider.get("v")
        if slider.get("ty") == 0 and isinstance(value, dict) and _is_keyed(value):
            yield f"{name}.{group.get('nm', 'slider')!s}", value


def _is_keyed(entry: dict[str, Any]) -> bool:
    keys = entry.get("k")
    return isinstance(keys, list) and bool(keys) and isinstance(keys[0], dict)


def _channel(
    source: Source, name: str, entry: dict[str, Any], rate: float, notes: list[str]
) -> list[tuple[str, Curve]]:
    spans = _spans(source, name, entry, rate, notes)
    width = min(len(span.value) for span in spans)
    if width == 0:
        source.fail(f"channel {name}", "keys hold no values.")
    vector = len(spans[0].value) > 1
    found = []
    for axis in range(min(width, 3)):
        label = _AXES[axis] if vector else ""
        try:
            found.append((label, _component(spans, axis, f"{name}.{label}", notes)))
        except InputError as error:
            raise InputError(f"channel {name}: {error}", path=source.path) from error
    return found


def _spans(
    source: Source, name: str, entry: dict[str, Any], rate: float, notes: list[str]
) -> list[_Span]:
    spans: list[_Span] = []
    end: Any = None
    for index, item in enumerate(entry["k"]):
        where = f"channel {name}, key {index}"
        key = mapping(source, where, item)
        value = key.get("s", end)
        if value is None:
            source.fail(where, "no value (s).")
        end = key.get("e")
        span = _span(source, where, key, numbers(source, where, value), rate)
        if spans and span.time < spans[-1].time:
            source.fail(where, f"its time {key['t']} comes before the key ahead of it.")
        if spans and span.time == spans[-1].time:
            before = spans.pop()
            floor = spans[-1].time if spans else before.time - 1.0
            early = max(before.time - 1e-3 / rate, 0.5 * (floor + before.time))
            spans.append(_Span(early, before.value, [0.0], [0.0], [1.0], [1.0], True, None, None))
            notes.append(f"{where}: shares its time with the key ahead, which moved 0.001 frames.")
        spans.append(span)
    return spans


def _span(
    source: Source, where: str, key: dict[str, Any], value: list[float], rate: float
) -> _Span:
    ease: dict[str, list[float]] = {}
    for side, rest in (("o", 0.0), ("i", 1.0)):
        handle = mapping(source, where, key.get(side, {}))
        for axis in ("x", "y"):
            ease[side + axis] = numbers(source, where, handle.get(axis, rest)) or [rest]
    for side in ("ox", "ix"):
        ease[side] = [min(1.0, max(0.0, x)) for x in ease[side]]
    bends = [
        np.array(numbers(source, where, key[b]), float) if key.get(b) is not None else None
        for b in ("to", "ti")
    ]
    time = number(source, where, key.get("t")) / rate
    held = key.get("h") == 1
    return _Span(
        time, value, ease["ox"], ease["oy"], ease["ix"], ease["iy"], held, bends[0], bends[1]
    )


def _component(spans: list[_Span], axis: int, name: str, notes: list[str]) -> Curve:
    count = len(spans)
    ins: list[tuple[float, float]] = [(0.0, 0.0)] * count
    outs: list[tuple[float, float]] = [(0.0, 0.0)] * count
    kinds: list[TangentType] = ["fixed"] * count
    for k, (left, right) in enumerate(pairwise(spans)):
        if left.held:
            kinds[k] = "stepped"
            continue
        width = right.time - left.time
        rise = right.value[axis] - left.value[axis]
        x1, y1, x2, y2 = (
            part[min(axis, len(part) - 1)]
            for part in (left.out_x, left.out_y, left.in_x, left.in_y)
        )
        dy1, dy2 = y1 * rise, (y2 - 1.0) * rise
        if _is_bent(left, right):
            dy1, dy2, worst = _fit_bent(left, right, axis, (x1, y1, x2, y2))
            if worst > 1e-6:
                notes.append(f"{name}, key {k}: bent path fitted, off by at most {worst:.3g}.")
        outs[k], ins[k + 1] = (x1 * width, dy1), ((x2 - 1.0) * width, dy2)
    keys = tuple(
        Key(s.time, s.value[axis], ins[k], outs[k], kinds[k - 1] if k else "fixed", kinds[k], True)
        for k, s in enumerate(spans)
    )
    return Curve(keys)


def _is_bent(left: _Span, right: _Span) -> bool:
    if left.bend_out is None or left.bend_in is None:
        return False
    return bool(np.abs(left.bend_out).max(initial=0) + np.abs(left.bend_in).max(initial=0) > 1e-9)


def _fit_bent(
    left: _Span, right: _Span, axis: int, ease: tuple[float, float, float, float]
) -> tuple[float, float, float]:
    """Handle heights of one component on a bent path, easing measured along the arc."""
    assert left.bend_out is not None
    assert left.bend_in is not None
    size = min(len(left.value), len(right.value), len(left.bend_out), len(left.bend_in))
    if axis >= size:
        rise = right.value[axis] - left.value[axis]
        return ease[1] * rise, (ease[3] - 1.0) * rise, 0.0
    start, end = np.array(left.value[:size]), np.array(right.value[:size])
    points = np.stack([start, start + left.bend_out[:size], end + left.bend_in[:size], end])
    path = _bernstein(np.linspace(0.0, 1.0, 257)) @ points
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    u = np.linspace(0.0, 1.0, 65)
    basis = _bernstein(u)
    progress = basis @ np.array([0.0, ease[1], ease[3], 1.0])
    truth = np.interp(progress * arc[-1], arc, path[:, axis])
    ends = basis[:, 0] * start[axis] + basis[:, 3] * end[axis]
    handles, *_ = np.linalg.lstsq(basis[:, 1:3], truth - ends, rcond=None)
    worst = float(np.abs(basis[:, 1:3] @ handles + ends - truth).max())
    return float(handles[0] - start[axis]), float(handles[1] - end[axis]), worst


def _bernstein(u: Array) -> Array:
    v = 1.0 - u
    return np.stack([v**3, 3 * v * v * u, 3 * v * u * u, u**3], axis=1)


def write_lottie(path: str | PathLike[str], shot: Shot) -> tuple[str, ...]:
    """Write a shot; returns what was lost, one sentence each.

    Curves keep their shape; a span whose ends are level but whose tangents are not has no
    Lottie easing and is written as two spans.
    """
    rate = shot.fps or 60.0
    layers: dict[str, dict[str, Any]] = {}
    losses: list[str] = []
    for name, curve in shot.curves.items():
        layer, _, rest = name.partition(".")
        entry = layers.setdefault(layer, _null_layer(layer, len(layers) + 1))
        keyed = {"a": 1, "k": _keyframes(name, curve, rate, losses)}
        if rest in ("position.x", "position.y"):
            entry["ks"]["p"][rest[-1]] = keyed
        elif rest in ("rotation", "opacity"):
            entry["ks"][rest[0]] = keyed
        else:
            control = {"ty": 0, "nm": "Slider", "v": keyed}
            entry["ef"].append({"ty": 5, "nm": rest or "value", "ef": [control]})
    last = max((c.end for c in shot.curves.values()), default=0.0) * rate
    content = {
        "v": "5.9.0",
        "fr": rate,
        "ip": 0,
        "op": last + 1.0,
        "w": 512,
        "h": 512,
        "nm": shot.name,
        "ddd": 0,
        "assets": [],
        "layers": list(layers.values()),
    }
    for layer_entry in layers.values():
        layer_entry["op"] = last + 1.0
    write_file(path, json.dumps(content).encode())
    return tuple(losses)


def _null_layer(name: str, index: int) -> dict[str, Any]:
    def still(value: Any) -> dict[str, Any]:
        return {"a": 0, "k": value}

    transform = {
        "p": {"s": True, "x": still(0), "y": still(0)},
        "a": still([0, 0, 0]),
        "s": still([100, 100, 100]),
        "r": still(0),
        "o": still(100),
    }
    return {
        "ty": 3,
        "nm": name,
        "ind": index,
        "ip": 0,
        "op": 0,
        "st": 0,
        "sr": 1,
        "ks": transform,
        "ef": [],
    }


def _keyframes(name: str, curve: Curve, rate: float, losses: list[str]) -> list[dict[str, Any]]:
    curve = _without_level_spans(curve)
    frames: list[dict[str, Any]] = []
    controls = curve.controls if len(curve.keys) > 1 else np.empty((0, 4, 2))
    for k, key in enumerate(curve.keys):
        frame: dict[str, Any] = {"t": key.time * rate, "s": [key.value]}
        frames.append(frame)
        if k == len(curve.keys) - 1:
            break
        if key.out_type in ("stepped", "stepped_next"):
            frame["h"] = 1
            if key.out_type == "stepped_next":
                frame["s"] = [curve.keys[k + 1].value]
                losses.append(f"{name}, key {k}: takes the next key's value already at its own.")
            continue
        points = controls[k]
        width, rise = points[3] - points[0]
        easing = (points[1:3] - points[0]) / [width, rise if rise else 1.0]
        frame["o"] = {"x": [float(easing[0, 0])], "y": [float(easing[0, 1])]}
        frame["i"] = {"x": [float(easing[1, 0])], "y": [float(easing[1, 1])]}
        if not rise:  # level ends and level tangents: any easing will do
            frame["o"]["y"], frame["i"]["y"] = [0.0], [1.0]
    return frames


def _without_level_spans(curve: Curve) -> Curve:
    """Keys added where a span has no Lottie easing: level ends, or tangents beyond the span."""
    for _ in range(4):
        if len(curve.keys) < 2:
            break
        controls = curve.controls
        rise = np.abs(controls[:, 3, 1] - controls[:, 0, 1])
        bulge = np.abs(controls[:, 1:3, 1] - controls[:, [0, 3], 1]).max(axis=1)
        x = (controls[:, :, 0] - controls[:, :1, 0]) / (controls[:, 3:, 0] - controls[:, :1, 0])
        beyond = (x[:, 1] > 1 + 1e-9) | (x[:, 2] < -1e-9)
        stepped = np.array([k.out_type.startswith("stepped") for k in curve.keys[:-1]])
        asked = np.flatnonzero(((rise < 1e-6 * bulge) | beyond) & ~stepped)
        if not len(asked):
            break
        curve = curve.with_keys_at(_parting(controls[k, :, 0]) for k in asked)
    return curve


def _parting(times: Array) -> float:
    """Where to part a span: at its steepest point if tangents cross, so that they end inside.

    Else at 0.4 of the parameter, as at 0.5 an S-shaped span passes its ends' level.
    """
    a, b, c = np.diff(times)
    u = (a - b) / (a - 2 * b + c) if b < 0 else 0.4
    return float(_bernstein(np.array([u]))[0] @ times)
