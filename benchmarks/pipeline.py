"""Speed of a learned mapper's way through the stages, learning, memory; rivals in the same run.

    python -m benchmarks.pipeline [--other PYTHON]

PYTHON is an interpreter of an environment with GPy, whose MRD learns the same pairs. Memory is
that of a whole process which retargets ten minutes of a looped capture.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import root_height
from benchmarks.row import Row, best_of, markdown
from physretarget import capture, keyposes, mapping, ocp
from physretarget.capture.actor import ActorMotion
from physretarget.demo import models_folder, motions_folder
from physretarget.mjcf import Character
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.trained import TrainedMapper, learn
from physretarget.wholebody import balance

MODELS = models_folder()
SECONDS = 60.0
GPY = """
import sys, time, json, warnings
import numpy as np
warnings.simplefilter("ignore")
data = np.load(sys.argv[1])
y, z = ((data[k] - data[k].mean(0)) / (data[k] - data[k].mean(0)).std() for k in "yz")
from GPy.models import MRD
np.random.seed(0)
model = MRD([y, z], input_dim=min(30, len(y) - 1), num_inducing=len(y))
began = time.process_time()
model.optimize(max_iters=70)
print(json.dumps(time.process_time() - began))
"""


def mapper() -> TrainedMapper:
    lamp = Character.load(MODELS / "lamp.xml")
    return learn(lamp, keyposes.load_keyposes([MODELS / "lamp.keyposes.toml"], lamp))


def performance(seconds: float, fps: float = 30.0) -> ActorMotion:
    """The dance and the jump, to and fro, until the time is full."""
    motions = [
        capture.load(motions_folder() / f"humanoid3d_{name}.txt", fps=fps)
        for name in ("dance_a", "jump")
    ]
    qpos = np.concatenate([np.concatenate([m.qpos, m.qpos[::-1]]) for m in motions])
    frames = round(seconds * fps)
    qpos = np.tile(qpos, (frames // len(qpos) + 1, 1))[:frames]
    return replace(
        motions[0],
        qpos=qpos,
        time=np.arange(frames) / fps,
        fps=fps,
        valid=np.ones(frames, dtype=bool),
    )


def learning(other: str | None) -> list[Row]:
    trained = mapper()
    y, z = trained.y[:30], trained.z[:30]
    spent = best_of(3, lambda: mapping.fit("sgplvm", y, z))
    rival, seconds = "", None
    if other:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "pairs.npz"
            np.savez(path, y=y, z=z)
            done = subprocess.run(
                [other, "-c", GPY, str(path)], capture_output=True, text=True, check=False
            )
        seconds = json.loads(done.stdout) if done.returncode == 0 else None
        rival = "GPy MRD, 70 iterations" if seconds else "GPy MRD does not run here"
    return [
        Row(
            name="learn 30 key poses, 30 dimensions",
            value=spent,
            unit="s",
            aim=1.0,
            rival=rival,
            rival_value=seconds,
        )
    ]


def stages() -> list[Row]:
    """Real time divided by processor time, one minute at 30 fps."""
    trained, motion = mapper(), performance(SECONDS)

    def once(until: str) -> Callable[[], Retargeted]:
        settings = RetargetSettings(until=until)  # type: ignore[arg-type]
        return lambda: retarget(motion, trained, settings=settings)

    contacted = best_of(3, once("contacted"))
    made = once("contacted")()
    assert made.contacted is not None
    clip = (made.contacted.qpos, made.clip.time, made.contacted.active)
    lamp = trained.character
    rows = [
        Row(
            name="capture to contact: features, mapping, IK, transform, contact",
            value=SECONDS / contacted,
            unit="× real time",
            aim=20.0,
            higher=True,
            note="one minute of dance and jump at 30 fps",
        )
    ]
    for preset in ocp.PRESETS:
        spent = best_of(
            2,
            lambda p=preset: ocp.optimise(lamp, *clip, settings=ocp.RootHeightSettings.preset(p)),
        )
        rows.append(
            Row(
                name=f"root height, preset {preset}",
                value=SECONDS / spent,
                unit="× real time",
                aim=20.0 if preset == "default" else None,
                higher=True,
            )
        )
    height = ocp.optimise(lamp, *clip).qpos
    spent = best_of(2, lambda: balance(lamp, height, *clip[1:]))
    rows.append(
        Row(
            name="balance",
            value=SECONDS / spent,
            unit="× real time",
            higher=True,
            note="three quarters of the same clip's frames are infeasible before",
        )
    )
    short = tuple(part[:600] for part in clip)
    ours = best_of(2, lambda: ocp.optimise(lamp, *short))
    theirs = best_of(1, lambda: root_height.reference(lamp, short))
    rows.append(
        Row(
            name="root height of 20 s",
            value=ours,
            unit="s",
            rival="scipy least_squares, same residuals and Jacobian, 50 evaluations",
            rival_value=theirs,
            note="the whole continuation and the bound",
        )
    )
    return rows


def looped_bvh(path: Path, minutes: float, fps: float) -> None:
    """A BVH of the performance: joints of the actor as rotations ZXY, centimetres, y up."""
    motion = performance(10.0, fps)
    shape, tree = motion.shape, motion.shape.tree()
    children: dict[int, list[int]] = {}
    for body in range(2, len(tree.parent)):
        children.setdefault(int(tree.parent[body]), []).append(body)
    names = ["", *shape_names()]
    order: list[int] = []
    lines = ["HIERARCHY"]

    def cm(vector: np.ndarray) -> str:
        x, y, z = 100 * vector
        return f"{y:.5f} {z:.5f} {x:.5f}"

    def joint(body: int) -> None:
        order.append(body)
        root = body == 1
        lines.extend(
            [
                f"{'ROOT' if root else 'JOINT'} {names[body]}",
                "{",
                f"OFFSET {'0 0 0' if root else cm(shape.offset[body - 1])}",
                "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation"
                if root
                else "CHANNELS 3 Zrotation Xrotation Yrotation",
            ]
        )
        for child in children.get(body, []):
            joint(child)
        if body not in children:
            lines.extend(["End Site", "{", f"OFFSET {cm(shape.tip[body - 1])}", "}"])
        lines.append("}")

    joint(1)
    quats = motion.qpos[:, 3:].reshape(len(motion.qpos), -1, 4)
    # World axes x, y, z of ours are z, x, y of the file.
    vectors = Rotation.from_quat(quats.reshape(-1, 4), scalar_first=True).as_rotvec()
    turned = Rotation.from_rotvec(vectors[:, [1, 2, 0]]).as_euler("ZXY", degrees=True)
    angles = turned.reshape(len(quats), -1)
    columns = np.concatenate([np.arange(3 * (b - 1), 3 * b) for b in order])
    place = 100 * motion.qpos[:, [1, 2, 0]]
    rows = np.concatenate([place, angles[:, columns]], axis=1)
    text = [" ".join(f"{v:.4f}" for v in row) + "\n" for row in rows]
    frames = round(60 * minutes * fps)
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {1 / fps:.8f}"]
    with path.open("w") as file:
        file.write("\n".join(lines) + "\n")
        for index in range(frames):
            file.write(text[index % len(text)])


def shape_names() -> tuple[str, ...]:
    from physretarget.capture.actor import SEGMENTS

    plain = {"pelvis": "Hips", "abdomen": "Spine", "chest": "Chest", "head": "Head"}
    limbs = {
        "clavicle": "Shoulder", "upper_arm": "Arm", "forearm": "ForeArm", "hand": "Hand",
        "thigh": "UpLeg", "shank": "Leg", "foot": "Foot",
    }  # fmt: skip
    names = []
    for segment in SEGMENTS:
        side, _, limb = segment.partition("_")
        names.append(plain.get(segment) or side.capitalize() + limbs[limb])
    return tuple(names)


def memory() -> list[Row]:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        trained = Path(folder) / "lamp.npz"
        mapper().save(trained)
        for fps, told in ((30, None), (120, None), (120, 120.0)):
            source = Path(folder) / f"looped{fps}.bvh"
            looped_bvh(source, 10.0, fps)
            began = time.perf_counter()
            done = subprocess.run(
                [
                    sys.executable, "-m", "benchmarks.pipeline",
                    "--peak", str(source), str(trained), str(told or 0),
                ],
                capture_output=True, text=True, check=True, env=dict(os.environ),
            )  # fmt: skip
            clip = f", clip at {told:g} fps" if told else ""
            rows.append(
                Row(
                    name=f"peak memory of a 10-minute BVH at {fps} fps, all stages{clip}",
                    value=json.loads(done.stdout),
                    unit="MB",
                    aim=1000.0,
                    note=f"{time.perf_counter() - began:.0f} s from file to file",
                )
            )
    return rows


def _peak(source: str, trained: str, fps: str) -> None:
    """``fps`` of the clip, 0 for what is chosen by itself."""
    lamp = Character.load(MODELS / "lamp.xml")
    settings = RetargetSettings(fps=float(fps) or None)
    result = retarget(capture.load(source), TrainedMapper.load(trained, lamp), settings=settings)
    result.clip.save(Path(trained).with_name("out.npz"))
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def run(other: str | None = None) -> list[Row]:
    return [*learning(other), *stages(), *memory()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--other", help="interpreter of an environment with GPy")
    parser.add_argument("--peak", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak:
        _peak(*options.peak)
    else:
        print(markdown(run(options.other)))


if __name__ == "__main__":
    main()
