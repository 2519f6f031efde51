"""Audio2Face's blend shape weights (JSON): ``facsNames``, ``weightMat`` rows and ``exportFps``.

Its tables (``timeCode,blendShapes.EyeBlinkLeft,…``) are read by ``plain``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from physretarget.face.formats.dense import LONGEST, checked_rate, dense_take
from physretarget.face.formats.source import Source, mapping, number, sequence
from physretarget.face.shot import Take


def is_audio2face(content: Any) -> bool:
    """Whether parsed JSON is what Audio2Face exports."""
    return isinstance(content, dict) and "weightMat" in content and "facsNames" in content


def read_audio2face(source: Source, *, fps: float | None = None) -> Take:
    """Read the weights.

    Args:
        source: the file.
        fps: frame rate of the take; the export's own by default.

    Returns:
        The take; a row that is null is a gap.

    Raises:
        InputError: a row of the wrong length, a value that is no number, or no frame rate.
    """
    content = mapping(source, "file", source.json())
    names = [str(n) for n in sequence(source, "facsNames", content.get("facsNames"))]
    if not names:
        source.fail("facsNames", "names no channel.")
    rows = sequence(source, "weightMat", content.get("weightMat"))
    if "exportFps" not in content:
        source.fail("exportFps", 'is missing; add the rate of the export, such as "exportFps": 60.')
    rate = checked_rate(source, number(source, "exportFps", content["exportFps"]))
    if len(rows) > LONGEST:
        source.fail("weightMat", f"{len(rows)} rows; at most {LONGEST} are read.")
    table = np.full((len(rows), len(names)), math.nan)
    for index, row in enumerate(rows):
        if row is None:
            continue
        where = f"weightMat, row {index}"
        values = sequence(source, where, row)
        if len(values) != len(names):
            source.fail(where, f"{len(values)} weights for {len(names)} names in facsNames.")
        table[index] = [number(source, where, v) for v in values]
    return dense_take(source, np.arange(len(rows)) / rate, names, table, unit="s", fps=fps)
