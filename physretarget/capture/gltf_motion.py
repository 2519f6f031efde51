"""glTF, GLB and VRMA: a skeleton's nodes and the first animation that moves it.

Only the file itself is read, and a buffer beside it that it names plainly: no address, no other
folder. Cubic splines, steps and linear keys are sampled at one rate.
"""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, sha256_of
from physretarget.capture.skeleton import Raw, finish
from physretarget.capture.world import Pose, world_of
from physretarget.errors import InputError, UnsafeInputError

_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_TYPES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
_LARGEST, _MOST_NODES, _MOST_FRAMES = 1 << 30, 5000, 500_000
_RATES = (24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 100.0, 120.0, 240.0)
_CUSTOM = 30.0


@dataclass(frozen=True, eq=False)
class _Document:
    path: str
    json: dict[str, Any]
    binary: bytes

    def many(self, key: str) -> list[dict[str, Any]]:
        found = self.json.get(key, [])
        if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
            raise InputError(f"'{key}' is no list of objects.", path=self.path)
        return found


def read(path: str | Path, options: ReadOptions) -> JointRecording:
    """Read a skeleton and its animation.

    Args:
        path: The file.
        options: ``rate`` samples at another rate than that of the keys.

    Raises:
        InputError: It is damaged, or nothing moves in it.
        UnsafeInputError: It claims absurd sizes, or points outside its folder.
    """
    place = Path(path)
    if place.stat().st_size > _LARGEST:
        raise UnsafeInputError(f"the file is larger than {_LARGEST >> 30} GiB", path=path)
    content = place.read_bytes()
    try:
        document = _document(content, path)
        return _recording(document, content, options)
    except InputError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, struct.error, OverflowError) as error:
        raise InputError(f"is no sound glTF: {error!s:.100}", path=path) from error


def _document(content: bytes, path: str | Path) -> _Document:
    if len(content) >= 12 and struct.unpack("<I", content[:4])[0] == _MAGIC:
        at, chunks = 12, {}
        while at + 8 <= len(content):
            size, kind = struct.unpack("<II", content[at : at + 8])
            chunks[kind] = content[at + 8 : at + 8 + size]
            if len(chunks[kind]) < size:
                raise InputError("the file is cut short.", path=path)
            at += 8 + size
        text, binary = chunks.get(_JSON, b""), chunks.get(_BIN, b"")
    else:
        text, binary = content, b""
    try:
        loaded = json.loads(text.decode("utf-8-sig"))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise InputError("the file's JSON is damaged.", path=path) from error
    if not isinstance(loaded, dict):
        raise InputError("the file's JSON is no object.", path=path)
    return _Document(str(path), loaded, binary)


def _buffer(document: _Document, index: int) -> bytes:
    uri = document.many("buffers")[index].get("uri")
    if uri is None:
        return document.binary
    if not isinstance(uri, str):
        raise InputError("a buffer's address is no text.", path=document.path)
    if uri.startswith("data:"):
        return base64.b64decode(uri.partition(",")[2], validate=True)
    beside = Path(document.path).parent / uri
    if Path(uri).name != uri or beside.is_symlink() or not beside.is_file():
        raise UnsafeInputError(
            f"the buffer {uri[:80]!r} is no file beside this one.", path=document.path
        )
    if beside.stat().st_size > _LARGEST:
        raise UnsafeInputError(f"the buffer {uri[:80]!r} is absurdly large.", path=document.path)
    return beside.read_bytes()


def _accessor(document: _Document, index: int) -> Floats:
    """(n, width) numbers; whole numbers are shares of their range."""
    accessor = document.many("accessors")[index]
    width, kind = _TYPES[accessor["type"]], np.dtype(_COMPONENTS[accessor["componentType"]])
    view = document.many("bufferViews")[accessor["bufferView"]]
    data = _buffer(document, view["buffer"])
    start = int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
    count, step = int(accessor["count"]), int(view.get("byteStride", width * kind.itemsize))
    last = start + (count - 1) * step + width * kind.itemsize
    if count < 1 or start < 0 or step < width * kind.itemsize or last > len(data):
        raise InputError("an accessor reaches beyond its buffer.", path=document.path)
    rows = np.ndarray((count, width), kind, data, start, (step, kind.itemsize))
    values: Floats = rows.astype(np.float64)
    if kind.kind in "iu":
        values = np.maximum(values / float(np.iinfo(kind).max), -1.0)
    if not np.isfinite(values).all():
        raise InputError("an accessor holds numbers that are not finite.", path=document.path)
    return values


def _recording(document: _Document, content: bytes, options: ReadOptions) -> JointRecording:
    nodes = document.many("nodes")
    if len(nodes) > _MOST_NODES:
        raise UnsafeInputError(f"the file has {len(nodes)} nodes.", path=document.path)
    animation, name, others = _animation(document)
    channels = _channels(document, animation)
    start = min(times[0] for times, _, _ in channels.values())
    end = max(times[-1] for times, _, _ in channels.values())
    rate = options.rate or _rate(channels)
    frames = round((end - start) * rate) + 1
    if frames > _MOST_FRAMES:
        raise UnsafeInputError(f"the animation has {frames} frames.", path=document.path)
    time = start + np.arange(frames) / rate
    poses = [_pose(node, i, channels, time) for i, node in enumerate(nodes)]
    names = _names(document, nodes)
    found = world_of(names, _parents(nodes, document.path), poses, document.path)
    notes = [f"animation {name!r}"] if name else []
    if others:
        notes.append(f"{others} other animations are left out")
    raw = Raw(
        path=document.path, sha256=sha256_of(content), format="gltf", fps=rate, names=found.names,
        parents=found.parents, position=found.position, rotation=found.rotation, notes=tuple(notes),
    )  # fmt: skip
    return finish(raw, unit=options.unit, up=options.up, names=options.names)


def _animation(document: _Document) -> tuple[dict[str, Any], str, int]:
    """The animation with most channels, its name, and how many others there are."""
    animations = document.many("animations")
    if not animations:
        raise InputError("nothing moves in the file: it has no animation.", path=document.path)
    best = max(animations, key=lambda each: len(each.get("channels", [])))
    return best, str(best.get("name", "")), len(animations) - 1


Channel = tuple[Floats, Floats, str]
Channels = dict[tuple[int, str], Channel]


def _channels(document: _Document, animation: dict[str, Any]) -> Channels:
    """Times, values and interpolation of each node's "translation", "rotation", "scale"."""
    samplers, found = animation["samplers"], {}
    for channel in animation["channels"]:
        target = channel["target"]
        if "node" not in target or target["path"] not in ("translation", "rotation", "scale"):
            continue
        sampler = samplers[channel["sampler"]]
        times = _accessor(document, sampler["input"])[:, 0]
        values = _accessor(document, sampler["output"])
        kind = sampler.get("interpolation", "LINEAR")
        if (np.diff(times) <= 0).any() or len(values) != len(times) * (
            3 if kind == "CUBICSPLINE" else 1
        ):
            raise InputError("the keys of a channel are out of order.", path=document.path)
        found[int(target["node"]), str(target["path"])] = (times, values, str(kind))
    if not found:
        raise InputError("the animation moves no node.", path=document.path)
    return found


def _rate(channels: Channels) -> float:
    """The usual rate on whose frames nearly all keys lie, 30 where there is none."""
    times = np.unique(np.concatenate([times for times, _, _ in channels.values()]))
    for rate in _RATES:
        off = np.abs(times * rate - np.rint(times * rate))
        if np.mean(off < 0.02) > 0.95:
            return rate
    return _CUSTOM


def _pose(
    node: dict[str, Any], i: int, channels: dict[tuple[int, str], Channel], t: Floats
) -> Pose:
    if "matrix" in node:
        matrix = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
        scale = np.linalg.norm(matrix[:3, :3], axis=0)
        place, turn = matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3] / scale)
    else:
        place = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64)
        turn = Rotation.from_quat(np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64))
        scale = np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    places = np.tile(place, (len(t), 1))
    turns = np.tile(turn.as_matrix(), (len(t), 1, 1))
    if (i, "translation") in channels:
        places = _sampled(channels[i, "translation"], t)
    if (i, "rotation") in channels:
        turns = _turned(channels[i, "rotation"], t)
    return Pose(places, turns, scale)


def _sampled(channel: Channel, t: Floats) -> Floats:
    times, values, kind = channel
    at = np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0))
    if len(times) == 1 or kind == "STEP":
        rows = values.reshape(len(times), -1, values.shape[1])[
            :, -2 if kind == "CUBICSPLINE" else 0
        ]
        step = np.clip(np.searchsorted(times, t + 1e-9, side="right") - 1, 0, len(times) - 1)
        return np.asarray(rows[step])
    span = times[at + 1] - times[at]
    share = np.clip((t - times[at]) / span, 0.0, 1.0)[:, None]
    if kind != "CUBICSPLINE":
        return np.asarray((1 - share) * values[at] + share * values[at + 1])
    keys = values.reshape(len(times), 3, -1)
    s2, s3 = share**2, share**3
    return np.asarray(
        (2 * s3 - 3 * s2 + 1) * keys[at, 1]
        + (s3 - 2 * s2 + share) * span[:, None] * keys[at, 2]
        + (3 * s2 - 2 * s3) * keys[at + 1, 1]
        + (s3 - s2) * span[:, None] * keys[at + 1, 0]
    )


def _turned(channel: Channel, t: Floats) -> Floats:
    times, values, kind = channel
    if kind == "LINEAR" and len(times) > 1:
        slerp = Slerp(times, Rotation.from_quat(values))
        return np.asarray(slerp(np.clip(t, times[0], times[-1])).as_matrix())
    return np.asarray(Rotation.from_quat(_sampled(channel, t)).as_matrix())


def _parents(nodes: list[dict[str, Any]], path: str) -> list[int]:
    parents = [-1] * len(nodes)
    for i, node in enumerate(nodes):
        for child in node.get("children", []):
            if parents[child] >= 0:
                raise InputError(f"node {child} has two parents.", path=path)
            parents[child] = i
    return parents


def _names(document: _Document, nodes: list[dict[str, Any]]) -> list[str]:
    """Nodes' names; those of VRM's human bones by the names that its extension gives them."""
    names = [str(node.get("name", f"node{i}")) for i, node in enumerate(nodes)]
    extensions = document.json.get("extensions", {})
    for extension in ("VRMC_vrm_animation", "VRMC_vrm", "VRM"):
        human = extensions.get(extension, {}).get("humanoid", {}).get("humanBones", {})
        bones = (
            human.items()
            if isinstance(human, dict)
            else [(bone.get("bone"), bone) for bone in human if isinstance(bone, dict)]
        )
        for bone, entry in bones:
            if isinstance(bone, str) and 0 <= int(entry["node"]) < len(names):
                names[int(entry["node"])] = bone
    return names
