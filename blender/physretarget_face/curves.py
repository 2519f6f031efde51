# SPDX-License-Identifier: GPL-3.0-or-later
"""Between Blender's F-curves and physretarget's curves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from physretarget.face.curve import Curve, Key
from physretarget.face.shot import Take


def channelbag(action: Any, slot: Any, *, make: bool = False) -> Any:
    """The curves of an action that belong to a slot; None if there are none."""
    from bpy_extras import anim_utils

    if make:
        ensure = getattr(anim_utils, "action_ensure_channelbag_for_slot", None)
        if ensure is not None:
            return ensure(action, slot)
        layer = action.layers[0] if action.layers else action.layers.new("Layer")
        strip = layer.strips[0] if layer.strips else layer.strips.new(type="KEYFRAME")
        return strip.channelbag(slot, ensure=True)
    return anim_utils.action_get_channelbag_for_slot(action, slot)


def name_of(fcurve: Any) -> str:
    """A shape key's own name, else data path and index."""
    shape = re.fullmatch(r'key_blocks\["(.*)"\]\.value', fcurve.data_path)
    if shape:
        return shape[1]
    return f"{fcurve.data_path}[{fcurve.array_index}]"


def names_of(fcurves: Any) -> dict[str, Any]:
    """Every curve under a name of its own."""
    named: dict[str, Any] = {}
    for fcurve in fcurves:
        name, count = name_of(fcurve), 2
        while name in named:
            name, count = f"{name_of(fcurve)}#{count}", count + 1
        named[name] = fcurve
    return named


def take_of(name: str, named: dict[str, Any], fps: float) -> Take:
    """All curves, sampled at every frame from the first to the last key; time starts at 0."""
    first = int(np.floor(min(f.range()[0] for f in named.values())))
    last = int(np.ceil(max(f.range()[1] for f in named.values())))
    frames = np.arange(first, max(last, first + 1) + 1)
    values = np.array([[f.evaluate(float(t)) for f in named.values()] for t in frames])
    return Take(name, (frames - first) / fps, tuple(named), values)


def first_frame(named: dict[str, Any]) -> int:
    """The frame that is time 0 of the take."""
    return int(np.floor(min(f.range()[0] for f in named.values())))


def selected(fcurve: Any, fps: float, start: float, span: tuple[float, float] | None) -> list[Key]:
    """The selected keyframes within a range (s), handles and all."""
    keys = []
    for point in fcurve.keyframe_points:
        time = (point.co[0] - start) / fps
        if not point.select_control_point or time < 0:
            continue
        if span is not None and not span[0] - 1e-6 <= time <= span[1] + 1e-6:
            continue
        sides = [
            (float(h[0] - point.co[0]) / fps, float(h[1] - point.co[1]))
            for h in (point.handle_left, point.handle_right)
        ]
        into = (min(sides[0][0], 0.0), sides[0][1])
        out = (max(sides[1][0], 0.0), sides[1][1])
        held = "stepped" if point.interpolation == "CONSTANT" else "fixed"
        keys.append(Key(time, float(point.co[1]), into, out, "fixed", held, broken=True))
    return keys


def clear(fcurve: Any, fps: float, start: float, span: tuple[float, float] | None) -> None:
    """Remove all keys, or those within a range (s)."""
    points = fcurve.keyframe_points
    if span is None:
        points.clear()
        return
    low, high = start + span[0] * fps - 1e-3, start + span[1] * fps + 1e-3
    for k in reversed(range(len(points))):
        if low <= points[k].co[0] <= high:
            points.remove(points[k], fast=True)
    fcurve.update()


def write(fcurve: Any, curve: Curve, fps: float, start: float) -> None:
    """Keys with their exact handles; a jump to the next key's value gets a key of its own."""
    keys = list(_plain(curve))
    points = fcurve.keyframe_points
    there = len(points)
    points.add(len(keys))
    made = [points[there + k] for k in range(len(keys))]
    for point, key in zip(made, keys, strict=True):
        frame = start + key.time * fps
        point.co = (frame, key.value)
        point.interpolation = "CONSTANT" if key.out_type == "stepped" else "BEZIER"
        smooth = "FREE" if key.broken else "ALIGNED"
        point.handle_left_type = point.handle_right_type = smooth
    for point, key in zip(made, keys, strict=True):
        (a, b), (c, d) = key.in_tangent, key.out_tangent
        frame = start + key.time * fps
        point.handle_left = (frame + a * fps, key.value + b)
        point.handle_right = (frame + c * fps, key.value + d)
    fcurve.update()


def _plain(curve: Curve) -> Iterator[Key]:
    """stepped_next, which Blender lacks, as a hold that starts a thousandth of a second later."""
    for k, key in enumerate(curve.keys):
        yield key
        if key.out_type == "stepped_next" and k + 1 < len(curve.keys):
            after = curve.keys[k + 1]
            gap = min(1e-3, 0.1 * (after.time - key.time))
            yield Key(key.time + gap, after.value, out_type="stepped")
