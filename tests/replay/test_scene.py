from __future__ import annotations

import base64
import json
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from physretarget.errors import InputError, UsageError
from physretarget.replay import Forces, Scene, figure, marks
from physretarget.replay.payload import kept_frames, pack_fractions, payload, script_json


def unpack(packed: dict) -> np.ndarray:
    steps = np.frombuffer(base64.b64decode(packed["u16"]), dtype="<u2").reshape(packed["shape"])
    return np.array(packed["low"]) + np.array(packed["span"]) * steps / 65535


def test_body_poses_are_mujocos(motion) -> None:
    shown = figure(motion.character, motion.qpos, name="a")
    model = motion.character.model
    data = mujoco.MjData(model)
    for t in (0, 7, 31):
        data.qpos[:] = motion.qpos[t]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(shown.position[t], data.xpos, atol=1e-12)
        for body in range(model.nbody):
            assert abs(np.dot(shown.rotation[t, body], data.xquat[body])) == pytest.approx(1.0)
        np.testing.assert_allclose(shown.com[t], data.subtree_com[0], atol=1e-12)


def test_neighbouring_rotations_have_one_sign(motion) -> None:
    rotation = figure(motion.character, motion.qpos, name="a").rotation
    assert (np.sum(rotation[1:] * rotation[:-1], axis=-1) > 0.9).all()


def test_only_what_can_be_seen_is_taken(motion) -> None:
    shapes = figure(motion.character, motion.qpos, name="a").shapes
    assert [s.kind for s in shapes] == ["box", "sphere", "capsule", "mesh"]
    box, sphere, capsule, mesh = shapes
    assert not box.declared
    assert sphere.declared
    assert sphere.rgba == pytest.approx((0.9, 0.1, 0.1, 1.0))
    assert sphere.emission == 1.0
    assert capsule.rgba == pytest.approx((0, 0, 1, 0.5))
    assert mesh.vertices is not None
    assert mesh.vertices.shape == (4, 3)


def test_a_figure_of_collision_geoms_alone_is_still_seen(motion) -> None:
    from physretarget.mjcf import Character

    text = """<mujoco><worldbody><body><freejoint/>
      <geom type="sphere" size="0.1" group="3" mass="1"/></body></worldbody></mujoco>"""
    character = Character.from_xml(text, name="ball")
    assert len(figure(character, np.array([[0, 0, 1.0, 1, 0, 0, 0]]), name="b").shapes) == 1


def test_bad_motions_are_refused(motion) -> None:
    with pytest.raises(InputError, match="needs"):
        figure(motion.character, motion.qpos[:, :-1], name="a")
    broken = motion.qpos.copy()
    broken[3, 2] = np.nan
    with pytest.raises(InputError, match="frame 3"):
        figure(motion.character, broken, name="a")
    with pytest.raises(InputError, match="contact_active"):
        figure(motion.character, motion.qpos, name="a", contact_active=np.ones((2, 1), bool))
    with pytest.raises(InputError, match="contact points"):
        figure(motion.character, motion.qpos, name="a", contact_active=np.ones((40, 3), bool))


def test_figures_must_share_the_clock(scene) -> None:
    with pytest.raises(UsageError, match="40 frames"):
        replace(scene, time=scene.time[:-1])
    with pytest.raises(UsageError):
        Forces(np.zeros((3, 1, 3)), np.zeros((3, 2, 3)))


def test_findings_become_marks_in_order_of_time() -> None:
    def finding(code, first, last, severity="error"):
        return SimpleNamespace(
            code=code, message="m", frame_first=first, frame_last=last, severity=severity
        )

    found = marks([finding("B", 9, 12), finding("A", None, None), finding("C", 2, None)])
    assert [(m.code, m.frame_first, m.frame_last) for m in found] == [("C", 2, 2), ("B", 9, 12)]


def test_packing_keeps_poses_to_a_fraction_of_a_millimetre(scene) -> None:
    data = payload(scene)
    packed = data["figures"][0]
    np.testing.assert_allclose(unpack(packed["position"]), scene.figures[0].position, atol=1e-4)
    np.testing.assert_allclose(unpack(packed["rotation"]), scene.figures[0].rotation, atol=5e-5)


def test_packing_constants_and_nothing() -> None:
    assert unpack(pack_fractions(np.full((5, 2), 3.25))).tolist() == [[3.25, 3.25]] * 5
    assert pack_fractions(np.zeros((0, 3)))["shape"] == [0, 3]


def test_figures_of_one_character_share_their_mesh(scene) -> None:
    assert len(payload(scene)["meshes"]) == 1


def test_missing_forces_are_not_drawn(scene) -> None:
    packed = payload(scene)["figures"][1]["forces"]["vector"]
    vector = np.frombuffer(base64.b64decode(packed["f32"]), "<f4").reshape(packed["shape"])
    assert (vector[5] == 0).all()
    assert vector[6, 0, 2] == 1.0


@pytest.mark.parametrize(("fps", "step"), [(30, 1), (60, 1), (119, 1), (120, 2), (500, 8)])
def test_fast_clips_are_thinned_and_keep_both_ends(fps: int, step: int) -> None:
    kept = kept_frames(np.arange(1001) / fps)
    assert kept[0] == 0
    assert kept[-1] == 1000
    assert kept[1] == step


def test_uneven_clocks_are_kept_in_full(scene) -> None:
    time = scene.time.copy()
    time[5:] += 0.01
    assert "all" in payload(replace(scene, time=time))["time"]
    assert payload(scene)["time"]["step"] == pytest.approx(0.05)


def test_json_cannot_end_its_script_element() -> None:
    hostile = {"a": "</script><!-- & \u2028 <b>"}
    text = script_json(hostile)
    assert "<" not in text
    assert ">" not in text
    assert text.isascii()
    assert json.loads(text) == hostile


def test_a_scene_needs_something_to_show() -> None:
    with pytest.raises(UsageError):
        Scene(title="", time=np.array([0.0]), figures=())
