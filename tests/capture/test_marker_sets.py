from __future__ import annotations

import numpy as np
import pytest

from physretarget.capture.actor import SEGMENTS
from physretarget.capture.marker_sets import normal_label, recognise, up_axis


@pytest.mark.parametrize(
    ("label", "landmark", "segment"),
    [
        ("male:LFHD", "left head_front_side", "head"),
        ("subject 1:RBWT", "right psis", "pelvis"),
        ("LASI", "left asis", "pelvis"),
        ("L_IAS", "left asis", "pelvis"),
        ("r.ASIS_study", "right asis", "pelvis"),
        ("V.Sacral", "sacrum", "pelvis"),
        ("WaistLFront", "left asis", "pelvis"),
        ("R_HJC_reg", "right hip_centre", "pelvis"),
        ("RKNE", "right knee_lateral", "right_thigh"),
        ("r_mknee_study", "right knee_medial", "right_thigh"),
        ("R.Knee.Lat", "right knee_lateral", "right_thigh"),
        ("LKneeOut", "left knee_lateral", "left_thigh"),
        ("L_FAX", "left fibula", "left_shank"),
        ("LSHN", "left shank", "left_shank"),
        ("LTIB", "left shank", "left_shank"),
        ("r_shank_antsup", "right shank_upper", "right_shank"),
        ("RLM", "right ankle_lateral", "right_shank"),
        ("L_calc", "left heel", "left_foot"),
        ("L_FCC", "left heel", "left_foot"),
        ("R_5meta", "right fifth_metatarsal", "right_foot"),
        ("L_SAJ", "left acromion", "left_clavicle"),
        ("R.Acromium", "right acromion", "right_clavicle"),
        ("L_HLE", "left elbow_lateral", "left_upper_arm"),
        ("R_melbow_study", "right elbow_medial", "right_upper_arm"),
        ("LWRA", "left wrist_radius", "left_forearm"),
        ("L_UHE", "left wrist_ulna", "left_forearm"),
        ("RFIN", "right hand", "right_hand"),
        ("TV8", "t8", "chest"),
        ("SXS", "strn", "chest"),
        ("Knee_Left", "left knee_lateral", "left_thigh"),
    ],
)
def test_labels_of_many_sets(label, landmark, segment):
    (found,) = recognise([label])
    assert found is not None
    assert (found.name, SEGMENTS[found.segment]) == (landmark, segment)


def test_sides_mirror():
    left, right = recognise(["L_FM5", "R_FM5"])
    assert left is not None
    assert right is not None
    np.testing.assert_allclose(left.local * [1, -1, 1], right.local, atol=1e-12)


def test_key_points_are_joint_centres_only_where_the_file_is_of_key_points():
    labels = ["Neck", "RShoulder", "RHip", "LHip", "RKnee", "RAnkle", "RBigToe"]
    centre = recognise(labels)[labels.index("RKnee")]
    skin = recognise(["RKnee"])[0]
    assert centre is not None
    assert skin is not None
    assert abs(centre.local[1]) < 1e-9 < abs(skin.local[1])


def test_augmented_markers_replace_the_video_key_points_beside_them():
    found = recognise(["RKnee", "r_knee_study", "RHip", "LHip", "RAnkle", "RBigToe"])
    assert [mark is not None for mark in found] == [False, True, False, False, False, False]


def test_what_is_no_marker_is_not_known():
    assert recognise(["LHipAngles", "*115", "", "Camera_1", "box"]) == (None,) * 5
    assert normal_label("a:b:L_Foo.Bar_study") == "lfoobar"


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_up_axis_is_where_the_head_is(axis):
    position = np.zeros((20, 4, 3))
    position[:, :2, axis] = 1.7
    labels = ["LFHD", "C7", "LHEE", "RTOE"]
    assert up_axis(labels, position) == "xyz"[axis]
    position[10:, :2, axis] = 0.0  # half of the time lying on the back
    position[10:, :2, axis - 1] = 1.7
    assert up_axis(labels, position) is None
    assert up_axis(["a", "b", "c", "d"], position) is None
