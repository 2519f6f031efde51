"""The native screen: MuJoCo's viewer plays a scene, with arrows and findings on the clock."""

from __future__ import annotations

import os
import sys
import time
from dataclasses import dataclass, replace
from typing import Any

import mujoco

from physretarget.errors import PhysretargetError
from physretarget.replay.scene import Scene
from physretarget.replay.stage import Stage

# GLFW's key codes.
_SPACE, _LEFT, _RIGHT, _DOWN, _UP, _HOME, _END = 32, 263, 262, 264, 265, 268, 269
_PICTURE_S = 1 / 60
HELP = "space: play/pause   left/right: frame   up/down: speed   home/end"


class NoDisplayError(PhysretargetError):
    """No window can be opened here: says what to do instead."""


@dataclass
class Playback:
    """Where the window's clock stands; keys change it."""

    scene: Scene
    seconds: float
    playing: bool = True
    speed: float = 1.0

    def key(self, code: int) -> None:
        """React to a key press."""
        clock = self.scene.clock
        if code == _SPACE:
            self.playing = not self.playing
        elif code in (_LEFT, _RIGHT):
            self.playing = False
            frame = clock.frame_at(self.seconds) + (1 if code == _RIGHT else -1)
            self.seconds = float(clock.time[min(max(frame, 0), clock.frames - 1)])
        elif code in (_UP, _DOWN):
            factor = 2.0 if code == _UP else 0.5
            self.speed = min(max(self.speed * factor, 0.125), 4.0)
        elif code in (_HOME, _END):
            self.seconds = clock.start if code == _HOME else clock.end

    def tick(self, elapsed: float) -> None:
        """Let some wall clock pass."""
        if self.playing:
            self.seconds = self.scene.clock.advance(
                self.seconds, elapsed, speed=self.speed, loop=True
            )


def check_display() -> None:
    """Raise NoDisplayError where no window can be opened."""
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise NoDisplayError(
            "there is no display here to open a window on (DISPLAY is not set): "
            "use --html FILE, --web or --video FILE."
        )


def play(scene: Scene, *, speed: float = 1.0) -> None:
    """Play the scene in a window until it is closed.

    Raises:
        NoDisplayError: there is no display, or the viewer cannot start on it.
    """
    check_display()
    import mujoco.viewer

    # One window has one view: figures that would have had one each stand side by side.
    layout = "stage" if scene.layout == "split" else scene.layout
    stage = Stage(replace(scene, layout=layout))
    playback = Playback(scene, scene.clock.start, speed=speed)
    try:
        viewer = mujoco.viewer.launch_passive(
            stage.model,
            stage.data,
            key_callback=playback.key,
            show_left_ui=False,
            show_right_ui=False,
        )
    except RuntimeError as error:
        raise NoDisplayError(
            f"the viewer cannot start: {str(error).splitlines()[0]} "
            "Use --html FILE, --web or --video FILE."
        ) from error
    with viewer:
        _run(stage, playback, viewer)


def _run(stage: Stage, playback: Playback, viewer: Any) -> None:
    everyone = tuple(range(len(stage.figures)))
    middle, (tall, wide) = stage.middle(playback.seconds, everyone), stage.extent(everyone)
    with viewer.lock():
        viewer.opt.geomgroup[:] = 1
        viewer.cam.lookat[:] = (middle[0], middle[1], 0.5 * tall)
        viewer.cam.azimuth, viewer.cam.elevation = 143.0, -14.0
        viewer.cam.distance = 2.6 * max(tall, wide / 1.5)
    before = time.perf_counter()
    while viewer.is_running():
        now = time.perf_counter()
        playback.tick(now - before)
        before = now
        show(stage, playback, viewer)
        time.sleep(max(0.0, _PICTURE_S - (time.perf_counter() - now)))


def show(stage: Stage, playback: Playback, viewer: Any) -> None:
    """Bring the viewer to the clock's time: poses, arrows, contacts, texts."""
    with viewer.lock():
        frame = stage.pose(playback.seconds)
        viewer.user_scn.ngeom = 0
        stage.draw_over(viewer.user_scn, frame, tuple(range(len(stage.figures))))
    viewer.set_texts(texts(playback, frame))
    viewer.sync()


def texts(playback: Playback, frame: int) -> list[tuple[Any, Any, str, str]]:
    """What the window writes: clock and help, below it the findings of the frame."""
    scene = playback.scene
    state = "" if playback.playing else "   paused"
    clock = f"{playback.seconds:.2f} s   frame {frame} / {scene.clock.frames - 1}"
    now = [m for m in scene.marks if m.frame_first <= frame <= m.frame_last]
    font = mujoco.mjtFontScale.mjFONTSCALE_150
    return [
        (font, mujoco.mjtGridPos.mjGRID_TOPLEFT, f"{scene.title}\n{clock}\n{HELP}", state),
        (
            font,
            mujoco.mjtGridPos.mjGRID_BOTTOMLEFT,
            "\n".join(m.code for m in now),
            "\n".join(m.message for m in now),
        ),
    ]
