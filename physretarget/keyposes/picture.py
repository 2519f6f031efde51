"""Still pictures of models without a display: EGL, else OSMesa."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.errors import PhysretargetError

__all__ = ["Camera", "NoDisplayError", "Painter", "painter"]

Image = NDArray[np.uint8]
Array = NDArray[np.float64]

BACKENDS = ("mujoco.egl", "mujoco.osmesa", "mujoco.cgl", "mujoco.glfw")
Painter = Callable[[Array, "Camera"], Image]


class NoDisplayError(PhysretargetError):
    """Nothing to draw with is installed."""


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
        NoDisplayError: no way to draw without a display is installed.
    """
    context = _gl_context(width, height)
    try:
        context.make_current()
        model.vis.global_.offwidth = max(model.vis.global_.offwidth, width)
        model.vis.global_.offheight = max(model.vis.global_.offheight, height)
        scene = mujoco.MjvScene(model, maxgeom=2000)
        into = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, into)
        data, option = mujoco.MjData(model), mujoco.MjvOption()
        window = mujoco.MjrRect(0, 0, width, height)

        def paint(qpos: Array, camera: Camera) -> Image:
            data.qpos[:] = qpos
            mujoco.mj_forward(model, data)
            everything = mujoco.mjtCatBit.mjCAT_ALL
            mujoco.mjv_updateScene(model, data, option, None, camera.of_mujoco, everything, scene)
            pixels = np.empty((height, width, 3), dtype=np.uint8)
            mujoco.mjr_render(window, scene, into)
            mujoco.mjr_readPixels(pixels, None, window, into)
            return pixels[::-1]

        yield paint
        into.free()
    finally:
        context.free()


def _gl_context(width: int, height: int) -> Any:
    reasons = []
    for backend in BACKENDS:
        try:
            return import_module(backend).GLContext(width, height)
        # Each backend fails in its own way where its library is missing: an ImportError of
        # its loader, an AttributeError inside PyOpenGL, a RuntimeError of the driver.
        except (ImportError, AttributeError, RuntimeError, OSError) as error:
            reasons.append(f"{backend.split('.')[1]} ({error})")
    raise NoDisplayError(
        "cannot draw without a display: install EGL (libegl1) or OSMesa (libosmesa6); tried "
        + ", ".join(reasons)
    )
