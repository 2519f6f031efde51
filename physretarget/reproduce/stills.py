"""Pictures of film strips painted beforehand, for browsers that draw slowly or on paper.

The page draws its strips itself, as soon as they are about to be seen. Until then, and where the
browser draws in software, a row shows what MuJoCo painted while the page was made.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physretarget.gl import NoRenderingError
from physretarget.keyposes import actor_character_of_reference
from physretarget.keyposes.picture import Camera, painter
from physretarget.kinematics import forward
from physretarget.mjcf import Character

__all__ = ["stills"]

Array = NDArray[np.float64]

WIDTH, HEIGHT = 190, 176
"""Pixels of one picture, as in filmstrip.js."""
QUALITY = 80
AZIMUTH, ELEVATION, HALF, AIM = 143.4, -13.0, 0.66, 0.47
"""The camera of filmstrip.js: degrees; half of what it sees and what it aims at, in heights."""


def stills(
    rows: Sequence[tuple[str, Character | None, Array]], heights: Sequence[float]
) -> list[str]:
    """A data URI per row: its pictures side by side. Empty texts where nothing can be drawn.

    ``rows``: label, character (None for the actor), poses (K, nq); ``heights`` m that their
    pictures have room for.
    """
    try:
        return [
            _row(character or actor_character_of_reference(), poses, height)
            for (_, character, poses), height in zip(rows, heights, strict=True)
        ]
    except NoRenderingError:  # then the browser's own drawing is all there is
        return ["" for _ in rows]


def _row(figure: Character, poses: Array, size: float) -> str:
    """The pictures of one row; ``size`` is the height in m that they have room for."""
    at = forward(figure.tree, poses).position[:, figure.root_body]
    away = HALF * size / np.tan(np.radians(figure.model.vis.global_.fovy) / 2)
    pictures = []
    with painter(figure.model, WIDTH, HEIGHT) as paint:
        for qpos, (x, y, _) in zip(poses, at, strict=True):
            aim = np.array([x, y, figure.floor_height + AIM * size])
            pictures.append(paint(qpos, Camera(aim, away, AZIMUTH, ELEVATION)))
    content = io.BytesIO()
    Image.fromarray(np.concatenate(pictures, axis=1)).save(content, "JPEG", quality=QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(content.getvalue()).decode()
