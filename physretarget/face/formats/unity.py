"""Unity's ``.anim`` (a clip as text): every float curve, and the axes of positions and scales.

A key has a value, slopes a second on either side, and, where ``weightedMode`` says so (1 in, 2 out,
3 both), handles of its own length as a share of the span; else handles lie at thirds. An infinite
slope is a step: the value ahead of it is held.

Blend shape weights are percent in Unity and fractions here. Channels are named by their last word,
``eyeBlinkLeft`` for ``blendShape.eyeBlinkLeft``, with the object's path ahead where two would
share a name. Compressed curves, references and events are left out and noted.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator
from typing import Any

from physretarget.errors import InputError, MissingExtraError
from physretarget.face.curve import Curve, Key, TangentType
from physretarget.face.formats.source import Source, mapping, sequence
from physretarget.face.shot import Shot

_DOCUMENT = re.compile(r"^--- !u!(\d+) &-?\d+[^\n]*$", re.MULTILINE)
_CLIP = "74"
_SHAPE = "blendShape."
_VECTORS = {"m_PositionCurves": "position", "m_ScaleCurves": "scale", "m_EulerCurves": "rotation"}
_UNREAD = ("m_RotationCurves", "m_CompressedRotationCurves", "m_PPtrCurves", "m_Events")


def _library() -> Any:
    try:
        import yaml
    except ImportError as error:
        raise MissingExtraError("PyYAML", extra="unity", purpose="Unity clips") from error
    return yaml


def is_unity(source: Source) -> bool:
    """Whether a file is a clip that Unity saved as text."""
    head = source.content[:2048]
    return b"!u!74 " in head or b"AnimationClip:" in head


def read_unity(source: Source) -> tuple[Shot, ...]:
    """Read every clip.

    Args:
        source: the file.

    Returns:
        One shot per clip.

    Raises:
        InputError: broken text, or a key (with its curve and number).
    """
    text = source.text()
    found = list(_DOCUMENT.finditer(text))
    shots = []
    for index, mark in enumerate(found):
        if mark[1] != _CLIP:
            continue
        end = found[index + 1].start() if index + 1 < len(found) else len(text)
        first = text.count("\n", 0, mark.end()) + 1
        shots.append(_clip(source, _parsed(source, text[mark.end() : end], first)))
    if not shots:
        raise InputError("holds no animation clip (--- !u!74).", path=source.path)
    return tuple(shots)


def _parsed(source: Source, text: str, first: int) -> dict[str, Any]:
    yaml = _library()
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        for token in yaml.scan(text, Loader=loader):
            if isinstance(token, yaml.AliasToken):  # Unity writes none; nests of them explode
                raise InputError("YAML aliases are not read.", path=source.path)
        content = yaml.load(text, Loader=loader)
    except yaml.YAMLError as error:
        place = getattr(error, "problem_mark", None)
        line = first + (place.line if place else 0)
        raise InputError("broken YAML.", path=source.path, line=line) from error
    except (RecursionError, ValueError, OverflowError, TypeError) as error:
        raise InputError("broken YAML.", path=source.path, line=first) from error
    body = mapping(source, "file", content)
    return mapping(source, "AnimationClip", body.get("AnimationClip"))


def _clip(source: Source, clip: dict[str, Any]) -> Shot:
    rate = clip.get("m_SampleRate")
    fps = None if rate is None else _number(source, "m_SampleRate", rate)
    if fps is not None and fps <= 0:
        source.fail("m_SampleRate", f"a frame rate of {fps:g} is not usable.")
    entries: list[tuple[str, str, list[Any], float, str]] = []
    for body in _entries(source, clip, "m_FloatCurves"):
        name = str(body.get("attribute", ""))
        scale = 0.01 if name.startswith(_SHAPE) else 1.0
        keys = _keys(source, f"curve {name}", body)
        entries.append((str(body.get("path") or ""), name, keys, scale, ""))
    for group, kind in _VECTORS.items():
        for body in _entries(source, clip, group):
            keys = _keys(source, group, body)
            for axis in "xyz":
                entries.append((str(body.get("path") or ""), f"{kind}.{axis}", keys, 1.0, axis))
    short = [n.removeprefix(_SHAPE) for _, n, *_ in entries]
    curves: dict[str, Curve] = {}
    for (path, name, keys, scale, axis), plain in zip(entries, short, strict=True):
        own = plain if short.count(plain) == 1 and not axis else f"{path}.{plain}".lstrip(".")
        if own in curves:
            source.fail(f"curve {name}", f"{own} is there twice.")
        if keys:
            curves[own] = _curve(source, own, keys, scale, axis)
    unread = [k.removeprefix("m_") for k in _UNREAD if clip.get(k)]
    notes = (f"Left out: {', '.join(unread)}.",) if unread else ()
    name = str(clip.get("m_Name") or source.path.stem)
    return Shot(name, curves, fps, source.sha256, notes)


def _entries(source: Source, clip: dict[str, Any], group: str) -> Iterator[dict[str, Any]]:
    for item in sequence(source, group, clip.get(group) or []):
        yield mapping(source, group, item)


def _keys(source: Source, where: str, body: dict[str, Any]) -> list[Any]:
    curve = mapping(source, where, body.get("curve"))
    return sequence(source, where, curve.get("m_Curve") or [])


def _number(source: Source, where: str, value: Any) -> float:
    """A number as Unity's text has it; Infinity stays infinite."""
    if isinstance(value, str):
        with contextlib.suppress(ValueError):
            value = float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        source.fail(where, f"{str(value)[:40]!r} is not a number.")
    if isinstance(value, int) and abs(value) > 1e300:
        source.fail(where, "the number is too large.")
    if math.isnan(value):
        source.fail(where, "it is not a number.")
    return float(value)


def _curve(source: Source, name: str, items: list[Any], scale: float, axis: str) -> Curve:
    rows = [mapping(source, f"curve {name}, key {k}", item) for k, item in enumerate(items)]

    def told(index: int, field: str, default: float) -> float:
        value = rows[index].get(field, default)
        if axis and isinstance(value, dict):
            value = value.get(axis, default)
        return _number(source, f"curve {name}, key {index}, {field}", value)

    times = [told(k, "time", math.nan) for k in range(len(rows))]
    keys = []
    for k, time in enumerate(times):
        value = scale * told(k, "value", math.nan)
        if not (math.isfinite(time) and math.isfinite(value)):
            source.fail(f"curve {name}, key {k}", "time and value must be finite.")
        mode = told(k, "weightedMode", 0.0)
        if mode not in (0, 1, 2, 3):
            source.fail(f"curve {name}, key {k}, weightedMode", f"{mode:g} is none of 0 to 3.")
        kind: TangentType = "fixed"
        sides = []
        for side, bit, other in (("in", 1, k - 1), ("out", 2, k + 1)):
            width = abs(times[other] - time) if 0 <= other < len(times) else 0.0
            share = told(k, f"{side}Weight", 1 / 3) if int(mode) & bit else 1 / 3
            slope = scale * told(k, f"{side}Slope", 0.0)
            if math.isinf(slope):
                slope, share = 0.0, 1 / 3
                kind = "stepped" if side == "out" else kind
            reach = width * min(max(share, 0.0), 1.0)
            sides.append((-reach, -reach * slope) if side == "in" else (reach, reach * slope))
        keys.append(Key(time, value, sides[0], sides[1], "fixed", kind, True))
    # A step belongs to a span: an infinite slope into a key holds the value ahead of it.
    for k in range(1, len(keys)):
        if math.isinf(told(k, "inSlope", 0.0)) and keys[k - 1].out_type != "stepped":
            left = keys[k - 1]
            keys[k - 1] = Key(
                left.time, left.value, left.in_tangent, (0.0, 0.0), "fixed", "stepped", True
            )
    try:
        return Curve(tuple(keys))
    except InputError as error:
        raise InputError(f"curve {name}: {error}", path=source.path) from error
