"""USD splines (``.usda``, ``.usdc``, ``.usd``), in and out, through usd-core (extra ``usd``).

USD's ``Ts`` splines hold keys as this project does: a handle's width in time and its slope. Each
channel is an attribute of type double below ``/Animation``, named so that USD accepts it; its own
name and the kinds of its tangents travel as custom data, so that a round trip gives the same keys.

Only the file's own layer is read: no references, no other files are opened.

Lost in writing: handles of no width but some height (USD stores slopes). Jumps to the next key's
value become dual-valued held knots. Times are time codes of the layer's ``timeCodesPerSecond``,
so that the last digit of a time may change. Loops and sloped ends are left out in reading and
noted.
"""

from __future__ import annotations

import re
import tempfile
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any, get_args

from physretarget.errors import InputError, MissingExtraError
from physretarget.face.curve import Curve, Key, TangentType
from physretarget.face.formats.source import Source
from physretarget.face.formats.tangents import evaluated, is_straight
from physretarget.face.shot import Shot
from physretarget.files import write_file

_CHANNEL, _WEIGHTED, _KIND = "channel", "weighted", "tangents"
_KINDS: tuple[TangentType, ...] = get_args(TangentType)
_ROOT = "/Animation"


def _library() -> tuple[Any, Any, Any]:
    try:
        from pxr import Sdf, Tf, Ts
    except ImportError as error:
        raise MissingExtraError("usd-core", extra="usd", purpose="USD") from error
    return Sdf, Tf, Ts


def read_usd(path: str | PathLike[str] | Source) -> Shot:
    """Read every spline of the file's own layer.

    Raises:
        InputError: USD cannot read it, or a spline is of a kind that is not read, with its place.
        MissingExtraError: usd-core is not installed.
    """
    source = path if isinstance(path, Source) else Source.open(path)
    layer = _open(source)
    rate = float(layer.timeCodesPerSecond)
    if not 0 < rate < 1e9:
        source.fail("timeCodesPerSecond", f"{rate:g} is not usable.")
    specs: list[Any] = []
    layer.Traverse("/", lambda place: _collect(layer, place, specs))
    curves: dict[str, Curve] = {}
    notes: list[str] = []
    for spec in specs:
        spline = spec.GetInfo("spline")
        if spline.IsEmpty():
            continue
        custom = dict(spec.customData)
        owner = spec.path.GetPrimPath().name
        name = str(custom.get(_CHANNEL, f"{owner}.{spec.name.replace(':', '.')}"))
        unique, count = name, 2
        while unique in curves:
            unique, count = f"{name}#{count}", count + 1
        try:
            curve = _curve(spline, rate, unique, notes)
        except InputError as error:
            raise InputError(f"{spec.path}: {error}", path=source.path) from error
        weighted = bool(custom.get(_WEIGHTED, True))
        curves[unique] = Curve(curve.keys, weighted)
    return Shot(source.path.stem, curves, rate, source.sha256, tuple(notes))


def _open(source: Source) -> Any:
    sdf, tf, _ = _library()
    # The bytes that were hashed are the bytes that are read, whatever happens to the file.
    suffix = source.path.suffix.lower()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / f"layer{suffix}"
        copy.write_bytes(source.content)
        try:
            layer = sdf.Layer.OpenAsAnonymous(str(copy))
        except (tf.ErrorException, RuntimeError) as error:
            told = _line(error)
            raise InputError("USD cannot read it.", path=source.path, line=told) from error
    if layer is None:
        raise InputError("USD cannot read it.", path=source.path)
    return layer


def _line(error: Exception) -> int | None:
    """The line that USD's text parser complains about, if it says so."""
    try:
        found = re.search(r"line (\d+)", str(error))
    except UnicodeDecodeError:  # it quotes the file's bytes as they are
        return None
    return int(found[1]) if found else None


def _collect(layer: Any, place: Any, found: list[Any]) -> None:
    if place.IsPropertyPath():
        spec = layer.GetAttributeAtPath(place)
        if spec is not None and spec.HasInfo("spline"):
            found.append(spec)


def _curve(spline: Any, rate: float, name: str, notes: list[str]) -> Curve:
    _, _, ts = _library()
    if spline.GetCurveType() != ts.CurveTypeBezier:
        raise InputError("a Hermite spline; only Bézier ones are read.")
    if spline.HasLoops():
        notes.append(f"{name}: loops are left out.")
    ends = (spline.GetPreExtrapolation(), spline.GetPostExtrapolation())
    if any(end.mode not in (ts.ExtrapHeld, ts.ExtrapValueBlock) for end in ends):
        notes.append(f"{name}: values beyond its first and last key are held, not extrapolated.")
    keys: list[Key] = []
    knots = list(spline.GetKnots().values())
    for index, knot in enumerate(knots):
        key = _key(ts, knot, rate)
        if knot.IsDualValued() and keys and key.out_type != "stepped_next":
            before = float(knot.GetPreValue())
            if keys[-1].out_type != "stepped" or keys[-1].value != before:
                early = key.time - min(1e-3 / rate, 0.1 * (key.time - keys[-1].time))
                keys.append(Key(early, before, key.in_tangent, (0.0, 0.0), "fixed", "stepped_next"))
                notes.append(f"{name}, key {index}: jumps; a key was added just before it.")
        keys.append(key)
    return Curve(_lines(tuple(keys), ts, knots))


def _key(ts: Any, knot: Any, rate: float) -> Key:
    into = (-float(knot.GetPreTanWidth()), float(knot.GetPreTanSlope()))
    out = (float(knot.GetPostTanWidth()), float(knot.GetPostTanSlope()))
    kinds: list[TangentType] = ["fixed", "fixed"]
    broken = True
    # Not GetCustomDataByKey: usd-core 26.11 crashes in it where a knot has no custom data.
    told = knot.GetCustomData().get(_KIND)
    if isinstance(told, str) and len(words := told.split()) == 3:
        kinds = [next((k for k in _KINDS if k == word), "fixed") for word in words[:2]]
        broken = words[2] == "broken"
    held = knot.GetNextInterpolation() == ts.InterpHeld
    if held and kinds[1] not in ("stepped", "stepped_next"):
        kinds[1] = "stepped"
    elif not held and kinds[1] in ("stepped", "stepped_next"):
        kinds[1] = "fixed"
    value = float(knot.GetPreValue() if kinds[1] == "stepped_next" else knot.GetValue())
    return Key(
        float(knot.GetTime()) / rate,
        value,
        (into[0] / rate, into[0] * into[1]),
        (out[0] / rate, out[0] * out[1]),
        kinds[0],
        kinds[1],
        broken,
    )


def _lines(keys: tuple[Key, ...], ts: Any, knots: list[Any]) -> tuple[Key, ...]:
    """Spans that USD interpolates linearly get straight handles at thirds."""
    straight = {
        i for i, knot in enumerate(knots[:-1]) if knot.GetNextInterpolation() == ts.InterpLinear
    }
    if not straight or len(keys) != len(knots):
        return keys
    found = list(keys)
    for i, (left, right) in enumerate(pairwise(keys)):
        if i in straight:
            dx, dy = (right.time - left.time) / 3.0, (right.value - left.value) / 3.0
            a, b = found[i], found[i + 1]
            found[i] = Key(a.time, a.value, a.in_tangent, (dx, dy), a.in_type, "linear", a.broken)
            found[i + 1] = Key(
                b.time, b.value, (-dx, -dy), b.out_tangent, "linear", b.out_type, b.broken
            )
    return tuple(found)


def write_usd(path: str | PathLike[str], shot: Shot) -> tuple[str, ...]:
    """Write a shot, as text unless the suffix is ``.usdc``; returns what was lost."""
    sdf, tf, ts = _library()
    rate = shot.fps or 24.0
    losses: list[str] = []
    layer = sdf.Layer.CreateAnonymous(".usda")
    layer.timeCodesPerSecond = layer.framesPerSecond = rate
    last = max((c.end for c in shot.curves.values()), default=0.0)
    layer.startTimeCode, layer.endTimeCode = 0.0, last * rate
    root = sdf.CreatePrimInLayer(layer, _ROOT)
    root.specifier, root.typeName = sdf.SpecifierDef, "Scope"
    layer.defaultPrim = root.name
    for name, curve in shot.curves.items():
        place = _place(tf, layer, name)
        prim = sdf.CreatePrimInLayer(layer, place[0])
        prim.specifier, prim.typeName = sdf.SpecifierDef, "Scope"
        attribute = sdf.AttributeSpec(prim, place[1], sdf.ValueTypeNames.Double)
        attribute.custom = True
        attribute.customData = {_CHANNEL: name, _WEIGHTED: curve.weighted}
        attribute.SetInfo("spline", _spline(ts, name, curve, rate, losses))
    if str(path).lower().endswith(".usdc"):
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / "layer.usdc"
            layer.Export(str(copy))
            write_file(path, copy.read_bytes())
    else:
        write_file(path, layer.ExportToString().encode())
    return tuple(losses)


def _place(tf: Any, layer: Any, name: str) -> tuple[str, str]:
    """Prim path and attribute name that USD accepts and that are free."""
    node, _, attribute = name.partition(".")
    owner = f"{_ROOT}/{tf.MakeValidIdentifier(node or 'channel')}"
    parts = [tf.MakeValidIdentifier(part) for part in attribute.split(".") if part] or ["value"]
    free, count = ":".join(parts), 2
    while layer.GetAttributeAtPath(f"{owner}.{free}") is not None:
        free, count = f"{':'.join(parts)}_{count}", count + 1
    return owner, free


def _spline(ts: Any, name: str, curve: Curve, rate: float, losses: list[str]) -> Any:
    # USD would shorten crossing handles by a rule of its own; ours are within bounds by now.
    with ts.AntiRegressionAuthoringSelector(ts.AntiRegressionNone):
        spline = ts.Spline("double")
        tangents, straight, upright = evaluated(curve), is_straight(curve), 0
        if tangents.shortened:
            losses.append(f"{name}: {len(tangents.shortened)} tangents that crossed are shortened.")
        for k, key in enumerate(curve.keys):
            into, out = tangents.into[k].tolist(), tangents.out[k].tolist()
            stepped = key.out_type in ("stepped", "stepped_next") and k < len(curve.keys) - 1
            line = k < len(straight) and bool(straight[k]) and key.out_type == "linear"
            held = ts.InterpHeld if stepped else ts.InterpLinear if line else ts.InterpCurve
            upright += sum(1 for dx, dy in (into, out) if dx == 0.0 and dy != 0.0)
            knot = ts.Knot(
                "double",
                time=key.time * rate,
                value=key.value,
                nextInterp=held,
                preTanWidth=-into[0] * rate,
                preTanSlope=into[1] / into[0] / rate if into[0] else 0.0,
                postTanWidth=out[0] * rate,
                postTanSlope=out[1] / out[0] / rate if out[0] else 0.0,
            )
            if stepped and key.out_type == "stepped_next":
                knot.SetValue(curve.keys[k + 1].value)
                knot.SetPreValue(key.value)
            broken = "broken" if key.broken else "unified"
            knot.SetCustomDataByKey(_KIND, f"{key.in_type} {key.out_type} {broken}")
            spline.SetKnot(knot)
    if upright:
        losses.append(f"{name}: {upright} handles of no width but some height are left out.")
    return spline
