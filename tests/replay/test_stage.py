"""Video and window: what MuJoCo draws of a scene."""

from __future__ import annotations

import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from physretarget import gl
from physretarget.errors import MissingExtraError, PhysretargetError, UsageError
from physretarget.replay import video, window
from physretarget.replay.stage import Stage, drawn_weights


def test_bodies_stand_where_the_track_says(scene) -> None:
    stage = Stage(scene)
    assert stage.pose(0.35) == 7
    shown = scene.figures[0]
    body = int(stage.model.body("f0b2").mocapid[0])
    np.testing.assert_allclose(stage.data.mocap_pos[body], shown.position[7, 2], atol=1e-9)
    assert stage.pose(0.375) == 7
    halfway = (shown.position[7, 2] + shown.position[8, 2]) / 2
    np.testing.assert_allclose(stage.data.mocap_pos[body], halfway, atol=1e-9)


def test_meshes_keep_their_place(scene) -> None:
    """MuJoCo recentres meshes on compiling; what is drawn must not move by it."""
    stage = Stage(scene)
    stage.pose(0.0)
    model, name = stage.model, "f0s3"
    geom = next(g for g in range(model.ngeom) if model.material(model.geom_matid[g]).name == name)
    mesh = model.geom_dataid[geom]
    at, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[at : at + count]
    turn = stage.data.geom_xmat[geom].reshape(3, 3)
    drawn = stage.data.geom_xpos[geom] + vertices @ turn.T

    shape, figure = scene.figures[0].shapes[3], scene.figures[0]
    turn_body, turn_shape = np.empty(9), np.empty(9)
    mujoco.mju_quat2Mat(turn_body, figure.rotation[0, shape.body])
    mujoco.mju_quat2Mat(turn_shape, shape.rotation)
    local = shape.position + shape.vertices @ turn_shape.reshape(3, 3).T
    wanted = figure.position[0, shape.body] + local @ turn_body.reshape(3, 3).T
    for point in wanted:
        assert np.linalg.norm(drawn - point, axis=1).min() < 1e-6


def test_arrows_and_contacts_are_added(scene) -> None:
    stage = Stage(scene)
    picture = mujoco.MjvScene(stage.model, maxgeom=50)
    everyone = (0, 1)
    for seconds, count in ((0.0, 1), (0.25, 0), (0.55, 2)):  # arrow; gap; arrow and contact
        frame = stage.pose(seconds)
        picture.ngeom = 0
        stage.draw_over(picture, frame, everyone)
        assert picture.ngeom == count


def test_long_arrows_are_drawn_shorter_but_never_in_another_order() -> None:
    lengths = [drawn_weights(bw) for bw in np.linspace(0, 30, 400)]
    assert (np.diff(lengths) > 0).all()
    assert drawn_weights(1.5) == 1.5
    assert drawn_weights(14.0) < 4.0


def test_split_scenes_have_a_view_each(scene) -> None:
    assert Stage(scene).views() == ((0,), (1,))
    assert Stage(replace(scene, layout="stage")).views() == ((0, 1),)
    assert Stage(scene).options((1,)).geomgroup.tolist() == [1, 0, 1, 0, 0, 0]


def test_hidden_figures_stay_out(scene) -> None:
    first, second = scene.figures
    stage = Stage(replace(scene, figures=(first, replace(second, hidden=True))))
    assert [f.name for f in stage.figures] == [first.name]


def test_pictures_show_the_motion_and_the_caption(scene, backend) -> None:
    shown = list(video.pictures(scene, width=192, height=112, fps=2.0))
    assert len(shown) == 4
    assert all(p.shape == (112, 192, 3) and p.dtype == np.uint8 for p in shown)
    assert all(p.std() > 5 for p in shown)
    assert np.abs(shown[0].astype(int) - shown[1]).max() > 30


def test_a_film_is_written_whole_or_not_at_all(scene, backend, tmp_path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    steps: list[tuple[int, int]] = []
    film = video.write_video(
        scene, tmp_path / "f.mp4", width=100, height=70, fps=2.0,
        progress=lambda done, total: steps.append((done, total)),
    )  # fmt: skip
    assert film.read_bytes()[4:8] == b"ftyp"
    assert [p.name for p in tmp_path.iterdir()] == ["f.mp4"]
    assert steps[-1] == (4, 4)


def test_a_missing_extra_is_named(scene, monkeypatch, tmp_path) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match=r"physretarget\[video\]"):
        video.write_video(scene, tmp_path / "f.mp4")


def test_senseless_rates_are_refused(scene, tmp_path) -> None:
    with pytest.raises(UsageError, match="fps"):
        video.write_video(scene, tmp_path / "f.mp4", fps=0)


def test_osmesa_is_the_fallback(monkeypatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(gl, "_trial", lambda b: "no device" if b == "egl" else None)
    assert gl.choose_backend.__wrapped__() == "osmesa"


def test_no_opengl_says_what_was_tried_and_what_to_install(monkeypatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(gl, "_trial", lambda b: f"no {b} library")
    with pytest.raises(PhysretargetError) as caught:
        gl.choose_backend.__wrapped__()
    text = str(caught.value)
    for word in ("egl", "osmesa", "libegl1", "libosmesa6", "--html"):
        assert word in text


def test_no_display_says_what_to_do_instead(scene, monkeypatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(window.NoDisplayError, match="--html"):
        window.play(scene)


def test_the_windows_keys(scene) -> None:
    playback = window.Playback(scene, scene.clock.start)
    playback.tick(0.1)
    assert playback.seconds == pytest.approx(0.1)
    playback.key(262)
    assert (playback.playing, scene.clock.frame_at(playback.seconds)) == (False, 3)
    playback.key(263)
    playback.tick(5.0)
    assert scene.clock.frame_at(playback.seconds) == 2
    playback.key(269)
    assert playback.seconds == scene.clock.end
    playback.key(262)
    assert playback.seconds == scene.clock.end
    playback.key(265)
    assert playback.speed == 2.0


def test_the_window_writes_the_findings_of_the_frame(scene) -> None:
    playback = window.Playback(scene, 0.0)
    assert window.texts(playback, 3)[1][2] == ""
    assert window.texts(playback, 4)[1][2:] == ("DYN001", "too <b>bold</b>")


def test_the_window_is_brought_to_the_clock(scene) -> None:
    class Viewer:
        """What launch_passive gives, as far as it is used."""

        def __init__(self, stage: Stage) -> None:
            self.user_scn = mujoco.MjvScene(stage.model, maxgeom=20)
            self.synced = 0
            self.texts: list = []

        def lock(self):
            from contextlib import nullcontext

            return nullcontext()

        def set_texts(self, texts) -> None:
            self.texts = texts

        def sync(self) -> None:
            self.synced += 1

    stage = Stage(replace(scene, layout="stage"))
    viewer = Viewer(stage)
    window.show(stage, window.Playback(scene, 0.55), viewer)
    assert viewer.synced == 1
    assert viewer.user_scn.ngeom == 2
    assert "frame 11" in viewer.texts[0][2]
