"""The Blender add-on, without a window. Needs the ``bpy`` wheel, best in its own environment."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip(
    "bpy", reason="the bpy wheel is not in this environment, so the add-on is not tested here"
)
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "blender"))

import physretarget_face  # noqa: E402
from physretarget_face import curves  # noqa: E402

from physretarget.face.curve import Curve, Key  # noqa: E402
from physretarget.face.library import Library  # noqa: E402
from physretarget.face.shot import Shot  # noqa: E402


@pytest.fixture(autouse=True)
def blender():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    physretarget_face.register()
    yield
    physretarget_face.unregister()


@pytest.fixture
def library(tmp_path) -> Path:
    rng = np.random.default_rng(0)
    shots = []
    for n in range(6):
        times = np.cumsum(rng.uniform(0.2, 0.6, 8))
        shots.append(Shot(f"shot{n}", {"brow": Curve.through(times, rng.uniform(0, 1, 8))}))
    path = tmp_path / "animator.npz"
    Library.of(shots).save(path)
    return path


def captured_face():
    """A mesh with two shape keys, keyed at every frame of 3 s."""
    mesh = bpy.data.meshes.new("face")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [], [(0, 1, 2)])
    face = bpy.data.objects.new("face", mesh)
    bpy.context.collection.objects.link(face)
    bpy.context.view_layer.objects.active = face
    face.shape_key_add(name="Basis")
    for n, name in enumerate(("BrowInnerUp", "JawOpen")):
        block = face.shape_key_add(name=name)
        for frame in range(10, 101):
            block.value = 0.5 + 0.4 * np.sin(frame * (0.11 + 0.05 * n))
            block.keyframe_insert("value", frame=frame)
    bpy.context.scene.render.fps = 30
    return face


def keys_of(data) -> dict[str, list[tuple[float, float]]]:
    bag = curves.channelbag(data.action, data.action_slot)
    return {curves.name_of(f): [tuple(p.co) for p in f.keyframe_points] for f in bag.fcurves}


def test_match_writes_a_new_action_and_keeps_the_old(library):
    face = captured_face()
    data = face.data.shape_keys.animation_data
    old, dense = data.action, keys_of(data)
    done = bpy.ops.action.physretarget_match(library=str(library))
    assert done == {"FINISHED"}
    assert data.action != old
    assert data.action.name == f"{old.name} matched"
    assert old.use_fake_user
    sparse = keys_of(data)
    assert len(sparse["BrowInnerUp"]) < 30
    assert sparse["JawOpen"] == dense["JawOpen"]  # lips are left alone
    assert sparse["BrowInnerUp"][0][0] == pytest.approx(10)
    assert sparse["BrowInnerUp"][-1][0] == pytest.approx(100)
    bag = curves.channelbag(data.action, data.action_slot)
    fcurve = bag.fcurves.find('key_blocks["BrowInnerUp"].value')
    true = [0.5 + 0.4 * np.sin(f * 0.11) for f in range(10, 101)]
    assert [fcurve.evaluate(f) for f in range(10, 101)] == pytest.approx(true, abs=0.08)


def test_a_range_and_locked_keys(library):
    captured_face()
    data = bpy.context.object.data.shape_keys.animation_data
    bag = curves.channelbag(data.action, data.action_slot)
    fcurve = bag.fcurves.find('key_blocks["BrowInnerUp"].value')
    for point in fcurve.keyframe_points:
        point.select_control_point = point.co[0] in (50, 61)
    before = dict(keys_of(data)["BrowInnerUp"])
    scene = bpy.context.scene
    scene.use_preview_range = True
    scene.frame_preview_start, scene.frame_preview_end = 40, 80
    done = bpy.ops.action.physretarget_match(
        library=str(library), preview_range=True, keep_selected=True
    )
    assert done == {"FINISHED"}
    after = dict(keys_of(data)["BrowInnerUp"])
    frames = sorted(after)
    assert [f for f in frames if f < 40] == list(range(10, 40))
    assert [f for f in frames if f > 80] == list(range(81, 101))
    assert {40, 50, 61, 80} <= set(frames)
    assert len([f for f in frames if 40 <= f <= 80]) < 15
    for f in (50, 61):
        assert after[f] == pytest.approx(before[f], abs=1e-6)


def test_undo_brings_the_old_action_back(library):
    captured_face()
    bpy.ops.ed.undo_push(message="before")
    before = bpy.context.object.data.shape_keys.animation_data.action.name
    bpy.ops.action.physretarget_match(library=str(library))
    bpy.ops.ed.undo_push(message="matched")  # the window manager pushes it where there is one
    assert bpy.context.object.data.shape_keys.animation_data.action.name != before
    bpy.ops.ed.undo()
    data = bpy.context.view_layer.objects.active.data.shape_keys.animation_data
    assert data.action.name == before
    assert len(keys_of(data)["BrowInnerUp"]) == 91


def test_unusable_input_is_said(tmp_path):
    captured_face()
    with pytest.raises(RuntimeError, match="does not exist"):
        bpy.ops.action.physretarget_match(library=str(tmp_path / "none.npz"))
    bpy.context.view_layer.objects.active = None
    assert not bpy.ops.action.physretarget_match.poll()


def test_bezier_evaluation_is_blenders():
    """Twin: our evaluation of random keys against Blender's own, single precision."""
    rng = np.random.default_rng(1)
    owner = bpy.data.objects.new("owner", None)
    bpy.context.collection.objects.link(owner)
    owner.keyframe_insert("location", index=0, frame=0)
    data = owner.animation_data
    bag = curves.channelbag(data.action, data.action_slot)
    fcurve = bag.fcurves.new("location", index=1)
    for _ in range(20):
        times = np.cumsum(rng.uniform(0.2, 1.0, 6))
        keys = []
        for t, v in zip(times, rng.uniform(-1, 1, 6), strict=True):
            reach = rng.uniform(0.02, 0.19, 2)
            kind = "stepped" if rng.random() < 0.15 else "fixed"
            into, out = (-reach[0], rng.normal(0, 0.3)), (reach[1], rng.normal(0, 0.3))
            keys.append(Key(t, v, into, out, "fixed", kind, True))
        curve = Curve(tuple(keys))
        fcurve.keyframe_points.clear()
        curves.write(fcurve, curve, 30.0, 5.0)
        inside = rng.uniform(times[0], times[-1], 100)
        theirs = [fcurve.evaluate(5.0 + 30.0 * t) for t in inside]
        np.testing.assert_allclose(curve.evaluate(inside), theirs, atol=2e-4)
