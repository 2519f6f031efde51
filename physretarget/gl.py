"""Which OpenGL draws without a display: EGL, else OSMesa, else an error that says what to do.

``mujoco.Renderer`` is bound to whatever ``MUJOCO_GL`` said when mujoco was imported, which is
too early to fall back. So the choice is tried out in a process of its own (a failing driver may
end it), and pictures are drawn with MuJoCo's own calls on a context of the chosen kind.
"""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from functools import cache
from types import TracebackType
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.errors import PhysretargetError

BACKENDS = ("egl", "osmesa")
_TIMEOUT_S = 60
_TRIAL = """
import sys
import mujoco
from physretarget.gl import Canvas
model = mujoco.MjModel.from_xml_string("<mujoco/>")
with Canvas(model, 8, 8, backend=sys.argv[1]) as canvas:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    canvas.look(data, mujoco.MjvCamera())
    canvas.draw()
"""


class NoRenderingError(PhysretargetError):
    """This machine cannot draw: says what was tried and what to install."""


@cache
def choose_backend() -> str:
    """The first backend that draws here; one told in ``MUJOCO_GL`` is respected.

    Raises:
        NoRenderingError: none works.
    """
    told = os.environ.get("MUJOCO_GL", "").lower()
    tried = (told,) if told else BACKENDS
    reasons = []
    for backend in tried:
        reason = _trial(backend)
        if reason is None:
            return backend
        reasons.append(f"{backend} ({reason})")
    raise NoRenderingError(
        f"pictures need OpenGL, and none works here: {'; '.join(reasons)}. Install EGL "
        "(Debian: apt install libegl1 libgl1-mesa-dri) or OSMesa (apt install libosmesa6). "
        "An HTML replay (--html) needs neither."
    )


def _trial(backend: str) -> str | None:
    """None if the backend draws, else the last line of why not."""
    # Not for mujoco's own import, which would load a backend that may be broken.
    environment = dict(os.environ, MUJOCO_GL="disable")
    environment.pop("PYOPENGL_PLATFORM", None)
    try:
        done = subprocess.run(
            [sys.executable, "-c", _TRIAL, backend],
            env=environment,
            capture_output=True,
            text=True,
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no answer in {_TIMEOUT_S} s"
    if done.returncode == 0:
        return None
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    # Clean-up of a half-made context complains last; the cause is the first error line.
    errors = [line for line in lines if "Error" in line.split(":")[0]]
    return (errors or lines or ["it ended without a word"])[0][:160]


class Canvas:
    """Pictures of a model without a window; a context manager.

    Args:
        model: must allow this size (``vis.global_.offwidth`` and ``offheight``).
        width: pixels, as ``height``.
        backend: ``egl``, ``osmesa`` or ``glfw``.
        max_geom: how many things a picture may show.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        width: int,
        height: int,
        *,
        backend: str,
        max_geom: int = 4000,
    ) -> None:
        if backend in BACKENDS:
            # PyOpenGL must talk to the same library as MuJoCo.
            os.environ["PYOPENGL_PLATFORM"] = backend
        module = importlib.import_module(f"mujoco.{backend}")
        self._context = module.GLContext(width, height)
        self._context.make_current()
        self._target = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._target)
        self.model = model
        self.scene = mujoco.MjvScene(model, maxgeom=max_geom)
        self._size = mujoco.MjrRect(0, 0, width, height)

    def look(
        self,
        data: mujoco.MjData,
        camera: mujoco.MjvCamera,
        options: mujoco.MjvOption | None = None,
    ) -> None:
        """Fill ``scene`` with what a camera sees; more may be added before drawing."""
        options = options or mujoco.MjvOption()
        seen = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self.model, data, options, None, camera, seen, self.scene)

    def draw(self) -> NDArray[np.uint8]:
        """The picture (height, width, 3)."""
        pixels = np.empty((self._size.height, self._size.width, 3), dtype=np.uint8)
        mujoco.mjr_render(self._size, self.scene, self._target)
        mujoco.mjr_readPixels(pixels, None, self._size, self._target)
        # OpenGL counts rows from the bottom.
        return np.flipud(pixels)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._target.free()
        self._context.free()
