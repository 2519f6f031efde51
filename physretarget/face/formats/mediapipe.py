"""MediaPipe's face landmarker, as its results are saved: JSON, or one JSON object a line.

A frame is an object with a time (``timestamp_ms``, ``timestamp``, ``time``, …) and the weights:
``faceBlendshapes`` as JavaScript has them, ``face_blendshapes`` as Python has them, or
``blendshapes`` by name. Frames stand in a list, or under ``frames`` beside ``fps``. A frame without
a face is a gap; of several faces the first is read. ``_neutral`` is no channel.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from physretarget.errors import InputError
from physretarget.face.formats.dense import LONGEST, checked_rate, dense_take
from physretarget.face.formats.source import Source, mapping, number, sequence
from physretarget.face.shot import Take

_WEIGHTS = ("faceBlendshapes", "face_blendshapes", "blendshapes", "blendShapes")
_NAMES = ("categoryName", "category_name")
_TIMES: dict[str, str | None] = {
    "timestamp_ms": "ms", "timestampMs": "ms", "time_ms": "ms", "timeMs": "ms",
    "timestamp_us": "us", "timestamp": None, "time": None, "t": None,
}  # fmt: skip


def frames_of(content: Any) -> list[Any] | None:
    """The list of frames in parsed JSON, if its first one holds MediaPipe's weights."""
    listed = content.get("frames") if isinstance(content, dict) else content
    if not isinstance(listed, list) or not listed or not isinstance(listed[0], dict):
        return None
    return listed if any(name in listed[0] for name in _WEIGHTS) else None


def is_mediapipe(source: Source) -> bool:
    """Whether a file holds frames of MediaPipe's weights."""
    try:
        content = _content(source)
    except InputError:
        return False
    return frames_of(content) is not None


def _content(source: Source) -> Any:
    """Parsed JSON; a file of one object a line becomes a list."""
    if source.path.suffix.lower() not in (".jsonl", ".ndjson"):
        return source.json()
    found = []
    for line, text in enumerate(source.text().splitlines(), 1):
        if text.strip():
            try:
                found.append(json.loads(text))
            except (ValueError, RecursionError) as error:
                raise InputError("broken JSON.", path=source.path, line=line) from error
    return found


def read_mediapipe(source: Source, *, fps: float | None = None) -> Take:
    """Read the weights.

    Args:
        source: the file.
        fps: frame rate of the take; the recording's own by default.

    Returns:
        The take, channels in the order in which they first appear.

    Raises:
        InputError: no frames, no times, or a weight that is no number.
    """
    content = _content(source)
    frames = frames_of(content)
    if frames is None:
        source.fail("file", "holds no frames with faceBlendshapes, face_blendshapes, blendshapes.")
    if len(frames) > LONGEST:
        source.fail("frames", f"{len(frames)} of them; at most {LONGEST} are read.")
    rows = [_frame(source, index, frame) for index, frame in enumerate(frames)]
    names = list(dict.fromkeys(name for row in rows for name in row))
    if not names:
        source.fail("frames", "a face was seen in none of them.")
    if len(names) > 10_000:
        source.fail("frames", f"{len(names)} channels; a face has no more than some hundred.")
    column = {name: k for k, name in enumerate(names)}
    table = np.full((len(rows), len(names)), math.nan)
    for index, row in enumerate(rows):
        for name, value in row.items():
            table[index, column[name]] = value
    field = next((f for f in _TIMES if f in frames[0]), None)
    if field is None:
        rate = content.get("fps") if isinstance(content, dict) else None
        if rate is None:
            source.fail("frames", 'have no time; add "timestamp_ms" to each, or "fps" beside them.')
        rate = checked_rate(source, number(source, "fps", rate))
        time, unit = [k / rate for k in range(len(frames))], "s"
    else:
        time = [
            number(source, f"frame {k}, {field}", mapping(source, f"frame {k}", f).get(field))
            for k, f in enumerate(frames)
        ]
        unit = _TIMES[field] or ""
    return dense_take(source, time, names, table, unit=unit or None, fps=fps)


def _frame(source: Source, index: int, frame: Any) -> dict[str, float]:
    """Weights by name; none where no face was seen."""
    where = f"frame {index}"
    body = mapping(source, where, frame)
    weights = next((body[name] for name in _WEIGHTS if name in body), None)
    return {n: v for n, v in _weights(source, where, weights) if n != "_neutral"}


def _weights(source: Source, where: str, weights: Any) -> Iterator[tuple[str, float]]:
    if isinstance(weights, list) and weights:  # of several faces the first
        if isinstance(weights[0], list):
            weights = weights[0]
        elif isinstance(weights[0], dict) and "categories" in weights[0]:
            weights = weights[0]["categories"]
    if weights is None:
        return
    if isinstance(weights, dict):
        for name, value in weights.items():
            yield str(name), number(source, f"{where}, {str(name)[:40]}", value)
        return
    for item in sequence(source, where, weights):
        entry = mapping(source, where, item)
        name = next((entry[key] for key in _NAMES if key in entry), None)
        if not isinstance(name, str):
            source.fail(where, "a weight has no categoryName.")
        yield name, number(source, f"{where}, {name[:40]}", entry.get("score"))
