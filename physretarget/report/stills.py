"""Pictures of film strips painted beforehand, for browsers that draw slowly or on paper.

The page draws its strips itself, as soon as they are about to be seen. Until then, and where the
browser draws in software or not at all, a row shows what MuJoCo painted while the page was made.
"""

from __future__ import annotations

import base64
import copy
import io
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from physretarget.gl import Canvas, NoRenderingError, choose_backend
from physretarget.replay.scene import Figure

__all__ = ["Row", "stills"]

Array = NDArray[np.float64]

WIDTH, HEIGHT = 190, 176
"""Pixels of one picture, as in filmstrip.js."""
QUALITY = 80
FOVY, EYE, AIM = 28.0, np.array([1.95, -1.45, 1.05]), 0.49
"""The camera of filmstrip.js: degrees; where it stands and the height it aims at, in heights."""
FLOOR, SKY = (0.86, 0.88, 0.91, 1.0), (238, 241, 246)
"""As light as the page's own scene."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """A row of a film strip: ``figure`` of the scene, ``qpos`` (T, nq) of its ``model``.

    ``frames`` (K,) are those in the pictures.
    """

    model: mujoco.MjModel
    qpos: Array
    figure: Figure
    frames: NDArray[np.int64]


def stills(rows: Sequence[Row]) -> tuple[str, ...]:
    """A data URI per row: its pictures side by side. Empty texts where nothing can be drawn."""
    try:
        backend = choose_backend()
    except NoRenderingError:  # then the browser's own drawing is all there is
        return tuple("" for _ in rows)
    painted: list[str] = []
    for _, of_one_model in groupby(rows, key=lambda row: id(row.model)):
        painted += _painted(list(of_one_model), backend)
    return tuple(painted)


def _painted(rows: list[Row], backend: str) -> list[str]:
    """Rows of one model: opening OpenGL takes as long as a row."""
    model = _small(rows[0].model)
    data = mujoco.MjData(model)
    painted = []
    with Canvas(model, WIDTH, HEIGHT, backend=backend) as canvas:
        # Lights stand still: who walks away casts shadows in grains, or none. And they take time.
        canvas.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
        canvas.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        for row in rows:
            pictures = []
            for t in row.frames:
                data.qpos[:] = row.qpos[t]
                mujoco.mj_forward(model, data)
                canvas.look(data, _camera(row.figure, t))
                pictures.append(canvas.draw())
            painted.append(_data_uri(np.concatenate(pictures, axis=1)))
    return painted


def _small(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy, for a character's own is never written to, with just what small pictures need."""
    small = copy.copy(model)
    small.vis.global_.fovy = FOVY
    small.vis.global_.offwidth, small.vis.global_.offheight = WIDTH, HEIGHT
    small.vis.quality.offsamples = 0  # the page shows them smaller, which smooths edges
    small.vis.quality.shadowsize = 0
    floor = small.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    small.geom_matid[floor] = -1  # as plain as the page's own, which takes its place
    small.geom_rgba[floor] = FLOOR
    _plain_sky(small)
    return small


def _plain_sky(model: mujoco.MjModel) -> None:
    for sky in np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX):
        first, channels = int(model.tex_adr[sky]), int(model.tex_nchannel[sky])
        size = int(model.tex_height[sky] * model.tex_width[sky])
        model.tex_data[first : first + size * channels].reshape(size, channels)[:, :3] = SKY
    model.vis.rgba.haze[:3] = np.array(SKY) / 255.0


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
