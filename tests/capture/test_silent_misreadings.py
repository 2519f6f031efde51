"""Files that are sound to the letter and were once read wrongly without a word."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.capture import load
from physretarget.capture.actor import SEGMENT, ActorMotion
from physretarget.capture.languages import in_english
from physretarget.capture.names import recognise
from physretarget.errors import InputError

sys.path.insert(0, str(Path(__file__).parent))  # its neighbour, which other tests use as well
import walker


def _place(motion: ActorMotion, segment: str) -> walker.Floats:
    return walker.pose_of(motion.shape, motion.qpos).position[:, 1 + SEGMENT[segment]]


def _is_the_walker(motion: ActorMotion) -> None:
    assert motion.marker_error_rms is not None
    assert motion.marker_error_rms < 0.005
    assert motion.shape.height == pytest.approx(1.75, abs=0.03)
    truth = walker.joint_centres()
    for segment in ("head", "left_foot", "right_hand"):
        height = _place(motion, segment)[:, 2]
        assert np.abs(height - truth[segment][: len(height), 2]).max() < 0.03
    travelled = np.ptp(_place(motion, "pelvis")[:, :2], axis=0)
    assert np.linalg.norm(travelled) == pytest.approx(np.ptp(truth["pelvis"][:, 0]), rel=0.03)


def test_the_walker_is_read_as_it_walks(tmp_path: Path) -> None:
    motion = load(walker.write_trc(tmp_path / "a.trc", walker.CMU, walker.markers()))
    _is_the_walker(motion)
    assert not [note for note in motion.notes if "planted" in note or "tilted" in note]


@pytest.mark.parametrize("value", [-9999.0, 1e7, 99999.0])
@pytest.mark.parametrize("frames", [slice(None), slice(0, 40), slice(70, 90)])
def test_numbers_that_stand_for_a_missing_marker_are_gaps(
    tmp_path: Path, value: float, frames: slice
) -> None:
    position = walker.markers()
    position[frames, walker.CMU.index("RELB")] = value
    _is_the_walker(load(walker.write_trc(tmp_path / "a.trc", walker.CMU, position)))


def test_a_second_actor_is_no_missing_marker(tmp_path: Path) -> None:
    from physretarget.capture.marker_file import without_gaps

    position = np.concatenate(
        [walker.markers(), walker.markers() + np.array([3.0, 2.0, 0.0])], axis=1
    )
    assert np.isfinite(without_gaps(position)).all()


@pytest.mark.parametrize("name", ["HEL", "Hel"])
def test_of_two_meanings_the_one_that_fits_is_taken(tmp_path: Path, name: str) -> None:
    labels = [label.replace("HEE", name) for label in walker.CMU]
    motion = load(walker.write_trc(tmp_path / "a.trc", labels, walker.markers()))
    _is_the_walker(motion)
    assert any("is taken for the left heel" in note for note in motion.notes)


@pytest.mark.parametrize("axes", [(0, -1), (1, -1), (2, -1), (0, 1), (2, 1)])
def test_any_axis_may_point_up_or_down(tmp_path: Path, axes: tuple[int, int]) -> None:
    axis, sign = axes
    up = np.zeros(3)
    up[axis] = sign
    turn = Rotation.align_vectors(up[None], [[0.0, 0.0, 1.0]])[0].as_matrix()
    place = walker.write_trc(tmp_path / "a.trc", walker.CMU, walker.markers() @ turn.T, y_up=False)
    _is_the_walker(load(place))


def test_a_handstand_stays_upside_down(tmp_path: Path) -> None:
    position = walker.markers()
    raised = [i for i, label in enumerate(walker.CMU) if label[1:] in ("WRA", "WRB", "FIN", "FRM")]
    position[:, raised, 2] += 1.2  # above the head
    position[..., 2] = 1.9 - position[..., 2]
    notes = load(walker.write_trc(tmp_path / "a.trc", walker.CMU, position)).notes
    assert any("handstand" in note for note in notes)


@pytest.mark.parametrize("degrees", [3.0, 6.0, 9.0])
@pytest.mark.parametrize("about", [0.0, 50.0, 90.0])
def test_a_tilted_floor_is_levelled(tmp_path: Path, degrees: float, about: float) -> None:
    axis = np.array([np.cos(np.radians(about)), np.sin(np.radians(about)), 0.0])
    turn = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
    position = walker.markers(seconds=5.0) @ turn.T
    motion = load(walker.write_trc(tmp_path / "a.trc", walker.CMU, position))
    feet = np.c_[_place(motion, "left_foot")[:, 2], _place(motion, "right_foot")[:, 2]].min(axis=1)
    # Across its narrow track a straight walk tells little of a floor; along it, all.
    along = abs(np.sin(np.radians(about)))
    assert np.ptp(feet) < 0.03
    if along > 0.5:
        assert any("tilted" in note and "levelled" in note for note in motion.notes)


def test_who_walks_up_a_slope_is_not_levelled_but_told(tmp_path: Path) -> None:
    position = walker.markers(seconds=5.0)
    position[..., 2] += np.tan(np.radians(6.0)) * walker.joint_centres(5.0)["pelvis"][:, None, 0]
    feet = [i for i, label in enumerate(walker.CMU) if label[1:] in ("HEE", "TOE", "ANK")]
    lead = position[:, feet, 0] - walker.joint_centres(5.0)["pelvis"][:, None, 0]
    position[:, feet, 2] += np.tan(np.radians(6.0)) * lead
    motion = load(walker.write_trc(tmp_path / "a.trc", walker.CMU, position))
    assert any("slope" in note for note in motion.notes)
    assert not any("levelled" in note for note in motion.notes)


def test_a_box_to_step_on_is_no_slope(tmp_path: Path) -> None:
    position = walker.markers(seconds=4.0)
    position[len(position) // 2 :, :, 2] += 0.15
    motion = load(walker.write_trc(tmp_path / "a.trc", walker.CMU, position))
    assert not any("slope" in note or "tilted" in note for note in motion.notes)


@pytest.mark.parametrize("speed", [0.6, 1.4])
def test_a_treadmill_is_told_and_taken_out_on_request(tmp_path: Path, speed: float) -> None:
    position = walker.markers(seconds=4.0)
    time = np.arange(len(position)) / walker.FPS
    mean = np.ptp(walker.joint_centres(4.0)["pelvis"][:, 0]) / time[-1]
    position[..., 0] -= (mean * time)[:, None]
    position *= speed / mean  # another size of person walks at another speed
    place = walker.write_trc(tmp_path / "a.trc", walker.CMU, position)
    told = [note for note in load(place).notes if "treadmill" in note]
    assert len(told) == 1
    assert f"{speed:.1f}" in told[0] or f"{speed:.2f}" in told[0]
    held = load(place, hold_floor=True)
    travelled = np.linalg.norm(np.ptp(_place(held, "pelvis")[:, :2], axis=0))
    assert travelled == pytest.approx(speed * time[-1], rel=0.05)


@pytest.mark.parametrize("rise", [0.3, -0.3])
def test_a_drift_of_the_floor_is_told(tmp_path: Path, rise: float) -> None:
    position = walker.markers(seconds=4.0)
    position[..., 2] += np.linspace(0.0, rise, len(position))[:, None]
    place = walker.write_trc(tmp_path / "a.trc", walker.CMU, position)
    told = [note for note in load(place).notes if "planted feet" in note]
    assert len(told) == 1
    assert ("rise" if rise > 0 else "sink") in told[0]
    held = load(place, hold_floor=True)
    feet = np.c_[_place(held, "left_foot")[:, 2], _place(held, "right_foot")[:, 2]].min(axis=1)
    assert np.ptp(feet) < 0.05


@pytest.mark.parametrize("form", ["A_{}", "Skeleton 001_{}", "{}_pos", "take-7-{}", "{} 1"])
def test_what_nearly_all_labels_share_comes_off(tmp_path: Path, form: str) -> None:
    labels = [form.format(label) for label in walker.CMU]
    _is_the_walker(load(walker.write_trc(tmp_path / "a.trc", labels, walker.markers())))


SHADOW = {
    "pelvis": "Hips", "left_thigh": "LeftThigh", "left_shank": "LeftLeg", "left_foot": "LeftFoot",
    "right_thigh": "RightThigh", "right_shank": "RightLeg", "right_foot": "RightFoot",
    "left_upper_arm": "LeftArm", "left_forearm": "LeftForearm", "left_hand": "LeftHand",
    "right_upper_arm": "RightArm", "right_forearm": "RightForearm", "right_hand": "RightHand",
    "head": "Head",
}  # fmt: skip
KINECT = {
    "pelvis": "SpineBase", "left_thigh": "HipLeft", "left_shank": "KneeLeft",
    "left_foot": "AnkleLeft", "right_thigh": "HipRight", "right_shank": "KneeRight",
    "right_foot": "AnkleRight", "left_upper_arm": "ShoulderLeft", "left_forearm": "ElbowLeft",
    "left_hand": "WristLeft", "right_upper_arm": "ShoulderRight", "right_forearm": "ElbowRight",
    "right_hand": "WristRight", "head": "Head",
}  # fmt: skip
LAFAN = SHADOW | {
    "left_thigh": "LeftUpLeg", "right_thigh": "RightUpLeg", "left_forearm": "LeftForeArm",
    "right_forearm": "RightForeArm",
}  # fmt: skip


@pytest.mark.parametrize("names", [SHADOW, KINECT, LAFAN])
def test_joint_centres_are_points_on_the_body(tmp_path: Path, names: dict[str, str]) -> None:
    centres = walker.joint_centres()
    position = np.stack([centres[segment] for segment in names], axis=1)
    motion = load(walker.write_trc(tmp_path / "a.trc", list(names.values()), position))
    assert motion.marker_error_rms is not None
    assert motion.marker_error_rms < 0.01
    for segment in ("left_shank", "right_foot", "left_forearm"):
        off = _place(motion, segment) - centres[segment]
        off -= np.median(off, axis=0)  # the file's floor and heading are its own
        assert np.abs(off[:, 2]).max() < 0.02


def _legs(*names: str) -> tuple[list[str], list[int]]:
    """Names and parents of a body: root, spine, head, then the joints of arms and legs."""
    return list(names), [-1, 0, 1, 1, 3, 4, 1, 6, 7, 0, 9, 10, 0, 12, 13]


@pytest.mark.parametrize(
    "names",
    [
        "センター 上半身 頭 左腕 左ひじ 左手首 右腕 右ひじ 右手首 左足 左ひざ 左足首 "
        "右足 右ひざ 右足首",
        "骨盆 脊柱 头 左上臂 左前臂 左手 右上臂 右前臂 右手 左大腿 左小腿 左脚 右大腿 右小腿 右脚",
        "Becken Wirbelsäule Kopf Oberarm_L Unterarm_L Hand_L Oberarm_R Unterarm_R Hand_R "
        "LinkerOberschenkel LinkerUnterschenkel LinkerFuß RechterOberschenkel "
        "RechterUnterschenkel RechterFuß",
        "Hips Spine Head LeftArm LeftForeArm LeftHand RightArm RightForeArm RightHand LeftLeg "
        "LeftShin LeftFoot RightLeg RightShin RightFoot",
        "cadera columna cabeza brazo_izq antebrazo_izq mano_izq brazo_der antebrazo_der mano_der "
        "muslo_izq pierna_izq pie_izq muslo_der pierna_der pie_der",
    ],
)
def test_joints_are_known_in_other_languages(names: str) -> None:
    body = recognise(*_legs(*names.split()))
    wanted = {
        f"{side}_{part}": first + i
        for first, side, parts in (
            (3, "left", ("upper_arm", "forearm", "hand")),
            (6, "right", ("upper_arm", "forearm", "hand")),
            (9, "left", ("thigh", "shank", "foot")),
            (12, "right", ("thigh", "shank", "foot")),
        )
        for i, part in enumerate(parts)
    }
    assert {role: body.roles.get(role) for role in wanted} == wanted
    assert body.roles["head"] == 2


@pytest.mark.parametrize(
    "name", ["LeftUpLeg", "mixamorig:RightHand", "main_ctrl_x", "Bip01 L Foot"]
)
def test_english_names_stay_what_they_mean(name: str) -> None:
    assert in_english(name).isascii()
    if name != "main_ctrl_x":
        assert in_english(name) == name


SKELETON = """{root}{{
OFFSET 0 0 0
CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
JOINT {p}Spine
{{
OFFSET 0 30 0
CHANNELS 3 Zrotation Xrotation Yrotation
JOINT {p}Head
{{
OFFSET 0 30 0
CHANNELS 3 Zrotation Xrotation Yrotation
End Site
{{
OFFSET 0 15 0
}}
}}
}}
{left}{right}}}
"""
LEG = """JOINT {p}{side}UpLeg
{{
OFFSET {x} 0 0
CHANNELS 3 Zrotation Xrotation Yrotation
JOINT {p}{side}Leg
{{
OFFSET 0 -42 0
CHANNELS 3 Zrotation Xrotation Yrotation
JOINT {p}{side}Foot
{{
OFFSET 0 -42 0
CHANNELS 3 Zrotation Xrotation Yrotation
End Site
{{
OFFSET 0 -6 13
}}
}}
}}
}}
"""


def _body(prefix: str, root: str | None = None) -> str:
    legs = [LEG.format(p=prefix, side=side, x=x) for side, x in (("Left", 9), ("Right", -9))]
    return SKELETON.format(
        root=root or f"ROOT {prefix}Hips\n", p=prefix, left=legs[0], right=legs[1]
    )


def _bvh(path: Path, skeleton: str, rows: list[str]) -> Path:
    motion = f"MOTION\nFrames: {len(rows)}\nFrame Time: 0.0333333\n"
    path.write_text(f"HIERARCHY\n{skeleton}{motion}" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def _row(x: float, height: float = 92.0, joint: str = "0 0 0") -> str:
    return f"{x:.3f} {height:.3f} 0 0 0 0 " + " ".join([joint] * 8)


def test_of_two_people_one_is_taken_by_name_or_number(tmp_path: Path) -> None:
    rows = [f"{_row(float(i))} {_row(100.0 + 2 * i)}" for i in range(10)]
    place = _bvh(tmp_path / "two.bvh", _body("Ann:") + _body("Ben:"), rows)
    assert any("Ann was taken, Ben left out" in note for note in load(place).notes)
    for name in ("Ben", "2", "Ben:Hips"):
        motion = load(place, subject=name)
        assert np.ptp(_place(motion, "pelvis")[:, :2], axis=0).max() == pytest.approx(
            0.18, abs=1e-6
        )
    with pytest.raises(InputError, match="no subject 'Cid'; in the file: 'Ann', 'Ben'"):
        load(place, subject="Cid")


def test_a_person_among_markers_is_taken_by_name(tmp_path: Path) -> None:
    labels = [f"{name}:{label}" for name in ("ann", "ben") for label in walker.CMU]
    back = walker.markers()[::-1] + np.array([0.0, 2.0, 0.0])
    position = np.concatenate([walker.markers(), back], axis=1)
    place = walker.write_trc(tmp_path / "two.trc", labels, position)
    first, second = load(place, subject="ann"), load(place, subject="ben")
    assert _place(first, "pelvis")[0, 0] < 0.1
    assert _place(second, "pelvis")[0, 0] > 1.0
    with pytest.raises(InputError, match="no subject 'cid'; in the file: 'ann', 'ben'"):
        load(place, subject="cid")


def test_a_missing_blank_before_a_minus_sign_is_seen(tmp_path: Path) -> None:
    rows = [_row(float(i), joint="0.000-0.000-7.500") for i in range(10)]
    apart = [_row(float(i), joint="0.000 -0.000 -7.500") for i in range(10)]
    glued = load(_bvh(tmp_path / "a.bvh", _body(""), rows))
    plain = load(_bvh(tmp_path / "b.bvh", _body(""), apart))
    assert np.array_equal(glued.qpos, plain.qpos)


def test_hips_below_a_root_are_where_their_channels_say(tmp_path: Path) -> None:
    hips = (
        _body("").replace("ROOT Hips", "JOINT Hips").replace("OFFSET 0 0 0", "OFFSET 0 94 -520", 1)
    )
    carrier = (
        "ROOT Reference\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation "
        f"Xrotation Yrotation\n{hips}}}\n"
    )
    rows = [f"0 0 0 0 0 0 {_row(float(i))}" for i in range(10)]
    motion = load(_bvh(tmp_path / "a.bvh", carrier, rows))
    plain = load(_bvh(tmp_path / "b.bvh", _body(""), [_row(float(i)) for i in range(10)]))
    assert np.allclose(motion.qpos, plain.qpos, atol=1e-9)
