"""Live2D ``motion3.json``, in and out.

A curve's ``Segments`` is a first point ``t, v`` and then, per segment, a type and its numbers:
0 linear ``t, v`` · 1 Bézier ``t1, v1, t2, v2, t, v`` · 2 stepped ``t, v`` (hold) · 3 inverse
stepped ``t, v`` (jump at once). Where ``Meta.AreBeziersRestricted`` is true, players take the
handles to be at thirds of the span whatever their times say, and so does this reader.

A segment of no length is a jump: the key ahead of it moves a thousandth of a frame early and
holds, and the shot's notes say so. Fades are the player's and no part of a curve.

Channels are named by ``Id`` where ``Target`` is ``Parameter``, else ``Target.Id``.

Lost in writing: which kind a tangent was (all but linear and stepped come back as fixed), and the
handles outside the first and last key, which no player evaluates. The shape is kept exactly.
"""

from __future__ import annotations

import json
from dataclasses import replace
from os import PathLike
from typing import Any

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key, TangentType
from physretarget.face.formats.source import Source, mapping, number, sequence
from physretarget.face.formats.tangents import Tangents, evaluated, is_cubic_in_time, is_straight
from physretarget.face.shot import Shot
from physretarget.files import write_file

_TARGETS = ("Model", "PartOpacity")
_LINEAR, _BEZIER, _STEPPED, _INVERSE = 0, 1, 2, 3
_SIZES = {_LINEAR: 2, _BEZIER: 6, _STEPPED: 2, _INVERSE: 2}


def is_live2d(content: Any) -> bool:
    """Whether parsed JSON looks like a Live2D motion."""
    return isinstance(content, dict) and "Curves" in content and "Meta" in content


def read_live2d(path: str | PathLike[str] | Source) -> Shot:
    """Read every curve.

    Raises:
        InputError: broken JSON (with its line), or a segment (with its curve and place).
    """
    source = path if isinstance(path, Source) else Source.open(path)
    content = mapping(source, "file", source.json())
    meta = mapping(source, "Meta", content.get("Meta"))
    restricted = meta.get("AreBeziersRestricted", False) is True
    fps = number(source, "Meta.Fps", meta["Fps"]) if "Fps" in meta else None
    if fps is not None and fps <= 0:
        source.fail("Meta.Fps", f"a frame rate of {fps:g} is not usable.")
    curves: dict[str, Curve] = {}
    notes: list[str] = []
    for index, item in enumerate(sequence(source, "Curves", content.get("Curves"))):
        body = mapping(source, f"curve {index}", item)
        name = _name(source, index, body)
        if name in curves:
            source.fail(f"curve {index}", f"{name} is there twice.")
        curves[name] = _curve(source, name, body, restricted, 1e-3 / (fps or 30.0), notes)
    name = source.path.name.removesuffix(".json").removesuffix(".motion3")
    return Shot(name, curves, fps, source.sha256, tuple(notes))


def _name(source: Source, index: int, body: dict[str, Any]) -> str:
    target, identity = body.get("Target"), body.get("Id")
    if not isinstance(target, str) or not isinstance(identity, str):
        source.fail(f"curve {index}", "Target and Id must be texts.")
    return identity if target == "Parameter" else f"{target}.{identity}"


def _curve(
    source: Source,
    name: str,
    body: dict[str, Any],
    restricted: bool,
    instant: float,
    notes: list[str],
) -> Curve:
    where = f"curve {name}"
    items = sequence(source, where, body.get("Segments"))
    values = [number(source, f"{where}, segment number {k}", v) for k, v in enumerate(items)]
    if len(values) < 2:
        source.fail(where, "no first point.")
    keys = [Key(values[0], values[1], broken=True)]
    at = 2
    while at < len(values):
        spot = f"{where}, key {len(keys)}"
        kind = values[at]
        if kind not in _SIZES:
            source.fail(spot, f"segment type {kind:g}; it is one of 0, 1, 2, 3.")
        numbers = values[at + 1 : at + 1 + _SIZES[int(kind)]]
        if len(numbers) < _SIZES[int(kind)]:
            source.fail(spot, "its segment is cut short.")
        if numbers[-2] == keys[-1].time:
            _move_early(keys, instant)
            notes.append(f"{spot}: a jump at once; the key ahead moved 0.001 frames early.")
            kind = _STEPPED
        if numbers[-2] <= keys[-1].time:
            source.fail(spot, f"t = {numbers[-2]:g} s does not come after the key before it.")
        _append(keys, int(kind), numbers, restricted)
        at += 1 + len(numbers)
    try:
        return Curve(tuple(keys))
    except InputError as error:
        raise InputError(f"{where}: {error}", path=source.path) from error


def _move_early(keys: list[Key], instant: float) -> None:
    """Move the last key a little, no further than half the way to the one before it."""
    last = keys[-1]
    room = (last.time - keys[-2].time) / 2 if len(keys) > 1 else instant
    less = min(instant, room)
    if less > 0 and last.time - less < last.time:
        into = (min(last.in_tangent[0] + less, 0.0), last.in_tangent[1])
        keys[-1] = replace(last, time=last.time - less, in_tangent=into)


def _append(keys: list[Key], kind: int, numbers: list[float], restricted: bool) -> None:
    left, (time, value) = keys[-1], numbers[-2:]
    width, rise = time - left.time, value - left.value
    out, into = (width / 3.0, rise / 3.0), (-width / 3.0, -rise / 3.0)
    name: TangentType = "linear"
    if kind == _BEZIER:
        name = "fixed"
        out = (max(numbers[0] - left.time, 0.0), numbers[1] - left.value)
        into = (min(numbers[2] - time, 0.0), numbers[3] - value)
        if restricted:
            out, into = (width / 3.0, out[1]), (-width / 3.0, into[1])
    elif kind in (_STEPPED, _INVERSE):
        name = "stepped" if kind == _STEPPED else "stepped_next"
        out = into = (0.0, 0.0)
    keys[-1] = Key(left.time, left.value, left.in_tangent, out, left.in_type, name, True)
    keys.append(Key(time, value, into, (0.0, 0.0), "fixed" if kind > 1 else name, "fixed", True))


def write_live2d(path: str | PathLike[str], shot: Shot) -> tuple[str, ...]:
    """Write a shot; returns what was lost, one sentence each."""
    losses = []
    restricted = all(
        bool(is_cubic_in_time(curve)[_bezier_spans(curve)].all()) for curve in shot.curves.values()
    )
    entries, segments, points = [], 0, 0
    for name, curve in shot.curves.items():
        target, _, identity = name.partition(".")
        if target not in _TARGETS or not identity:
            target, identity = "Parameter", name
        numbers = _segments(curve, evaluated(curve))
        entries.append({"Target": target, "Id": identity, "Segments": numbers})
        segments += len(curve.keys) - 1
        points += 1 + sum(3 if bezier else 1 for bezier in _bezier_spans(curve))
        kinds = {kind for k in curve.keys for kind in (k.in_type, k.out_type)}
        if kinds & {"auto", "spline", "flat"}:
            losses.append(f"{name}: auto, spline and flat tangents are stored as fixed ones.")
    meta = {
        "Duration": max((c.end for c in shot.curves.values()), default=0.0),
        "Fps": shot.fps or 30.0,
        "Loop": False,
        "AreBeziersRestricted": restricted,
        "CurveCount": len(entries),
        "TotalSegmentCount": segments,
        "TotalPointCount": points,
        "UserDataCount": 0,
        "TotalUserDataSize": 0,
    }
    content = {"Version": 3, "Meta": meta, "Curves": entries}
    write_file(path, (json.dumps(content) + "\n").encode())
    return tuple(losses)


def _bezier_spans(curve: Curve) -> list[bool]:
    straight = is_straight(curve)
    return [
        key.out_type not in ("stepped", "stepped_next") and not line
        for key, line in zip(curve.keys, straight, strict=False)
    ]


def _segments(curve: Curve, tangents: Tangents) -> list[float]:
    numbers = [curve.keys[0].time, curve.keys[0].value]
    straight = is_straight(curve)
    for k, (left, right) in enumerate(zip(curve.keys, curve.keys[1:], strict=False)):
        if left.out_type in ("stepped", "stepped_next"):
            numbers.append(_STEPPED if left.out_type == "stepped" else _INVERSE)
        elif straight[k]:
            numbers.append(_LINEAR)
        else:
            out, into = tangents.out[k], tangents.into[k + 1]
            numbers.append(_BEZIER)
            numbers += [left.time + float(out[0]), left.value + float(out[1])]
            numbers += [right.time + float(into[0]), right.value + float(into[1])]
        numbers += [right.time, right.value]
    return numbers
