"""Face Cap's text recordings: ``bs,NAMES…`` and then ``k,TIME,NUMBERS…`` for every frame.

The numbers are the head's position and angles (x, y, z), the left and the right eye's angles
(x, y) and the weights that ``bs`` names; angles are degrees. Times are milliseconds, whatever the
``info`` line says. ARKit's names are written with ``_L`` and ``_R`` here, and come back in full.
"""

from __future__ import annotations

import numpy as np

from physretarget.errors import InputError
from physretarget.face.formats.arkit import full_name
from physretarget.face.formats.dense import dense_take
from physretarget.face.formats.source import Source
from physretarget.face.shot import Take

_LEAD = (
    *(f"head.position.{axis}" for axis in "xyz"),
    *(f"head.rotation.{axis}" for axis in "xyz"),
    "leftEye.rotation.x", "leftEye.rotation.y", "rightEye.rotation.x", "rightEye.rotation.y",
)  # fmt: skip
"""Channels ahead of the weights, in the file's order."""


def is_facecap(source: Source) -> bool:
    """Whether a file begins like one of Face Cap's."""
    first = source.content[:64].lstrip(b"\xef\xbb\xbf \r\n")
    return first.startswith((b"info,", b"bs,"))


def read_facecap(source: Source, *, fps: float | None = None) -> Take:
    """Read a recording.

    Args:
        source: the file.
        fps: frame rate of the take; the recording's own by default.

    Returns:
        The take.

    Raises:
        InputError: with the line, when it is broken.
    """
    names: tuple[str, ...] = ()
    times: list[float] = []
    rows: list[list[float]] = []
    for number, line in enumerate(source.text().splitlines(), 1):
        kind, _, rest = line.strip().partition(",")
        words = rest.rstrip(",").split(",") if rest else []
        if kind == "bs" and not rows:
            names = tuple(full_name(word.strip()) for word in words)
        elif kind == "k":
            wanted = 1 + len(_LEAD) + len(names)
            if not names or len(words) != wanted:
                raise InputError(
                    f"{len(words)} numbers where {wanted} are needed; numbers need decimal "
                    "points, and a line bs must name the channels first.",
                    path=source.path,
                    line=number,
                )
            try:
                time, *values = (float(word) for word in words)
            except ValueError as error:
                raise InputError(
                    f"not a number: {error}.", path=source.path, line=number
                ) from error
            if not np.isfinite([time, *values]).all():
                raise InputError("a value is not finite.", path=source.path, line=number)
            times.append(time)
            rows.append(values)
        elif kind not in ("info", ""):
            raise InputError(
                f"{line[:40]!r} is none of Face Cap's lines (info, bs, k).",
                path=source.path,
                line=number,
            )
    return dense_take(source, times, (*_LEAD, *names), rows, unit="ms", fps=fps)
