"""Pictures of film strips painted beforehand, for browsers that draw slowly or on paper.

The page draws its strips itself, as soon as they are about to be seen. Until then, and where the
browser draws in software or not at all, a row shows what MuJoCo painted while the page was made.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physretarget.gl import Canvas, NoRenderingError, choose_backend
from physretarget.replay.scene import Figure, Scene
from physretarget.replay.stage import Stage

__all__ = ["Row", "stills"]

Array = NDArray[np.float64]

WIDTH, HEIGHT = 190, 176
"""Pixels of one picture, as in filmstrip.js."""
QUALITY = 80
FOVY, EYE, AIM = 28.0, np.array([1.95, -1.45, 1.05]), 0.49
"""The camera of filmstrip.js: degrees; where it stands and the height it aims at, in heights."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """A row of a film strip: a ``figure`` of the scene; ``frames`` (K,) are those in the pictures.

    Rows with one ``look`` after the other are drawn with the shapes of the first.
    """

    look: str
    figure: Figure
    frames: NDArray[np.int64]


def stills(rows: Sequence[Row]) -> tuple[str, ...]:
    """A data URI per row: its pictures side by side. Empty texts where nothing can be drawn."""
    try:
        backend = choose_backend()
    except NoRenderingError:  # then the browser's own drawing is all there is
        return tuple("" for _ in rows)
    painted: list[str] = []
    for _, alike in groupby(rows, key=lambda row: row.look):
        painted += _painted(list(alike), backend)
    return tuple(painted)


def _painted(rows: list[Row], backend: str) -> list[str]:
    """Rows that look alike: opening OpenGL takes as long as a row."""
    stage = _stage(rows[0].figure)
    painted = []
    with Canvas(stage.model, WIDTH, HEIGHT, backend=backend) as canvas:
        canvas.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        for row in rows:
            pictures = []
            for t in row.frames:
                stage.put(0, row.figure, int(t))
                stage.light(row.figure.com[t])
                canvas.look(stage.data, _camera(row.figure, int(t)))
                pictures.append(canvas.draw())
            painted.append(_data_uri(np.concatenate(pictures, axis=1)))
    return painted


def _stage(figure: Figure) -> Stage:
    """The stage of films and windows, as small as a picture of a strip."""
    seen = replace(figure, hidden=False)
    frames = np.arange(len(figure.position), dtype=np.float64)
    scene = Scene(title="strip", time=frames, figures=(seen,), layout="split")
    stage = Stage(scene, width=WIDTH, height=HEIGHT)
    stage.model.vis.global_.fovy = FOVY
    stage.model.vis.quality.offsamples = 0  # the page shows them smaller, which smooths edges
    return stage


def _data_uri(picture: NDArray[np.uint8]) -> str:
    content = io.BytesIO()
    Image.fromarray(picture).save(content, "JPEG", quality=QUALITY, optimize=True)
    return "data:image/jpeg;base64," + base64.b64encode(content.getvalue()).decode()


def _camera(figure: Figure, t: int) -> mujoco.MjvCamera:
    """Beside the figure, farther off while it is above its mean: jumps stay in the picture."""
    size, (x, y, z) = figure.height, figure.com[t]
    rise = z - figure.com[:, 2].mean()
    eye = (size + 0.7 * max(rise, 0.0)) * EYE
    aim = np.array([0.0, 0.0, AIM * size + 0.6 * rise])
    east, north, up = aim - eye
    away = float(np.linalg.norm(aim - eye))
    azimuth, elevation = np.degrees([np.arctan2(north, east), np.arcsin(up / away)])
    camera = mujoco.MjvCamera()
    camera.lookat[:] = aim[0] + x, aim[1] + y, aim[2]
    camera.distance, camera.azimuth, camera.elevation = away, azimuth, elevation
    return camera
