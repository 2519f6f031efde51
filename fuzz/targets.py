"""What is fuzzed: for every reader a function of bytes that may raise PhysretargetError only.

The functions need no fuzzer: tests replay with them what once broke a reader.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from physretarget import capture
from physretarget.capture.mot import read_mot
from physretarget.capture.recording import JointRecording
from physretarget.clip import load_clip, open_clip
from physretarget.contact.phases import read_phases
from physretarget.errors import PhysretargetError
from physretarget.face.formats import read_shots, read_take
from physretarget.face.library import Library
from physretarget.face.rig import Rig
from physretarget.keyposes.file import load_keyposes
from physretarget.mjcf import Character
from physretarget.mjcf.audit import audit
from physretarget.trained import TrainedMapper
from physretarget.validation import (
    RULES,
    Settings,
    apply_baseline,
    load_baseline,
    load_settings,
    validate,
)

# Longer clips and captures are read, but not judged or fitted: a fuzzer wants thousands of tries.
_JUDGED_FRAMES, _FITTED_FRAMES = 40, 3
# Between the skeleton and the motion in an input for Acclaim files.
CUT = b"\n%%%%\n"

TOY = """<mujoco><worldbody><geom type="plane" size="2 2 .1"/>
<body name="box" pos="0 0 .1"><freejoint name="root"/><geom type="box" size=".1 .1 .1" mass="3"/>
<body name="arm" pos=".1 0 .1"><joint name="elbow" axis="0 1 0" range="-90 90"/>
<geom type="capsule" fromto="0 0 0 0 0 .3" size=".02" mass=".2"/></body></body>
</worldbody></mujoco>"""


@cache
def toy() -> Character:
    """A box with an arm: eight coordinates."""
    return Character.from_xml(TOY, name="toy")


def _file(content: bytes, suffix: str, folder: str) -> Path:
    path = Path(folder) / f"input{suffix}"
    path.write_bytes(content)
    return path


def _clip(suffix: str) -> Callable[[bytes, str], None]:
    def read(content: bytes, folder: str) -> None:
        path = _file(content, suffix, folder)
        load_clip(path, fps=30, quat="wxyz")
        clip = open_clip(path, character=toy(), fps=30)
        if clip.frames <= _JUDGED_FRAMES:
            validate(clip, toy(), settings=Settings(also_literature=True))

    return read


def _take(suffix: str) -> Callable[[bytes, str], None]:
    return lambda content, folder: void(read_take(_file(content, suffix, folder)))


def _capture(suffix: str) -> Callable[[bytes, str], None]:
    def read(content: bytes, folder: str) -> None:
        path = _file(content, suffix, folder)
        recording = capture.read(path)
        if isinstance(recording, JointRecording) and len(recording.time) <= _FITTED_FRAMES:
            capture.load(path)

    return read


def _shots(suffix: str) -> Callable[[bytes, str], None]:
    def read(content: bytes, folder: str) -> None:
        for shot in read_shots(_file(content, suffix, folder)):
            for curve in shot.curves.values():
                curve.evaluate([curve.start, 0.5 * (curve.start + curve.end), curve.end])

    return read


def _amc(content: bytes, folder: str) -> None:
    skeleton, _, motion = content.partition(CUT)
    capture.read(_file(motion, ".amc", folder), skeleton=_file(skeleton, ".asf", folder))


def _mjcf(content: bytes, folder: str) -> None:
    character = Character.load(_file(content, ".xml", folder), untrusted=True)
    audit(character)
    if character.tree.nq and character.tree.nq <= 60:
        qpos = np.tile(character.reference_qpos, (5, 1))
        clip = load_clip(_npy(qpos, folder), character=character, fps=30)
        validate(clip, character)


def _npy(qpos: np.ndarray, folder: str) -> Path:
    path = Path(folder) / "still.npy"
    np.save(path, qpos)
    return path


def _config(content: bytes, folder: str) -> None:
    load_settings(_file(content, ".toml", folder), RULES)


def _mapper(content: bytes, folder: str) -> None:
    trained = TrainedMapper.load(_file(content, ".npz", folder), toy())
    trained.mapper.predict(trained.y)
    trained.nearest_pose(trained.y)


@cache
def _report():  # type: ignore[no-untyped-def]
    with tempfile.TemporaryDirectory() as folder:
        qpos = np.tile(toy().reference_qpos, (12, 1))
        qpos[:, 2] += 0.5
        return validate(load_clip(_npy(qpos, folder), character=toy(), fps=30), toy())


def _baseline(content: bytes, folder: str) -> None:
    apply_baseline(_report(), load_baseline(_file(content, ".json", folder)))


TARGETS: dict[str, Callable[[bytes, str], None]] = {
    "npz": _clip(".npz"),
    "npy": _clip(".npy"),
    "csv": _clip(".csv"),
    "pkl": _clip(".pkl"),
    "motion": _clip(".motion"),
    "parquet": _clip(".parquet"),
    "config": _config,
    "baseline": _baseline,
    "mjcf": _mjcf,
    "bvh": _capture(".bvh"),
    "trc": _capture(".trc"),
    "c3d": _capture(".c3d"),
    "deepmimic": _capture(".json"),
    "amc": _amc,
    "mot": lambda content, folder: void(read_mot(_file(content, ".mot", folder))),
    "keyposes": lambda content, folder: void(load_keyposes(_file(content, ".toml", folder), toy())),
    "phases": lambda content, folder: void(read_phases(_file(content, ".toml", folder))),
    "curves": _shots(".curves.json"),
    "lottie": _shots(".json"),
    "motion3": _shots(".motion3.json"),
    "anim": _shots(".anim"),
    "gltf": _shots(".gltf"),
    "take": _take(".csv"),
    "take_json": _take(".json"),
    "take_lines": _take(".jsonl"),
    "take_text": _take(".txt"),
    "unity": _take(".anim"),
    "rig": lambda content, folder: void(Rig.load(_file(content, ".toml", folder))),
    "library": lambda content, folder: void(Library.load(_file(content, ".npz", folder))),
    "mapper": _mapper,
}


def void(_: object) -> None:
    """Nothing of a value."""


def try_input(target: str, content: bytes) -> PhysretargetError | None:
    """Give a target an input; returns the error it gave, raises whatever it should not have."""
    memory = Path("/dev/shm")
    place = str(memory) if memory.is_dir() and os.access(memory, os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=place) as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            TARGETS[target](content, folder)
        except PhysretargetError as error:
            return error
    return None
