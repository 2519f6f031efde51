"""Still pictures of models without a display."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.gl import Canvas, choose_backend

__all__ = ["Camera", "Painter", "painter"]

Image = NDArray[np.uint8]
Array = NDArray[np.float64]

Painter = Callable[[Array, "Camera"], Image]


class Camera:
    """Where to look from: degrees, metres; azimuth 180 looks the model (facing +x) in the face."""

    def __init__(
        self, lookat: Array, distance: float, azimuth: float = 145.0, elevation: float = -12.0
    ) -> None:
        self.of_mujoco = mujoco.MjvCamera()
        self.of_mujoco.lookat[:] = lookat
        self.of_mujoco.distance = distance
        self.of_mujoco.azimuth = azimuth
        self.of_mujoco.elevation = elevation


@contextmanager
def painter(model: mujoco.MjModel, width: int, height: int) -> Iterator[Painter]:
    """A function that paints qpos (nq,) seen by a camera as (height, width, 3) bytes.

    Raises:
        NoRenderingError: no way to draw without a display is installed.
    """
    backend = choose_backend()
    model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
    model.vis.global_.offheight = max(model.vis.global_.offheight, height)
    data = mujoco.MjData(model)
    with Canvas(model, width, height, backend=backend) as canvas:

        def paint(qpos: Array, camera: Camera) -> Image:
            data.qpos[:] = qpos
            mujoco.mj_forward(model, data)
            canvas.look(data, camera.of_mujoco)
            return canvas.draw()

        yield paint
