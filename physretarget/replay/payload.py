"""A scene as JSON for the browser: numbers packed into base64, safe inside a script element.

Poses and vertices are stored as 16-bit fractions of their range (0.1 mm over 6 m, 0.03 mrad),
far below what a screen can show, at a quarter of float64's size. Arrays that must be exact in
tests can be asked for as float32.
"""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.replay.scene import Contacts, Figure, Forces, Light, Mark, Scene, Shape

_STEPS = 65535
# Screens show 60 pictures a second; faster clips are thinned to about that and interpolated.
_TRACK_HZ = 60.0


def pack(values: NDArray[Any]) -> dict[str, Any]:
    """Float32, little-endian, base64."""
    array = np.ascontiguousarray(values, dtype="<f4")
    return {"f32": _base64(array), "shape": list(array.shape)}


def pack_fractions(values: NDArray[Any]) -> dict[str, Any]:
    """16-bit fractions of the range of each last-axis column; NaN is not allowed."""
    array = np.asarray(values, dtype=np.float64)
    flat = array.reshape(-1, array.shape[-1]) if array.size else np.zeros((0, array.shape[-1]))
    low = flat.min(axis=0) if len(flat) else np.zeros(array.shape[-1])
    span = (flat.max(axis=0) if len(flat) else low) - low
    scale = np.where(span > 0, span, 1.0)
    steps = np.rint((array - low) / scale * _STEPS).astype("<u2")
    return {
        "u16": _base64(steps),
        "shape": list(array.shape),
        "low": [float(v) for v in low],
        "span": [float(v) for v in span],
    }


def pack_bits(values: NDArray[np.bool_]) -> dict[str, Any]:
    """One byte per flag."""
    array = np.ascontiguousarray(values, dtype=np.uint8)
    return {"u8": _base64(array), "shape": list(array.shape)}


def _base64(array: NDArray[Any]) -> str:
    return base64.b64encode(array.tobytes()).decode("ascii")


def payload(scene: Scene) -> dict[str, Any]:
    """The scene as plain JSON-able data."""
    keep = kept_frames(scene.time)
    meshes: list[dict[str, Any]] = []
    known: dict[bytes, int] = {}
    return {
        "title": scene.title,
        "time": _time(scene.time),
        "keep": pack(keep.astype(np.float64)) if len(keep) < len(scene.time) else None,
        "layout": scene.layout,
        "floor": scene.floor,
        "figures": [_figure(figure, keep, meshes, known) for figure in scene.figures],
        "meshes": meshes,
        "marks": [_mark(mark) for mark in scene.marks],
        "notes": list(scene.notes),
    }


def kept_frames(time: NDArray[np.float64]) -> NDArray[np.int64]:
    """Frames that the browser gets: every n-th of a fast clip, always the first and last."""
    frames = len(time)
    if frames < 3:
        return np.arange(frames)
    rate = (frames - 1) / float(time[-1] - time[0])
    step = max(1, int(np.floor(rate / _TRACK_HZ + 1e-6)))
    return np.unique(np.append(np.arange(0, frames, step), frames - 1))


def _time(time: NDArray[np.float64]) -> dict[str, Any]:
    """Uniform clocks as start and step, others in full."""
    frames = len(time)
    step = float(time[-1] - time[0]) / max(frames - 1, 1)
    uniform = float(time[0]) + step * np.arange(frames)
    if frames < 2 or np.allclose(time, uniform, rtol=0, atol=1e-6):
        return {"start": float(time[0]), "step": step, "frames": frames}
    return {"start": float(time[0]), "frames": frames, "all": pack(time - time[0])}


def _figure(
    figure: Figure,
    keep: NDArray[np.int64],
    meshes: list[dict[str, Any]],
    known: dict[bytes, int],
) -> dict[str, Any]:
    return {
        "name": figure.name,
        "offset": list(figure.offset),
        "tint": None if figure.tint is None else list(figure.tint),
        "repaint": figure.repaint,
        "opacity": figure.opacity,
        "hidden": figure.hidden,
        "height": figure.height,
        "shapes": [_shape(shape, meshes, known) for shape in figure.shapes],
        "lights": [_light(light) for light in figure.lights],
        "position": pack_fractions(figure.position[keep]),
        "rotation": pack_fractions(figure.rotation[keep]),
        "com": pack_fractions(figure.com[keep]),
        "contacts": None if figure.contacts is None else _contacts(figure.contacts, keep),
        "forces": None if figure.forces is None else _forces(figure.forces, keep),
    }


def _shape(shape: Shape, meshes: list[dict[str, Any]], known: dict[bytes, int]) -> dict[str, Any]:
    content: dict[str, Any] = {
        "kind": shape.kind,
        "body": shape.body,
        "size": _short(shape.size),
        "position": _short(shape.position),
        "rotation": _short(shape.rotation),
        "rgba": _short(np.array(shape.rgba)),
        "declared": shape.declared,
        "emission": shape.emission,
        "gloss": shape.gloss,
    }
    if shape.vertices is not None and shape.faces is not None:
        content["mesh"] = _mesh_index(shape.vertices, shape.faces, meshes, known)
    return content


def _mesh_index(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    meshes: list[dict[str, Any]],
    known: dict[bytes, int],
) -> int:
    """Index of a mesh among those already written: figures of one character share theirs."""
    key = vertices.tobytes() + faces.tobytes()
    if key not in known:
        known[key] = len(meshes)
        wide = len(vertices) > _STEPS
        indices = np.ascontiguousarray(faces, dtype="<u4" if wide else "<u2")
        meshes.append(
            {
                "vertices": pack_fractions(vertices),
                "faces": {"u32" if wide else "u16": _base64(indices), "shape": list(faces.shape)},
            }
        )
    return known[key]


def _light(light: Light) -> dict[str, Any]:
    return {
        "body": light.body,
        "position": _short(light.position),
        "direction": _short(light.direction),
        "color": list(light.color),
    }


def _contacts(contacts: Contacts, keep: NDArray[np.int64]) -> dict[str, Any]:
    return {
        "names": list(contacts.names),
        "body": [int(b) for b in contacts.body],
        "local": [_short(p) for p in contacts.local],
        "active": None if contacts.active is None else pack_bits(contacts.active[keep]),
    }


def _forces(forces: Forces, keep: NDArray[np.int64]) -> dict[str, Any]:
    known = np.isfinite(forces.origin) & np.isfinite(forces.vector)
    shown = np.all(known, axis=-1, keepdims=True)[keep]
    return {
        "label": forces.label,
        "origin": pack_fractions(np.where(shown, forces.origin[keep], 0.0)),
        "vector": pack(np.where(shown, forces.vector[keep], 0.0)),
    }


def _mark(mark: Mark) -> dict[str, Any]:
    return {
        "code": mark.code,
        "severity": mark.severity,
        "message": mark.message,
        "first": mark.frame_first,
        "last": mark.frame_last,
        "look": mark.look_at,
    }


def _short(values: NDArray[np.float64]) -> list[float]:
    return [round(float(v), 6) for v in values]


def script_json(content: object) -> str:
    """JSON that cannot end the script element it stands in, whatever strings it holds."""
    text = json.dumps(content, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
