"""glTF 2.0 animations (``.gltf``, ``.glb``), in and out, through pygltflib (extra ``gltf``).

Read: every animation is a shot; channels are ``node.translation.x``, ``node.scale.y``,
``node.rotation.w`` (quaternion components as they stand) and ``node.weights.target``, the morph
target's name if the mesh tells it. CUBICSPLINE tangents are slopes: handles lie at thirds.

Written: a face rig's mesh is not known here, and morph weights share one list of key times, so
each channel becomes an empty node of its own, named after it, whose translation x is the value
(an entry in the node's extras says so, and makes it come back under its own name).

Lost in writing: glTF's cubic has no handle lengths. Spans whose handles are not at thirds are
halved until the curve is within 0.1 % of its range (the keys added and the largest deviation are
stated); numbers are 32 bits; tangent kinds. A hold inside a smooth curve gets a key 0.1 ms before
its jump.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from collections.abc import Iterator
from dataclasses import replace
from os import PathLike
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError, MissingExtraError, UnsafeInputError
from physretarget.face.curve import Curve, Key, TangentType
from physretarget.face.formats.source import Source
from physretarget.face.formats.tangents import (
    evaluated,
    halved,
    is_straight,
    span_differences,
    worst_difference,
)
from physretarget.face.shot import Shot
from physretarget.files import write_file

Array = NDArray[np.float64]
_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
_WIDTH = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_AXES = {"translation": "xyz", "scale": "xyz", "rotation": "xyzw"}
_CHANNEL = "physretarget_channel"
_TOLERANCE = 1e-3  # of a curve's range
_ROUNDS = 12
_HOLD = 1e-4  # s between a hold's last key and its jump


def _library() -> Any:
    try:
        import pygltflib
    except ImportError as error:
        raise MissingExtraError("pygltflib", extra="gltf", purpose="glTF") from error
    return pygltflib


def read_gltf(path: str | PathLike[str] | Source) -> tuple[Shot, ...]:
    """Read every animation.

    Raises:
        InputError: broken file, with the animation and channel.
        MissingExtraError: pygltflib is not installed.
    """
    source = path if isinstance(path, Source) else Source.open(path)
    document = _parse(source)
    shots = []
    for number, animation in enumerate(document.animations or ()):
        label = animation.name or f"animation{number}"
        curves: dict[str, Curve] = {}
        for index, channel in enumerate(animation.channels or ()):
            where = f"animation {label}, channel {index}"
            for name, curve in _channel(source, document, animation, channel, where):
                unique, count = name, 2
                while unique in curves:
                    unique, count = f"{name}#{count}", count + 1
                curves[unique] = curve
        shots.append(Shot(f"{source.path.stem}:{label}", curves, None, source.sha256))
    return tuple(shots)


def _parse(source: Source) -> Any:
    library = _library()
    content, blob = source.content, b""
    if content[:4] == b"glTF":
        content, blob = _chunks(source)
    body = Source(source.path, content)
    tree = body.json()
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        source.fail("file", "it has no asset; this is no glTF.")
    try:
        document = library.GLTF2.from_json(json.dumps(tree), infer_missing=True)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        source.fail("file", f"not glTF 2.0 ({type(error).__name__}: {str(error)[:80]}).")
    document.set_binary_blob(blob)
    return document


def _chunks(source: Source) -> tuple[bytes, bytes]:
    """JSON and binary chunk of a GLB."""
    content, at, found = source.content, 12, {0x4E4F534A: b"", 0x004E4942: b""}
    if len(content) < 20:
        source.fail("file", "a GLB that ends before its first chunk.")
    while at + 8 <= len(content):
        length, kind = struct.unpack_from("<II", content, at)
        if at + 8 + length > len(content):
            source.fail("file", "a GLB that ends inside a chunk.")
        if not found.get(kind, b"x"):
            found[kind] = content[at + 8 : at + 8 + length]
        at += 8 + length
    return found[0x4E4F534A], found[0x004E4942]


def _item(source: Source, where: str, items: Any, index: Any, what: str) -> Any:
    if (
        not isinstance(items, list)
        or not isinstance(index, int)
        or isinstance(index, bool)
        or not 0 <= index < len(items)
    ):
        source.fail(where, f"{what} {str(index)[:20]} does not exist.")
    return items[index]


def _channel(
    source: Source, document: Any, animation: Any, channel: Any, where: str
) -> Iterator[tuple[str, Curve]]:
    target = channel.target
    if target is None or target.node is None:
        return
    node = _item(source, where, document.nodes, target.node, "node")
    path = target.path
    if path not in _AXES and path != "weights":
        return
    sampler = _item(source, where, animation.samplers, channel.sampler, "sampler")
    times = _accessor(source, document, sampler.input, where)[:, 0]
    values = _accessor(source, document, sampler.output, where)
    kind = sampler.interpolation or "LINEAR"
    if kind not in ("LINEAR", "STEP", "CUBICSPLINE"):
        source.fail(where, f"interpolation {str(kind)[:20]!r} is not known.")
    labels = _labels(source, document, node, path, where)
    rows = len(times) * (3 if kind == "CUBICSPLINE" else 1)
    if not rows or values.size != rows * len(labels):
        source.fail(where, f"{values.size} numbers for {len(times)} keys of {len(labels)}.")
    table = values.reshape(len(times), -1, len(labels))
    owner = node.name or f"node{target.node}"
    ours = node.extras.get(_CHANNEL) if isinstance(node.extras, dict) else None
    if isinstance(ours, str) and path == "translation":
        labels, owner = labels[:1], ours
    for axis, label in enumerate(labels):
        try:
            name = ours if owner is ours else f"{owner}.{path}.{label}"
            yield name, _curve(times, table[:, :, axis], kind)
        except InputError as error:
            raise InputError(f"{where}: {error}", path=source.path) from error


def _labels(source: Source, document: Any, node: Any, path: str, where: str) -> list[str]:
    if path != "weights":
        return list(_AXES[path])
    mesh = _item(source, where, document.meshes, node.mesh, "mesh")
    count = max((len(p.targets or ()) for p in mesh.primitives or ()), default=0)
    extras = mesh.extras if isinstance(mesh.extras, dict) else {}
    names = extras.get("targetNames")
    if isinstance(names, list) and len(names) == count:
        return [str(name) for name in names]
    return [str(k) for k in range(count)]


def _curve(times: Array, values: Array, kind: str) -> Curve:
    """One component: (K, 1) values, or (K, 3) in slope, value, out slope."""
    if kind != "CUBICSPLINE":
        step: TangentType = "stepped" if kind == "STEP" else "linear"
        return Curve.through(times, values[:, 0], step)
    width = np.diff(times) / 3.0
    before, after = np.append(0.0, width), np.append(width, 0.0)
    table = np.column_stack(
        [times, values[:, 1], -before, -before * values[:, 0], after, after * values[:, 2]]
    )
    return Curve.from_table(table, [("fixed", "fixed", True)] * len(times))


def _accessor(source: Source, document: Any, index: Any, where: str) -> Array:
    """(count, width) numbers; normalised integers become fractions."""
    accessor = _item(source, where, document.accessors, index, "accessor")
    width, kind = _WIDTH.get(accessor.type), _COMPONENTS.get(accessor.componentType)
    if width is None or kind is None:
        source.fail(where, f"accessor {index} is of a kind that no animation has.")
    if accessor.sparse is not None or accessor.bufferView is None:
        source.fail(where, f"accessor {index} is sparse or has no data; that is not read.")
    view = _item(source, where, document.bufferViews, accessor.bufferView, "buffer view")
    data = _buffer(source, document, view.buffer, where)
    numbers = [accessor.count, accessor.byteOffset or 0, view.byteOffset or 0, view.byteStride or 0]
    if any(not isinstance(n, int) or n < 0 for n in numbers):
        source.fail(where, f"accessor {index} has offsets that are no whole numbers.")
    count, offset, stride = numbers[0], numbers[1] + numbers[2], numbers[3]
    item = np.dtype(kind).itemsize
    stride = stride or item * width
    if count < 1 or offset + stride * (count - 1) + item * width > len(data):
        source.fail(where, f"accessor {index} reaches past its buffer.")
    raw = np.ndarray((count, width), kind, data, offset, (stride, item)).astype(np.float64)
    if accessor.normalized and kind != "<f4":
        raw = np.maximum(raw / np.iinfo(kind[1:]).max, -1.0)
    if not np.isfinite(raw).all():
        source.fail(where, f"accessor {index} holds a value that is not finite.")
    return raw


def _buffer(source: Source, document: Any, index: Any, where: str) -> bytes:
    buffer = _item(source, where, document.buffers, index, "buffer")
    if buffer.uri is None:
        return bytes(document.binary_blob() or b"")
    uri = str(buffer.uri)
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except (binascii.Error, ValueError) as error:
            raise InputError(f"{where}: a buffer is no base64.", path=source.path) from error
    beside = unquote(uri)
    if "/" in beside or "\\" in beside or ":" in beside or beside in ("", ".", ".."):
        raise UnsafeInputError(
            f"{where}: buffer {beside[:60]!r} does not lie beside the file.", path=source.path
        )
    return Source.open(source.path.parent / beside).content


def write_gltf(path: str | PathLike[str], shot: Shot) -> tuple[str, ...]:
    """Write a shot (``.glb``, or ``.gltf`` with its data inside); returns what was lost."""
    library = _library()
    losses: list[str] = []
    document = library.GLTF2(asset=library.Asset(version="2.0", generator="physretarget"))
    document.scene, document.scenes = 0, [library.Scene(nodes=list(range(len(shot.curves))))]
    animation = library.Animation(name=shot.name, channels=[], samplers=[])
    data = bytearray()
    for index, (name, curve) in enumerate(shot.curves.items()):
        kind, times, values = _sampled(name, curve, losses)
        document.nodes.append(library.Node(name=name, extras={_CHANNEL: name}))
        inputs = _store(library, document, data, times[:, None], "SCALAR")
        outputs = _store(library, document, data, values, "VEC3")
        animation.samplers.append(
            library.AnimationSampler(input=inputs, output=outputs, interpolation=kind)
        )
        target = library.AnimationChannelTarget(node=index, path="translation")
        animation.channels.append(library.AnimationChannel(sampler=index, target=target))
    if shot.curves:
        document.animations = [animation]
        document.buffers = [library.Buffer(byteLength=len(data))]
    if str(path).lower().endswith(".glb"):
        document.set_binary_blob(bytes(data))
        write_file(path, b"".join(document.save_to_bytes()))
    else:
        for buffer in document.buffers:
            encoded = base64.b64encode(bytes(data)).decode()
            buffer.uri = f"data:application/octet-stream;base64,{encoded}"
        write_file(path, document.to_json(indent=None).encode())
    return tuple(losses)


def _store(library: Any, document: Any, data: bytearray, values: Array, kind: str) -> int:
    raw = np.ascontiguousarray(values, dtype="<f4")
    document.bufferViews.append(
        library.BufferView(buffer=0, byteOffset=len(data), byteLength=raw.nbytes)
    )
    data += raw.tobytes()
    accessor = library.Accessor(
        bufferView=len(document.bufferViews) - 1,
        componentType=5126,
        count=len(raw),
        type=kind,
        min=[float(v) for v in raw.min(axis=0)],
        max=[float(v) for v in raw.max(axis=0)],
    )
    document.accessors.append(accessor)
    return len(document.accessors) - 1


def _sampled(name: str, curve: Curve, losses: list[str]) -> tuple[str, Array, Array]:
    """Interpolation, (K,) times and the rows of a VEC3 sampler."""
    kinds = [k.out_type for k in curve.keys[:-1]]
    if kinds and all(kind == "stepped" for kind in kinds):
        return "STEP", _distinct(name, curve.time), _vectors(curve.value)
    if "stepped" not in kinds and "stepped_next" not in kinds and is_straight(curve).all():
        return "LINEAR", _distinct(name, curve.time), _vectors(curve.value)
    smooth, added = _without_steps(curve)
    if added:
        losses.append(f"{name}: {added} keys added at holds, 0.1 ms from their jumps.")
    dense = _dense(smooth)
    slopes = _slopes(dense)
    worst = worst_difference(dense, _hermite(dense.time, dense.value, slopes))
    size = float(np.abs(smooth.controls[:, :, 1]).max()) if len(smooth.keys) > 1 else 0.0
    if worst > 1e-6 * size:
        more = len(dense.keys) - len(smooth.keys)
        stored = dense.time.astype("<f4").astype(np.float64)
        if (np.diff(stored) > 0).all():
            worst = max(worst, worst_difference(dense, _hermite(stored, dense.value, slopes)))
        but = f"{more} keys added for them, " if more else ""
        losses.append(
            f"{name}: handle lengths are lost; {but}the curve moves by at most {worst:.3g}."
        )
    smooth = dense
    rows = np.stack([slopes[:, 0], smooth.value, slopes[:, 1]], axis=1).reshape(-1)
    return "CUBICSPLINE", _distinct(name, smooth.time), _vectors(rows)


def _dense(smooth: Curve) -> Curve:
    """The same curve, halved where a cubic in time would stray from it."""
    if len(smooth.keys) < 2:
        return smooth
    allowed = _TOLERANCE * float(np.ptp(smooth.controls[:, :, 1]))
    # Halves can be an eighth as long; shorter ones could meet in 32 bits.
    least = max(_HOLD, 16 * float(np.finfo(np.float32).eps) * abs(smooth.end))
    dense = smooth
    for _ in range(_ROUNDS):
        written = _hermite(dense.time, dense.value, _slopes(dense))
        far = (span_differences(dense, written) > allowed) & (np.diff(dense.time) > least)
        if not far.any():
            break
        dense = halved(dense, far)
    return dense


def _distinct(name: str, times: Array) -> Array:
    if (np.diff(times.astype(np.float32)) <= 0).any():
        raise InputError(f"{name}: keys too close together for glTF's 32-bit times.")
    return times


def _vectors(values: Array) -> Array:
    return np.column_stack([values, np.zeros((len(values), 2))])


def _slopes(curve: Curve) -> Array:
    """(K, 2) in and out slope; a vertical handle leans on the next control point."""
    slopes = np.zeros((len(curve.keys), 2))
    for k, points in enumerate(curve.controls if len(curve.keys) > 1 else ()):
        slopes[k, 1] = _slope(points)
        slopes[k + 1, 0] = _slope(points[::-1])
    return slopes


def _slope(points: Array) -> float:
    width = abs(points[3, 0] - points[0, 0])
    for other in points[1:]:
        dx, dy = other - points[0]
        if abs(dx) > 1e-6 * width:
            return float(dy / dx)
    return 0.0


def _hermite(times: Array, values: Array, slopes: Array) -> Curve:
    stacked = np.stack([slopes[:, 0], values, slopes[:, 1]], axis=1)
    return _curve(times, stacked, "CUBICSPLINE")


def _without_steps(curve: Curve) -> tuple[Curve, int]:
    """Holds and jumps as two straight spans, the steep one 0.1 ms long (or a tenth of the span)."""
    tangents, keys, added = evaluated(curve), list[Key](), 0
    for k, key in enumerate(curve.keys):
        held = k > 0 and curve.keys[k - 1].out_type in ("stepped", "stepped_next")
        into = (0.0, 0.0) if held else (float(tangents.into[k, 0]), float(tangents.into[k, 1]))
        out = (float(tangents.out[k, 0]), float(tangents.out[k, 1]))
        here = replace(key, in_tangent=into, out_tangent=out, in_type="fixed", out_type="fixed")
        if key.out_type not in ("stepped", "stepped_next") or k == len(curve.keys) - 1:
            keys.append(here)
            continue
        after = curve.keys[k + 1]
        gap = min(_HOLD, 0.1 * (after.time - key.time))
        late = key.out_type == "stepped"
        middle = after.time - gap if late else key.time + gap
        value = key.value if late else after.value
        keys += [replace(here, out_tangent=(0.0, 0.0)), Key(middle, value)]
        added += 1
    return _level(Curve(tuple(keys)), curve), added


def _level(smooth: Curve, original: Curve) -> Curve:
    """Handles of the spans that replaced a step: straight lines at thirds."""
    steps = {k.time for k in original.keys if k.out_type in ("stepped", "stepped_next")}
    steps -= {original.end}
    known = {k.time for k in original.keys}
    keys = list(smooth.keys)
    for k in range(len(keys) - 1):
        if keys[k].time in steps or keys[k].time not in known:
            dx = (keys[k + 1].time - keys[k].time) / 3.0
            dy = (keys[k + 1].value - keys[k].value) / 3.0
            keys[k] = replace(keys[k], out_tangent=(dx, dy))
            keys[k + 1] = replace(keys[k + 1], in_tangent=(-dx, -dy))
    return Curve(tuple(keys))
