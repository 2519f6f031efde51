"""The film screen: an mp4 of a scene, drawn without a display."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.errors import MissingExtraError, UsageError
from physretarget.files import beside
from physretarget.gl import Canvas, choose_backend
from physretarget.replay.scene import Mark, Scene
from physretarget.replay.stage import Stage

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont, ImageFont

Pixels = NDArray[np.uint8]
Progress = Callable[[int, int], None]
_COLORS = {"error": (201, 42, 42), "warning": (184, 110, 0), "info": (25, 113, 194)}
_INK, _PAPER, _RAIL, _ACCENT = (28, 35, 51), (255, 255, 255), (200, 206, 217), (217, 72, 15)


def write_video(
    scene: Scene,
    path: str | os.PathLike[str],
    *,
    width: int = 1280,
    height: int = 720,
    fps: float = 30.0,
    speed: float = 1.0,
    progress: Progress | None = None,
) -> Path:
    """Film the scene from start to end: arrows, contacts, clock and findings burnt in.

    Args:
        scene: what to film; hidden figures stay out.
        path: the mp4 to write, written beside its place and then renamed.
        width: pixels, rounded down to a multiple of 16 as codecs want it; so is ``height``.
        height: pixels.
        fps: of the film; the clip is interpolated.
        speed: 0.25 makes a slow-motion film.
        progress: called with pictures done and pictures in all.

    Returns:
        The film.

    Raises:
        MissingExtraError: the extra ``video`` is not installed.
        NoRenderingError: neither EGL nor OSMesa works here.
        InputError: the file cannot be written.
    """
    if fps <= 0 or speed <= 0:
        raise UsageError(f"fps {fps} and speed {speed} must both be above zero.")
    imageio = _imageio()
    width, height = max(width // 16, 4) * 16, max(height // 16, 4) * 16
    choose_backend()
    with (
        beside(path, suffix=".mp4") as file,
        imageio.get_writer(
            file, format="FFMPEG", fps=fps, codec="libx264", quality=8, macro_block_size=16
        ) as film,
    ):
        for picture in pictures(
            scene, width=width, height=height, fps=fps, speed=speed, progress=progress
        ):
            film.append_data(picture)
    return Path(path)


def pictures(
    scene: Scene,
    *,
    width: int,
    height: int,
    fps: float,
    speed: float = 1.0,
    progress: Progress | None = None,
) -> Iterator[Pixels]:
    """The film's pictures (height, width, 3), one by one; needs a working OpenGL backend."""
    stage = Stage(scene, width=width, height=height)
    times = scene.clock.ticks(fps, speed=speed)
    views = stage.views()
    followed = [_calm_path(stage, times, view) for view in views]
    wide = width // len(views)
    caption = Caption(scene, width, height)
    with Canvas(stage.model, wide, height, backend=choose_backend()) as canvas:
        for k, seconds in enumerate(times):
            frame = stage.pose(float(seconds))
            picture = np.full((height, width, 3), 255, dtype=np.uint8)
            for v, view in enumerate(views):
                camera = _camera(stage, view, followed[v][k], wide / height)
                stage.light(followed[v][k])
                canvas.look(stage.data, camera, stage.options(view))
                stage.draw_over(canvas.scene, frame, view)
                picture[:, v * wide : (v + 1) * wide] = canvas.draw()
            yield caption.over(picture, float(seconds), frame)
            if progress is not None:
                progress(k + 1, len(times))


def _calm_path(
    stage: Stage, times: NDArray[np.float64], view: tuple[int, ...]
) -> NDArray[np.float64]:
    """Where a view's camera looks (T, 3): its figures' middle, averaged over about a second."""
    middle = np.array([stage.middle(float(t), view) for t in times])
    step = float(times[1] - times[0]) if len(times) > 1 else 1.0
    reach = min(max(int(0.6 / step), 1), max(len(times) // 2, 1))
    padded = np.pad(middle, ((reach, reach), (0, 0)), mode="edge")
    sums = np.cumsum(np.vstack([np.zeros(3), padded]), axis=0)
    calm = (sums[2 * reach + 1 :] - sums[: -2 * reach - 1]) / (2 * reach + 1)
    calm[:, 2] = 0.5 * stage.extent(view)[0]
    return np.asarray(calm, dtype=np.float64)


def _camera(
    stage: Stage, view: tuple[int, ...], target: NDArray[np.float64], aspect: float
) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat[:] = target
    camera.azimuth, camera.elevation = 143.0, -14.0
    tall, wide = stage.extent(view)
    camera.distance = 2.6 * max(1.05 * tall, wide / aspect)
    return camera


class Caption:
    """Clock, time bar and findings, drawn over pictures."""

    def __init__(self, scene: Scene, width: int, height: int) -> None:
        self.scene = scene
        self.width, self.height = width, height
        self.unit = max(height // 36, 8)
        self.font = _font(int(0.95 * self.unit))
        self.bold = _font(int(0.95 * self.unit), bold=True)

    def over(self, picture: Pixels, seconds: float, frame: int) -> Pixels:
        """The picture with what belongs to a time written on it."""
        from PIL import Image, ImageDraw

        image = Image.fromarray(picture)
        pen = ImageDraw.Draw(image, "RGBA")
        u = self.unit
        pen.text((u, 0.8 * u), self.scene.title[:90], font=self.bold, fill=_INK)
        last = self.scene.clock.frames - 1
        clock = f"{seconds:6.2f} s    frame {frame} / {last}"
        pen.text((self.width - u, 0.8 * u), clock, font=self.font, fill=_INK, anchor="ra")
        self._bar(pen, seconds)
        now = [m for m in self.scene.marks if m.frame_first <= frame <= m.frame_last][:3]
        for row, mark in enumerate(now):
            self._note(pen, mark, self.height - (3.4 + 1.9 * (len(now) - 1 - row)) * u)
        return np.asarray(image, dtype=np.uint8)

    def _x(self, seconds: float) -> float:
        clock = self.scene.clock
        part = (seconds - clock.start) / clock.duration if clock.duration > 0 else 0.0
        return self.unit + part * (self.width - 2 * self.unit)

    def _bar(self, pen: Any, seconds: float) -> None:
        u, y = self.unit, self.height - 0.9 * self.unit
        pen.rounded_rectangle((u, y, self.width - u, y + 0.3 * u), 0.15 * u, fill=_RAIL)
        pen.rounded_rectangle((u, y, max(self._x(seconds), u + 1), y + 0.3 * u), 0.15 * u, _ACCENT)
        time, frames = self.scene.time, self.scene.clock.frames
        for mark in self.scene.marks:
            a = self._x(float(time[min(mark.frame_first, frames - 1)]))
            b = self._x(float(time[min(mark.frame_last, frames - 1)]))
            box = (a, y - 0.5 * u, max(b, a + 0.3 * u), y - 0.25 * u)
            pen.rectangle(box, fill=_COLORS[mark.severity])

    def _note(self, pen: Any, mark: Mark, y: float) -> None:
        u = self.unit
        text = f"{mark.code}  {mark.message}"
        while len(text) > 12 and pen.textlength(text, font=self.font) > self.width - 5 * u:
            text = text[:-5] + "…"
        wide = pen.textlength(text, font=self.font)
        box = (u, y, 2.6 * u + wide, y + 1.6 * u)
        pen.rounded_rectangle(box, 0.3 * u, fill=(*_PAPER, 225))
        pen.rectangle((u, y, 1.3 * u, y + 1.6 * u), fill=_COLORS[mark.severity])
        pen.text((1.9 * u, y + 0.8 * u), text, font=self.font, fill=_INK, anchor="lm")


def _font(size: int, *, bold: bool = False) -> FreeTypeFont | ImageFont:
    """DejaVu Sans out of matplotlib, so that every machine writes the same film."""
    from matplotlib import get_data_path
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(get_data_path(), "fonts", "ttf", name)), size)


def _imageio() -> Any:
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        missing = str(error.name or "imageio").replace("_", "-")
        raise MissingExtraError(missing, extra="video", purpose="writing a video") from error
    return imageio
