"""Small sound files of every format to start from: ``python fuzz/seeds.py FOLDER``."""

from __future__ import annotations

import io
import json
import pickle
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from targets import CUT, TOY, toy

from physretarget.capture.actor import NQ, ActorShape
from physretarget.clip import Clip, npz_bytes
from physretarget.contact.phases import Phases, write_phases
from physretarget.errors import MissingExtraError
from physretarget.face.curve import Curve
from physretarget.face.formats import write_csv, write_shot
from physretarget.face.library import Library
from physretarget.face.shot import Shot, Take
from physretarget.keyposes.file import save as save_keyposes
from physretarget.keyposes.pose import KeyPose, KeyPoseSet
from physretarget.mapping import NAMES, fit
from physretarget.mjcf import actor_character
from physretarget.trained import TrainedMapper

RIG = """name = "girl"
[groups.brows]
library = ["*brow*"]
[channels.brow_up]
group = "brows"
range = [0.0, 2.0]
from = { BrowInnerUp = 1.0, JawOpen = 0.5 }
offset = 0.25
"""

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Leg
  {
    OFFSET 0 -40 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -40 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333
0 90 0 0 0 0 10 0 0
1 90 0 0 5 0 12 0 0
"""
ASF = """:version 1.10
:name tiny
:units
  mass 1.0
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name upper
    direction 0 -1 0
    length 2
    axis 0 0 90 XYZ
    dof rx rz
    limits (-10 10)
           (-10 10)
  end
:hierarchy
  begin
    root upper
  end
"""
AMC = """#!OML:ASF tiny.asf
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 0 0 0
upper 0 0
"""
TRC = """PathFileType\t4\t(X/Y/Z)\ta.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate
100\t100\t2\t2\tm\t100
Frame#\tTime\tC7\t\t\tL_calc\t\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.00\t0\t1.4\t0.1\t0\t0.05\t-0.1
2\t0.01\t0\t1.4\t0.1\t0\t0.05\t-0.1
"""
MOT = """forces
version=1
nRows=2
nColumns=7
endheader
time\tground_force_1_vx\tground_force_1_vy\tground_force_1_vz\tground_force_1_px\tground_force_1_py\tground_force_1_pz
0\t1\t700\t2\t0.1\t0\t0.2
0.01\t1\t700\t2\t0.1\t0\t0.2
"""
CONFIG = """profile = "robot"
lowpass_hz = 6
select = ["DYN", "CON"]
ignore = ["DYN005"]
[limits.DYN001]
error = 0.3
[severity]
CON004 = "error"
"""


def seeds() -> dict[str, dict[str, bytes]]:
    """Target to name to content."""
    qpos = np.tile(toy().reference_qpos, (12, 1))
    clip = Clip(qpos=qpos, time=np.arange(12) / 30, joint_names=toy().joint_names)
    npy = io.BytesIO()
    np.save(npy, qpos)
    parts = {"root_pos": qpos[:, :3], "root_rot": qpos[:, [4, 5, 6, 3]], "dof_pos": qpos[:, 7:]}
    fields = {"fps": np.array(30.0), **parts}
    bodies = {
        "joint_pos": qpos[:, 7:], "fps": np.array([50.0]),
        "body_pos_w": np.zeros((12, 2, 3)), "body_quat_w": np.ones((12, 2, 4)) / 2,
    }  # fmt: skip
    named = {"qpos": qpos, "frequency": np.array(40.0), "split_points": np.array([0, 5, 12])}
    table = "\n".join(",".join(f"{v:g}" for v in row) for row in qpos)
    head = "px,py,pz,qw,qx,qy,qz,elbow\n"
    still = [0.05, 0, 0.9, 0, *[1, 0, 0, 0] * 4, 0, *[1, 0, 0, 0] * 2, 0, 1, 0, 0, 0, 0]
    still += [*[1, 0, 0, 0] * 2, 0]
    finding = {"clip": "still.npy", "code": "CON003", "body": None, "value": 0.4}
    return {
        "npz": {
            "own": clip.to_bytes(), "gmr": npz_bytes(fields), "mjlab": npz_bytes(bodies),
            "loco": npz_bytes(named),
        },
        "npy": {"plain": npy.getvalue()},
        "csv": {"bare": table.encode(), "named": (head + table).encode()},
        "pkl": {f"p{n}": pickle.dumps({"fps": 30, **parts}, n) for n in (0, 2, 4, 5)},
        "config": {"all": CONFIG.encode()},
        "baseline": {
            "one": json.dumps(
                {"schema": "physretarget/baseline/1", "accepted": [finding]}
            ).encode()
        },
        "mjcf": {"toy": TOY.encode()},
        "bvh": {"two": BVH.encode()},
        "trc": {"two": TRC.encode()},
        "c3d": {"two": c3d()},
        "deepmimic": {"one": json.dumps({"Loop": "wrap", "Frames": [still, still]}).encode()},
        "amc": {"tiny": ASF.encode() + CUT + AMC.encode()},
        "mot": {"one": MOT.encode()},
        **face(),
        **stages(),
    }  # fmt: skip


def stages() -> dict[str, dict[str, bytes]]:
    """Key poses of the toy, a timetable of contacts, and every kind of mapper."""
    rng = np.random.default_rng(0)
    poses = []
    for number in range(4):
        qpos = toy().reference_qpos.copy()
        qpos[7] = 0.2 * number
        actor_qpos = np.zeros(NQ)
        actor_qpos[2] = 0.9
        actor_qpos[3::4] = 1.0
        poses.append(KeyPose(
            name=f"pose{number}", source="walk.bvh", sha256="0" * 64, time=0.5 * number,
            actor_qpos=actor_qpos, qpos=qpos, planted=("left_heel",), note="",
        ))  # fmt: skip
    poseset = KeyPoseSet(
        character_name=toy().name, character_sha256=toy().sha256, license="CC0-1.0",
        poses=tuple(poses),
    )  # fmt: skip
    time = np.arange(30) / 30
    phases = Phases(("left_heel", "right_toe"), np.c_[time < 0.5, time > 0.4], time)
    actor = actor_character(ActorShape.reference())
    y = rng.normal(size=(4, 3 * len(actor.markers)))
    z = rng.normal(size=(4, 3 * len(toy().markers)))
    mappers = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "file"
        save_keyposes(poseset, path, toy())
        keyposes = path.read_bytes()
        write_phases(phases, path)
        timetable = path.read_bytes()
        for name in NAMES:
            TrainedMapper(
                character=toy(), actor=actor, mapper=fit(name, y, z, dims=2, iterations=2), y=y,
                z=z, qpos=np.stack([p.qpos for p in poses]), names=tuple(p.name for p in poses),
                sources=tuple(p.source for p in poses),
            ).save(path)  # fmt: skip
            mappers[name] = path.read_bytes()
    return {"keyposes": {"four": keyposes}, "phases": {"two": timetable}, "mapper": mappers}


def face() -> dict[str, dict[str, bytes]]:
    """A shot of two curves in every keyed format, a take, a rig, a library."""
    shot = Shot("s", {"a": Curve.through([0, 0.5, 1.25], [0, 1, 0.25]),
                      "b": Curve.through([0, 1], [2, 3], "flat")}, 30.0)  # fmt: skip
    time = np.arange(4) / 30
    take = Take("t", time, ("BrowInnerUp", "JawOpen"), np.stack([time, 1 - time], 1))
    endings = {"curves": ".curves.json", "lottie": ".lottie.json", "motion3": ".motion3.json",
               "anim": ".anim", "gltf": ".gltf"}  # fmt: skip
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for target, ending in endings.items():
            try:
                write_shot(Path(folder) / f"s{ending}", shot)
            except MissingExtraError:
                continue
            found[target] = {"two": (Path(folder) / f"s{ending}").read_bytes()}
        write_csv(Path(folder) / "t.csv", take)
        found["take"] = {"two": (Path(folder) / "t.csv").read_bytes()}
    found["rig"] = {"one": RIG.encode()}
    found |= recorders()
    found["library"] = {"one": Library.of([shot]).to_bytes()}
    return found


def recorders() -> dict[str, dict[str, bytes]]:
    """Two frames of every recorder of faces, and a clip of Unity."""
    frame = {"timestamp_ms": 33, "blendshapes": {"a": 0.5}}
    packet = "jawOpen-1|eyeBlink_L&2|=head#1,2,3|"
    osc = "/VMC/Ext/Blend/Val"
    made = {
        "take_json": {
            "audio2face": '{"exportFps": 30, "facsNames": ["a"], "weightMat": [[0], [1]]}',
            "mediapipe": json.dumps([{**frame, "timestamp_ms": 0}, frame]),
        },
        "take_lines": {
            "packets": "".join(json.dumps({"t": t, "d": packet}) + "\n" for t in (0, 16)),
            "osc": "".join(json.dumps({"time": t, "address": osc, "args": ["a", 0.5]}) + "\n"
                           for t in (0, 1)),
        },
        "take_text": {
            "facecap": "bs,a\n" + "".join(f"k,{t}" + ",1" * 11 + "\n" for t in (0, 33)),
            "packets": f"0 {packet}\n16 {packet}\n",
            "osc": "".join(f'e500000{t}.00000000 {osc} sf "a" 0.5\n' for t in (0, 1)),
        },
        "unity": {"two": "--- !u!74 &1\nAnimationClip:\n  m_FloatCurves:\n  - curve:\n"
                         "      m_Curve:\n      - {time: 0, value: 0}\n"
                         "      - {time: 1, value: 1, inSlope: Infinity}\n    attribute: a\n"},
    }  # fmt: skip
    return {target: {n: text.encode() for n, text in files.items()}
            for target, files in made.items()}  # fmt: skip


def c3d() -> bytes:
    """Two markers, two frames."""
    import ezc3d

    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["RATE"]["value"], point["LABELS"]["value"] = [50], ["LHEE", "RHEE"]
    point["UNITS"]["value"] = ["mm"]
    file["data"]["points"] = np.ones((4, 2, 2))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.c3d"
        file.write(str(path))
        return path.read_bytes()


def main() -> None:
    """Write them."""
    if len(sys.argv) != 2:
        sys.exit("usage: python fuzz/seeds.py FOLDER")
    for target, inputs in seeds().items():
        folder = Path(sys.argv[1]) / target
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in inputs.items():
            (folder / name).write_bytes(content)


if __name__ == "__main__":
    main()
