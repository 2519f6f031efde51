from __future__ import annotations

import pytest

from physretarget.capture.names import recognise, split_name

# Skeletons as written by capture systems and animation packages: name(parent's name)…,
# with the joints that must be found.
LIMBS = ("thigh", "shank", "foot", "toe", "clavicle", "upper_arm", "forearm", "hand")
CENTRAL = ("hips", "chest", "neck", "head")

FAMILIES: dict[str, dict[str, object]] = {
    "mixamo": {
        "trunk": ["mixamorig:Hips", "mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"],
        "neck": ["mixamorig:Neck", "mixamorig:Head", "mixamorig:HeadTop_End"],
        "leg": ["mixamorig:{Side}UpLeg", "mixamorig:{Side}Leg", "mixamorig:{Side}Foot",
             "mixamorig:{Side}ToeBase", "mixamorig:{Side}Toe_End"],
        "arm": ["mixamorig:{Side}Shoulder", "mixamorig:{Side}Arm", "mixamorig:{Side}ForeArm",
             "mixamorig:{Side}Hand", "mixamorig:{Side}HandMiddle1"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "lafan1": {
        "trunk": ["Hips", "Spine", "Spine1", "Spine2"], "neck": ["Neck", "Head"],
        "leg": ["{Side}UpLeg", "{Side}Leg", "{Side}Foot", "{Side}Toe"],
        "arm": ["{Side}Shoulder", "{Side}Arm", "{Side}ForeArm", "{Side}Hand"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "cmu_motionbuilder": {
        "trunk": ["Hips", "LowerBack", "Spine", "Spine1"], "neck": ["Neck", "Neck1", "Head"],
        "leg": ["{S}HipJoint", "{Side}UpLeg", "{Side}Leg", "{Side}Foot", "{Side}ToeBase"],
        "arm": ["{Side}Shoulder", "{Side}Arm", "{Side}ForeArm", "{Side}Hand",
             "{Side}FingerBase", "{Side}HandIndex1"],
        "central": (0, 3, 0, 2), "limb": (1, 2, 3, 4), "upper": (0, 1, 2, 3),
    },
    "100style": {
        "trunk": ["Hips", "Chest", "Chest2", "Chest3", "Chest4"], "neck": ["Neck", "Head"],
        "leg": ["{Side}Hip", "{Side}Knee", "{Side}Ankle", "{Side}Toe"],
        "arm": ["{Side}Collar", "{Side}Shoulder", "{Side}Elbow", "{Side}Wrist"],
        "central": (0, 4, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "rokoko": {
        "trunk": ["Hips", "Spine1", "Spine2", "Spine3", "Spine4"], "neck": ["Neck", "Head"],
        "leg": ["{Side}Thigh", "{Side}Shin", "{Side}Foot", "{Side}Toe"],
        "arm": ["{Side}Shoulder", "{Side}Arm", "{Side}ForeArm", "{Side}Hand",
             "{Side}Finger3Metacarpal"],
        "central": (0, 4, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "xsens": {
        "trunk": ["Hips", "Chest", "Chest2", "Chest3", "Chest4"], "neck": ["Neck", "Head"],
        "leg": ["{Side}Hip", "{Side}Knee", "{Side}Ankle", "{Side}Toe"],
        "arm": ["{Side}Collar", "{Side}Shoulder", "{Side}Elbow", "{Side}Wrist"],
        "central": (0, 4, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "xsens_mvn": {
        "trunk": ["Pelvis", "L5", "L3", "T12", "T8"], "neck": ["Neck", "Head"],
        "leg": ["{Side}UpperLeg", "{Side}LowerLeg", "{Side}Foot", "{Side}Toe"],
        "arm": ["{Side}Shoulder", "{Side}UpperArm", "{Side}ForeArm", "{Side}Hand"],
        "central": (0, 4, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "acclaim": {
        "trunk": ["root", "lowerback", "upperback", "thorax"],
        "neck": ["lowerneck", "upperneck", "head"],
        "leg": ["{s}hipjoint", "{s}femur", "{s}tibia", "{s}foot", "{s}toes"],
        "arm": ["{s}clavicle", "{s}humerus", "{s}radius", "{s}wrist", "{s}hand", "{s}fingers"],
        "central": (0, 3, 0, 2), "limb": (1, 2, 3, 4), "upper": (0, 1, 2, 4),
    },
    "rigify": {
        "trunk": ["DEF-spine", "DEF-spine.001", "DEF-spine.002", "DEF-spine.003"],
        "neck": ["DEF-neck", "DEF-head"],
        "leg": ["DEF-thigh.{S}", "DEF-shin.{S}", "DEF-foot.{S}", "DEF-toe.{S}"],
        "arm": ["DEF-shoulder.{S}", "DEF-upper_arm.{S}", "DEF-forearm.{S}", "DEF-hand.{S}"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "character_studio": {
        "trunk": ["Bip01", "Bip01 Pelvis", "Bip01 Spine", "Bip01 Spine1", "Bip01 Spine2"],
        "neck": ["Bip01 Neck", "Bip01 Head", "Bip01 HeadNub"],
        "leg": ["Bip01 {S} Thigh", "Bip01 {S} Calf", "Bip01 {S} Foot", "Bip01 {S} Toe0",
             "Bip01 {S} Toe0Nub"],
        "arm": ["Bip01 {S} Clavicle", "Bip01 {S} UpperArm", "Bip01 {S} Forearm",
             "Bip01 {S} Hand", "Bip01 {S} Finger0"],
        "central": (1, 4, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3), "hips": 1,
    },
    "smpl": {
        "trunk": ["m_avg_Pelvis", "m_avg_Spine1", "m_avg_Spine2", "m_avg_Spine3"],
        "neck": ["m_avg_Neck", "m_avg_Head"],
        "leg": ["m_avg_{S}_Hip", "m_avg_{S}_Knee", "m_avg_{S}_Ankle", "m_avg_{S}_Foot"],
        "arm": ["m_avg_{S}_Collar", "m_avg_{S}_Shoulder", "m_avg_{S}_Elbow", "m_avg_{S}_Wrist",
             "m_avg_{S}_Hand"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "smplx": {
        "trunk": ["pelvis", "spine1", "spine2", "spine3"], "neck": ["neck", "head", "jaw"],
        "leg": ["{side}_hip", "{side}_knee", "{side}_ankle", "{side}_foot"],
        "arm": ["{side}_collar", "{side}_shoulder", "{side}_elbow", "{side}_wrist",
             "{side}_middle1"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "unreal": {
        "trunk": ["pelvis", "spine_01", "spine_02", "spine_03"], "neck": ["neck_01", "head"],
        "leg": ["thigh_{s}", "calf_{s}", "foot_{s}", "ball_{s}"],
        "arm": ["clavicle_{s}", "upperarm_{s}", "lowerarm_{s}", "hand_{s}", "middle_01_{s}"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "vrm": {
        "trunk": ["J_Bip_C_Hips", "J_Bip_C_Spine", "J_Bip_C_Chest", "J_Bip_C_UpperChest"],
        "neck": ["J_Bip_C_Neck", "J_Bip_C_Head"],
        "leg": ["J_Bip_{S}_UpperLeg", "J_Bip_{S}_LowerLeg", "J_Bip_{S}_Foot",
             "J_Bip_{S}_ToeBase"],
        "arm": ["J_Bip_{S}_Shoulder", "J_Bip_{S}_UpperArm", "J_Bip_{S}_LowerArm",
             "J_Bip_{S}_Hand"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "daz": {
        "trunk": ["hip", "abdomenLower", "abdomenUpper", "chestLower", "chestUpper"],
        "neck": ["neckLower", "neckUpper", "head"],
        "leg": ["{s}ThighBend", "{s}ThighTwist", "{s}Shin", "{s}Foot", "{s}Toe"],
        "arm": ["{s}Collar", "{s}ShldrBend", "{s}ShldrTwist", "{s}ForearmBend",
             "{s}ForearmTwist", "{s}Hand"],
        "central": (0, 4, 0, 2), "limb": (0, 2, 3, 4), "upper": (0, 1, 3, 5),
    },
    "poser": {
        "trunk": ["Hip", "Abdomen", "Chest"], "neck": ["Neck", "Head"],
        "leg": ["{S}Hip", "{S}Thigh", "{S}Shin", "{S}Foot", "{S}Toe"],
        "arm": ["{S}Collar", "{S}Shldr", "{S}ForeArm", "{S}Hand"],
        "central": (0, 2, 0, 1), "limb": (1, 2, 3, 4), "upper": (0, 1, 2, 3),
    },
    "accad": {
        "trunk": ["Hips", "ToSpine", "Spine", "Spine1"], "neck": ["Neck", "Head"],
        "leg": ["{Side}UpLeg", "{Side}Leg", "{Side}Foot", "{Side}ToeBase"],
        "arm": ["{Side}Shoulder", "{Side}Arm", "{Side}ForeArm", "{Side}Hand"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "bandai2": {
        "trunk": ["joint_Root", "Hips", "Spine", "Chest"], "neck": ["Neck", "Head"],
        "leg": ["UpperLeg_{S}", "LowerLeg_{S}", "Foot_{S}", "Toes_{S}"],
        "arm": ["Shoulder_{S}", "UpperArm_{S}", "LowerArm_{S}", "Hand_{S}"],
        "central": (1, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3), "hips": 1,
    },
    "perception_neuron": {
        "trunk": ["Robot_Hips", "Robot_Spine", "Robot_Spine1", "Robot_Spine2"],
        "neck": ["Robot_Neck", "Robot_Head"],
        "leg": ["Robot_{Side}UpLeg", "Robot_{Side}Leg", "Robot_{Side}Foot"],
        "arm": ["Robot_{Side}Shoulder", "Robot_{Side}Arm", "Robot_{Side}ForeArm",
             "Robot_{Side}Hand", "Robot_{Side}InHandMiddle"],
        "central": (0, 3, 0, 1), "limb": (0, 1, 2), "upper": (0, 1, 2, 3),
    },
    "upper_case": {
        "trunk": ["HIPS", "SPINE", "CHEST"], "neck": ["NECK", "HEAD"],
        "leg": ["{SIDE}_UPPER_LEG", "{SIDE}_LOWER_LEG", "{SIDE}_FOOT", "{SIDE}_TOES"],
        "arm": ["{SIDE}_SHOULDER", "{SIDE}_UPPER_ARM", "{SIDE}_LOWER_ARM", "{SIDE}_HAND"],
        "central": (0, 2, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "motive": {
        "trunk": ["Hips", "Ab", "Chest"], "neck": ["Neck", "Head"],
        "leg": ["{S}Thigh", "{S}Shin", "{S}Foot", "{S}Toe"],
        "arm": ["{S}Shoulder", "{S}UArm", "{S}FArm", "{S}Hand"],
        "central": (0, 2, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "arkit": {
        "trunk": ["root", "hips_joint", "spine_1_joint", "spine_7_joint"],
        "neck": ["neck_1_joint", "head_joint"],
        "leg": ["{side}_upLeg_joint", "{side}_leg_joint", "{side}_foot_joint",
                "{side}_toes_joint"],
        "arm": ["{side}_shoulder_1_joint", "{side}_arm_joint", "{side}_forearm_joint",
                "{side}_hand_joint"],
        "central": (1, 3, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3), "hips": 1,
    },
    "auto_rig_pro": {
        "trunk": ["root.x", "spine_01.x", "spine_02.x"], "neck": ["neck.x", "head.x"],
        "leg": ["thigh_stretch.{s}", "leg_stretch.{s}", "foot.{s}", "toes_01.{s}"],
        "arm": ["shoulder.{s}", "arm_stretch.{s}", "forearm_stretch.{s}", "hand.{s}"],
        "central": (0, 2, 0, 1), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3),
    },
    "makehuman": {
        "trunk": ["root", "spine05", "spine03", "spine01"], "neck": ["neck01", "neck02", "head"],
        "leg": ["upperleg01.{S}", "upperleg02.{S}", "lowerleg01.{S}", "lowerleg02.{S}",
                "foot.{S}", "toe1-1.{S}"],
        "arm": ["clavicle.{S}", "upperarm01.{S}", "upperarm02.{S}", "lowerarm01.{S}",
                "lowerarm02.{S}", "wrist.{S}"],
        "central": (0, 3, 0, 2), "limb": (0, 2, 4, 5), "upper": (0, 1, 3, 5),
    },
    "kinect": {
        "trunk": ["SpineBase", "SpineMid", "SpineShoulder"], "neck": ["Neck", "Head"],
        "leg": ["Hip{Side}", "Knee{Side}", "Ankle{Side}", "Foot{Side}"],
        "arm": ["Shoulder{Side}", "Elbow{Side}", "Wrist{Side}", "Hand{Side}"],
        "central": (0, 2, 0, 1), "limb": (0, 1, 2, 3), "upper": (None, 0, 1, 2),
    },
    "iclone": {
        "trunk": ["CC_Base_BoneRoot", "CC_Base_Hip", "CC_Base_Waist", "CC_Base_Spine01",
                  "CC_Base_Spine02"],
        "neck": ["CC_Base_NeckTwist01", "CC_Base_NeckTwist02", "CC_Base_Head"],
        "leg": ["CC_Base_{S}_Thigh", "CC_Base_{S}_Calf", "CC_Base_{S}_Foot",
                "CC_Base_{S}_ToeBase"],
        "arm": ["CC_Base_{S}_Clavicle", "CC_Base_{S}_Upperarm", "CC_Base_{S}_Forearm",
                "CC_Base_{S}_Hand"],
        "central": (1, 4, 0, 2), "limb": (0, 1, 2, 3), "upper": (0, 1, 2, 3), "hips": 1,
    },
}  # fmt: skip


def skeleton(family: dict[str, object]) -> tuple[list[str], list[int], dict[str, int]]:
    """Names, parents and the expected roles of a family."""
    names: list[str] = []
    parents: list[int] = []

    def chain(items: list[str], parent: int) -> list[int]:
        placed = []
        for name in items:
            names.append(name)
            parents.append(parent)
            parent = len(names) - 1
            placed.append(parent)
        return placed

    trunk = chain(family["trunk"], -1)  # type: ignore[arg-type]
    neck = chain(family["neck"], trunk[-1])  # type: ignore[arg-type]
    hips, chest, first, head = family["central"]  # type: ignore[misc]
    roles = {"hips": trunk[hips], "chest": trunk[chest], "neck": neck[first], "head": neck[head]}
    for side in ("left", "right"):
        words = {
            "Side": side.title(), "side": side, "SIDE": side.upper(),
            "S": side[0].upper(), "s": side[0],
        }  # fmt: skip
        leg = chain([n.format(**words) for n in family["leg"]], trunk[family.get("hips", 0)])  # type: ignore
        arm = chain([n.format(**words) for n in family["arm"]], trunk[-1])  # type: ignore
        for role, at in zip(LIMBS[:4], family["limb"], strict=False):  # type: ignore[call-overload]
            roles[f"{side}_{role}"] = leg[at]
        for role, at in zip(LIMBS[4:], family["upper"], strict=False):  # type: ignore[call-overload]
            if at is not None:
                roles[f"{side}_{role}"] = arm[at]
    return names, parents, roles


@pytest.mark.parametrize("family", FAMILIES)
def test_every_system_s_joints_are_recognised(family: str) -> None:
    names, parents, expected = skeleton(FAMILIES[family])
    found = recognise(names, parents).roles
    got = {role: names[found[role]] if role in found else None for role in expected}
    assert got == {role: names[joint] for role, joint in expected.items()}


@pytest.mark.parametrize(
    ("name", "side", "tokens"),
    [
        ("mixamorig:LeftUpLeg", "left", ("up", "leg")),
        ("upper_arm.R", "right", ("upper", "arm")),
        ("lfemur", "left", ("femur",)),
        ("Bip01 R Thigh", "right", ("bip01", "thigh")),
        ("Hips", None, ("hips",)),
        ("rShldr", "right", ("shldr",)),
        ("Spine_01", None, ("spine", "01")),
        ("LHipJoint", "left", ("hip", "joint")),
        ("LUArm", "left", ("uarm",)),
        ("left_upLeg_joint", "left", ("up", "leg")),
    ],
)
def test_sides_are_told_from_names(name: str, side: str | None, tokens: tuple[str, ...]) -> None:
    assert split_name(name) == (side, tokens)


def test_nothing_is_invented() -> None:
    found = recognise(["a", "b", "c"], [-1, 0, 1])
    assert dict(found.roles) == {}
    assert found.spine == ()


def test_an_unnamed_joint_between_named_ones_is_found_by_structure() -> None:
    names = ["Hips", "LeftUpLeg", "Bone.7", "Bone.8", "RightUpLeg", "RightLeg", "RightFoot"]
    found = recognise(names, [-1, 0, 1, 2, 0, 4, 5]).roles
    assert names[found["left_shank"]] == "Bone.7"
    assert names[found["left_foot"]] == "Bone.8"
