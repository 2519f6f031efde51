"""The same walk in the formats of other tools gives the same actor."""

from __future__ import annotations

import base64
import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.archives import open_archive
from physretarget.capture import load, read
from physretarget.capture.actor import SEGMENT, SEGMENTS, ActorMotion, ActorShape
from physretarget.capture.recording import MarkerRecording
from physretarget.errors import InputError, UnsafeInputError, UsageError
from physretarget.kinematics import quat_to_matrix

sys.path.insert(0, str(Path(__file__).parent))  # its neighbour, which other tests use as well
import walker

TREE = {
    "Hips": None, "Spine": "Hips", "Chest": "Spine", "Head": "Chest",
    **{
        f"{side}{part}": above if above in ("Hips", "Chest") else f"{side}{above}"
        for side in ("Left", "Right")
        for part, above in (
            ("Shoulder", "Chest"), ("Arm", "Shoulder"), ("ForeArm", "Arm"), ("Hand", "ForeArm"),
            ("UpLeg", "Hips"), ("Leg", "UpLeg"), ("Foot", "Leg"),
        )
    },
}  # fmt: skip
SEGMENT_OF = {
    "Hips": "pelvis", "Spine": "abdomen", "Chest": "chest", "Head": "head",
    **{
        f"{side.title()}{name}": f"{side}_{segment}"
        for side in ("left", "right")
        for name, segment in (
            ("Shoulder", "clavicle"), ("Arm", "upper_arm"), ("ForeArm", "forearm"),
            ("Hand", "hand"), ("UpLeg", "thigh"), ("Leg", "shank"), ("Foot", "foot"),
        )
    },
}  # fmt: skip
NAMES = list(TREE)


def _world() -> tuple[np.ndarray, np.ndarray]:
    """Places (T, J, 3) and rotations (T, J, 3, 3) of the walker's joints, z up."""
    pose = walker.pose_of(*walker.walk())
    columns = [1 + SEGMENT[SEGMENT_OF[name]] for name in NAMES]
    return pose.position[:, columns], pose.rotation[:, columns]


def _local() -> tuple[np.ndarray, np.ndarray]:
    """The same in each joint's parent."""
    position, rotation = _world()
    place, turn = position.copy(), rotation.copy()
    for j, name in enumerate(NAMES):
        if TREE[name] is not None:
            above = NAMES.index(str(TREE[name]))
            way = position[:, j] - position[:, above]
            place[:, j] = np.einsum("tji,tj->ti", rotation[:, above], way)
            turn[:, j] = np.swapaxes(rotation[:, above], 1, 2) @ rotation[:, j]
    return place, turn


def _is_the_walker(motion: ActorMotion, *, within: float = 0.002) -> None:
    pose = walker.pose_of(motion.shape, motion.qpos)
    truth = walker.pose_of(*walker.walk())
    assert motion.fps == pytest.approx(walker.FPS)
    for name in ("left_shank", "right_foot", "right_hand", "head"):
        column = 1 + SEGMENT[name]
        off = pose.position[:, column] - truth.position[:, column]
        assert np.abs(off[:, 2] - np.median(off[:, 2])).max() < within, name
        assert abs(np.median(off[:, 2])) < 0.03, name
    travel = np.linalg.norm(np.ptp(pose.position[:, 1, :2], axis=0))
    assert travel == pytest.approx(np.ptp(truth.position[:, 1, 0]), rel=0.01)
    knee = [2 * np.arccos(np.clip(np.abs(q[:, 3 + 4 * SEGMENT["left_shank"]]), 0, 1))
            for q in (motion.qpos, walker.walk()[1])]  # fmt: skip
    assert np.abs(knee[0] - knee[1]).max() < 0.03


def _gltf(path: Path, *, binary: bool, vrm: bool = False, kind: str = "LINEAR") -> Path:
    place, turn = _local()
    quats = Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_quat().reshape(*turn.shape[:2], 4)
    to_y = np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]])  # z up facing x becomes y up facing z
    blob, views, accessors = b"", [], []

    def add(values: np.ndarray, kind: str) -> int:
        nonlocal blob
        data = np.ascontiguousarray(values, dtype="<f4").tobytes()
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
        accessors.append({"bufferView": len(views) - 1, "componentType": 5126,
                          "count": len(values), "type": kind})  # fmt: skip
        blob += data
        return len(accessors) - 1

    time = add((np.arange(len(place)) / walker.FPS)[:, None], "SCALAR")
    bones = {"Hips": "hips", "Spine": "spine", "Chest": "chest", "Head": "head"} | {
        f"{s.title()}{a}": f"{s}{b}"
        for s in ("left", "right")
        for a, b in (("Shoulder", "Shoulder"), ("Arm", "UpperArm"), ("ForeArm", "LowerArm"),
                     ("Hand", "Hand"), ("UpLeg", "UpperLeg"), ("Leg", "LowerLeg"), ("Foot", "Foot"))
    }  # fmt: skip
    nodes = [
        {"name": f"n{j}" if vrm else name, "translation": place[0, j].tolist(),
         "children": [i for i, other in enumerate(NAMES) if TREE[other] == name]}
        for j, name in enumerate(NAMES)
    ]  # fmt: skip
    carrier = {"name": "Armature", "children": [0], "scale": [0.01] * 3,
               "rotation": Rotation.from_matrix(to_y).as_quat().tolist()}  # fmt: skip
    for node in nodes:
        node["translation"] = [100 * v for v in node["translation"]]
    nodes.append(carrier)
    samplers, channels = [], []
    for j in range(len(NAMES)):
        paths = [("rotation", quats[:, j], "VEC4")]
        if j == 0:
            paths.append(("translation", 100 * place[:, 0], "VEC3"))
        for target, values, shape in paths:
            if kind == "CUBICSPLINE":
                slope = np.gradient(values, 1 / walker.FPS, axis=0)
                values = np.stack([slope, values, slope], axis=1).reshape(-1, values.shape[1])
            samplers.append({"input": time, "output": add(values, shape), "interpolation": kind})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": j, "path": target}})
    document: dict[str, Any] = {
        "asset": {"version": "2.0"}, "nodes": nodes, "accessors": accessors, "bufferViews": views,
        "animations": [{"name": "walk", "samplers": samplers, "channels": channels}],
        "buffers": [{"byteLength": len(blob)}],
    }  # fmt: skip
    if vrm:
        human = {bones[name]: {"node": j} for j, name in enumerate(NAMES)}
        document["extensions"] = {"VRMC_vrm_animation": {"humanoid": {"humanBones": human}}}
    if not binary:
        data = base64.b64encode(blob).decode()
        document["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
        path.write_text(json.dumps(document))
        return path
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    size = 12 + 8 + len(text) + 8 + len(blob)
    path.write_bytes(
        struct.pack("<III", 0x46546C67, 2, size)
        + struct.pack("<II", len(text), 0x4E4F534A) + text
        + struct.pack("<II", len(blob), 0x004E4942) + blob
    )  # fmt: skip
    return path


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("a.glb", {"binary": True}),
        ("a.gltf", {"binary": False}),
        ("a.vrma", {"binary": True, "vrm": True}),
        ("a.glb", {"binary": True, "kind": "CUBICSPLINE"}),
    ],
)
def test_gltf(tmp_path: Path, name: str, options: dict[str, object]) -> None:
    _is_the_walker(load(_gltf(tmp_path / name, **options)))  # type: ignore[arg-type]


def test_gltf_reads_no_file_elsewhere(tmp_path: Path) -> None:
    path = _gltf(tmp_path / "a.gltf", binary=False)
    document = json.loads(path.read_text())
    for uri in ("../secret.bin", "/etc/passwd", "http://example.org/a.bin", "sub/a.bin"):
        document["buffers"][0]["uri"] = uri
        path.write_text(json.dumps(document))
        with pytest.raises(UnsafeInputError, match="no file beside this one"):
            load(path)
    document["buffers"][0]["uri"] = "data:;base64,AAAA"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="beyond its buffer"):
        load(path)


def test_mvnx(tmp_path: Path) -> None:
    position, rotation = _world()
    quats = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat(scalar_first=True)
    quats = quats.reshape(*rotation.shape[:2], 4)
    xsens = {"Hips": "Pelvis", "Spine": "L5", "Chest": "T8", "Head": "Head"} | {
        f"{s}{a}": f"{s}{b}"
        for s in ("Left", "Right")
        for a, b in (("Shoulder", "Shoulder"), ("Arm", "UpperArm"), ("ForeArm", "ForeArm"),
                     ("Hand", "Hand"), ("UpLeg", "UpperLeg"), ("Leg", "LowerLeg"), ("Foot", "Foot"))
    }  # fmt: skip
    segments = "".join(f'<segment label="{xsens[n]}" id="{i}"/>' for i, n in enumerate(NAMES))
    joints = "".join(
        f"<joint label='j'><connector1>{xsens[str(TREE[n])]}/j</connector1>"
        f"<connector2>{xsens[n]}/j</connector2></joint>"
        for n in NAMES if TREE[n]
    )  # fmt: skip
    rest = '<frame time="0" type="identity"><orientation>1 0</orientation></frame>'
    frames = "".join(
        f'<frame time="{t}" type="normal"><orientation>{" ".join(map(str, quats[t].ravel()))}'
        f"</orientation><position>{' '.join(map(str, position[t].ravel()))}</position></frame>"
        for t in range(len(position))
    )
    path = tmp_path / "a.mvnx"
    text = (
        f'<?xml version="1.0"?><mvnx xmlns="http://www.xsens.com/mvn/mvnx"><subject '
        f'frameRate="60"><segments>{segments}</segments><joints>{joints}</joints>'
        f"<frames>{rest}{frames}</frames></subject></mvnx>"
    )
    path.write_text(text)
    _is_the_walker(load(path))
    path.write_text(text[: len(text) // 2])
    with pytest.raises(InputError, match="damaged or cut short"):
        load(path)


def test_an_mvnx_of_entities_in_entities_is_refused(tmp_path: Path) -> None:
    bombs = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12))
    path = tmp_path / "a.mvnx"
    path.write_text(
        f'<?xml version="1.0"?><!DOCTYPE mvnx [<!ENTITY a0 "x">{bombs}]><mvnx>&a11;</mvnx>'
    )
    with pytest.raises(InputError):
        load(path)


def _motive(path: Path) -> Path:
    position, rotation = _world()
    to_y = np.array([[0, 1.0, 0], [0, 0, 1], [1, 0, 0]])
    position, rotation = position @ to_y.T, to_y @ rotation
    quats = (
        Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat().reshape(*rotation.shape[:2], 4)
    )
    names = {"Hips": "Hip", "Spine": "Ab", "Chest": "Chest", "Head": "Head"} | {
        f"{s}{a}": f"{s[0]}{b}"
        for s in ("Left", "Right")
        for a, b in (("Shoulder", "Shoulder"), ("Arm", "UArm"), ("ForeArm", "FArm"),
                     ("Hand", "Hand"), ("UpLeg", "Thigh"), ("Leg", "Shin"), ("Foot", "Foot"))
    }  # fmt: skip
    rows: list[list[object]] = [
        ["Format Version", "1.23", "Take Name", "walk", "Capture Frame Rate", "60.000000",
         "Export Frame Rate", "60.000000", "Rotation Type", "Quaternion", "Length Units", "Meters"],
        [], ["", "Type"], ["", "Name"], ["", "ID"], ["", ""], ["Frame", "Time (Seconds)"],
    ]  # fmt: skip
    for name in NAMES:
        for value, axes in (("Rotation", "XYZW"), ("Position", "XYZ")):
            for axis in axes:
                cells = ("Bone", f"anna:{names[name]}", "1", value, axis)
                for row, cell in zip((2, 3, 4, 5, 6), cells, strict=True):
                    rows[row].append(cell)
    for t in range(len(position)):
        numbers = np.concatenate([quats[t], position[t]], axis=1).ravel()
        rows.append([t, f"{t / 60:.6f}", *(f"{v:.7f}" for v in numbers)])
    path.write_text("\n".join(",".join(str(cell) for cell in row) for row in rows))
    return path


def test_motive(tmp_path: Path) -> None:
    _is_the_walker(load(_motive(tmp_path / "a.csv")))


def test_qualisys(tmp_path: Path) -> None:
    position = 1000 * walker.markers()
    lines = ["NO_OF_FRAMES\t150", "NO_OF_CAMERAS\t8", f"NO_OF_MARKERS\t{len(walker.CMU)}",
             "FREQUENCY\t60", "MARKER_NAMES\t" + "\t".join(walker.CMU)]  # fmt: skip
    lines += ["\t".join(f"{v:.3f}" for v in row.ravel()) for row in position]
    path = tmp_path / "a.tsv"
    path.write_text("\n".join(lines))
    motion = load(path)
    assert motion.marker_error_rms is not None
    assert motion.marker_error_rms < 0.005
    _is_the_walker(motion, within=0.01)
    path.write_text("\n".join([*lines, "1.0\t2.0"]))
    with pytest.raises(InputError, match="a frame must have 117 numbers, this one has 2"):
        load(path)


POINTS = {
    "left_shoulder": "left_upper_arm", "right_shoulder": "right_upper_arm",
    "left_elbow": "left_forearm", "right_elbow": "right_forearm", "left_wrist": "left_hand",
    "right_wrist": "right_hand", "left_hip": "left_thigh", "right_hip": "right_thigh",
    "left_knee": "left_shank", "right_knee": "right_shank", "left_ankle": "left_foot",
    "right_ankle": "right_foot",
}  # fmt: skip


def _points() -> np.ndarray:
    """(T, 17, 3) COCO's key points of the walker, z up."""
    centres, pose = walker.joint_centres(), walker.pose_of(*walker.walk())
    head = 1 + SEGMENT["head"]
    faces = {"nose": (0.11, 0, 0.1), "left_eye": (0.09, 0.03, 0.12),
             "right_eye": (0.09, -0.03, 0.12), "left_ear": (0, 0.08, 0.1),
             "right_ear": (0, -0.08, 0.1)}  # fmt: skip
    found = [
        pose.position[:, head] + pose.rotation[:, head] @ np.array(way) for way in faces.values()
    ]
    return np.stack([*found, *(centres[s] for s in POINTS.values())], axis=1)


COCO = ["nose", "left_eye", "right_eye", "left_ear", "right_ear", *POINTS]


@pytest.mark.parametrize("form", ["csv", "npy", "frames", "named", "dicts"])
def test_key_points(tmp_path: Path, form: str) -> None:
    position = _points()
    path = tmp_path / ("a.csv" if form == "csv" else "a.npy" if form == "npy" else "a.json")
    if form == "csv":
        header = ",".join(f"{name}_{axis}" for name in COCO for axis in "xyz")
        rows = position.reshape(len(position), -1)
        np.savetxt(path, rows, delimiter=",", header=header, comments="")
    elif form == "npy":
        np.save(path, position)
    else:
        frames: object = position.round(6).tolist()
        if form == "dicts":
            frames = [dict(zip(COCO, row, strict=True)) for row in position.round(6).tolist()]
        document = {"fps": 60, "frames": frames} | ({"names": COCO} if form == "named" else {})
        path.write_text(json.dumps(document))
    motion = load(path, rate=60.0)
    assert motion.fps == 60.0
    truth = walker.joint_centres()
    pose = walker.pose_of(motion.shape, motion.qpos)
    for name in ("left_shank", "right_foot", "left_forearm"):
        off = pose.position[:, 1 + SEGMENT[name], 2] - truth[name][:, 2]
        assert np.abs(off - np.median(off)).max() < 0.03
    with pytest.raises(UsageError, match="rate"):
        load(path, rate=0.0)


def test_seventeen_points_are_of_the_set_whose_bones_keep_their_length(tmp_path: Path) -> None:
    human36m = {
        "MidHip": None, "RHip": "right_hip", "RKnee": "right_knee", "RAnkle": "right_ankle",
        "LHip": "left_hip", "LKnee": "left_knee", "LAnkle": "left_ankle", "Spine": None,
        "Neck": None, "Nose": "nose", "HeadTop": None, "LShoulder": "left_shoulder",
        "LElbow": "left_elbow", "LWrist": "left_wrist", "RShoulder": "right_shoulder",
        "RElbow": "right_elbow", "RWrist": "right_wrist",
    }  # fmt: skip
    coco = dict(zip(COCO, np.moveaxis(_points(), 1, 0), strict=True))
    middle = {
        "MidHip": (coco["left_hip"] + coco["right_hip"]) / 2,
        "Neck": (coco["left_shoulder"] + coco["right_shoulder"]) / 2,
        "HeadTop": coco["nose"] + np.array([0, 0, 0.15]),
    }
    middle["Spine"] = (middle["MidHip"] + middle["Neck"]) / 2
    path = tmp_path / "a.npy"
    np.save(path, np.stack([middle[n] if f is None else coco[f] for n, f in human36m.items()], 1))
    recording = read(path)
    assert isinstance(recording, MarkerRecording)
    assert recording.labels[:3] == ("MidHip", "RHip", "RKnee")


def _smpl(form: str) -> dict[str, object]:
    """The walker as SMPL has it: y up, turned to stand on z, rest pose a T."""
    _, qpos = walker.walk()
    turns = Rotation.from_matrix(
        quat_to_matrix(qpos[:, 3:].reshape(-1, 4))
    ).as_matrix().reshape(len(qpos), 18, 3, 3)  # fmt: skip
    to_z = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])  # SMPL's left, up, ahead in ours
    poses = np.zeros((len(qpos), 24, 3))
    names = {"left_thigh": 1, "right_thigh": 2, "left_shank": 4, "right_shank": 5, "left_foot": 7,
             "right_foot": 8}  # fmt: skip
    for name, joint in names.items():
        local = to_z.T @ turns[:, SEGMENT[name]] @ to_z
        poses[:, joint] = Rotation.from_matrix(local).as_rotvec()
    hang = Rotation.from_euler("z", -90, degrees=True).as_rotvec()
    poses[:, 16], poses[:, 17] = hang, -hang
    root = Rotation.from_matrix(turns[:, 0] @ to_z).as_rotvec()
    if form == "aist":
        root = Rotation.from_matrix(to_z.T @ turns[:, 0] @ to_z).as_rotvec()
    poses[:, 0] = root
    trans = qpos[:, :3] @ to_z if form == "aist" else qpos[:, :3]
    flat = poses.reshape(len(qpos), -1)
    if form == "amass":
        return {"poses": np.c_[flat, np.zeros((len(qpos), 84))], "trans": trans,
                "mocap_framerate": 60.0, "betas": np.zeros(16)}  # fmt: skip
    if form == "smplx":
        return {"root_orient": flat[:, :3], "pose_body": flat[:, 3:66], "trans": trans,
                "mocap_frame_rate": 60.0}  # fmt: skip
    return {"smpl_poses": flat, "smpl_trans": trans * 93.8, "smpl_scaling": np.array([93.8]),
            "fps": 60}  # fmt: skip


@pytest.mark.parametrize("form", ["amass", "smplx", "aist"])
def test_smpl(tmp_path: Path, form: str) -> None:
    if form == "aist":
        import pickle

        path = tmp_path / "a.pkl"
        path.write_bytes(pickle.dumps(_smpl(form)))
    else:
        path = tmp_path / "a.npz"
        np.savez(path, **_smpl(form))
    motion = load(path)
    assert motion.source.up == ("y" if form == "aist" else "z")
    _is_the_walker(motion)
    assert motion.shape.height == pytest.approx(ActorShape.reference().height, abs=0.03)


def test_smpl_says_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, poses=np.zeros((4, 72)))
    with pytest.raises(InputError, match="no translation"):
        load(path)
    np.savez(path, poses=np.zeros((4, 30)), trans=np.zeros((4, 3)))
    with pytest.raises(InputError, match="turn 10 joints, a body has 22"):
        load(path)
    np.savez(path, qpos=np.zeros((4, 30)))
    with pytest.raises(InputError, match="no motion of SMPL's"):
        load(path)
    assert set(open_archive(path.read_bytes(), path)) == {"qpos"}


@pytest.mark.parametrize("name", ["cmu_131_02.fbx", "cmu_131_02.glb", "cmu_131_02.usdc"])
def test_blenders_exports_are_twins_of_the_capture(data: Path, name: str) -> None:
    pytest.importorskip({"fbx": "ufbx", "usdc": "pxr"}.get(name.rpartition(".")[2], "numpy"))
    twin = load(data / "formats" / name)
    seconds = (len(twin.time) - 0.5) / twin.fps
    first = load(data / "bvh" / "cmu" / "131_02.bvh", max_seconds=seconds)
    places = [walker.pose_of(m.shape, m.qpos).position[:, 1:] for m in (first, twin)]
    frames = min(len(p) for p in places)
    one, other = (
        p[:frames].reshape(-1, 3) - p[:frames].reshape(-1, 3).mean(axis=0) for p in places
    )
    turn = Rotation.align_vectors(one, other)[0]
    assert np.abs(one - turn.apply(other)).max() < 0.002
    assert len(SEGMENTS) == places[0].shape[1]
