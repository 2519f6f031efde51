"""Xsens' MVNX: 23 segments of a body, their origins and orientations in a world with z up.

Joints are where segments begin; who hangs on whom is told by the file's list of joints.
"""

from __future__ import annotations

from pathlib import Path
from typing import IO
from xml.etree import ElementTree

import numpy as np

from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, sha256_of
from physretarget.capture.skeleton import Raw, finish
from physretarget.errors import InputError, UnsafeInputError
from physretarget.kinematics import quat_to_matrix

_LARGEST = 2 << 30  # bytes; an hour at 60 Hz takes 1.2 GiB
_MOST_SEGMENTS = 200


def read(path: str | Path, options: ReadOptions) -> JointRecording:
    """Read an MVNX file: the frames of type "normal".

    Raises:
        InputError: It is no MVNX, or damaged; with the frame.
        UnsafeInputError: It is absurdly large.
    """
    place = Path(path)
    if place.stat().st_size > _LARGEST:
        raise UnsafeInputError(f"the file is larger than {_LARGEST >> 30} GiB", path=path)
    with place.open("rb") as file:
        fps, names, joints, turns, places = _parse(file, path)
    if not turns:
        raise InputError("the file holds no frame of type 'normal'.", path=path)
    parents = _parents(names, joints, path)
    order = _parents_first(parents)
    rank = {old: new for new, old in enumerate(order)}
    position = np.array(places).reshape(len(places), len(names), 3)[:, order]
    quats = np.array(turns).reshape(len(turns), len(names), 4)[:, order]
    raw = Raw(
        path=str(path),
        sha256=sha256_of(place.read_bytes()),
        format="mvnx",
        fps=fps,
        names=tuple(names[j] for j in order),
        parents=tuple(rank[parents[j]] if parents[j] >= 0 else -1 for j in order),
        position=position,
        rotation=quat_to_matrix(quats),
    )
    return finish(raw, unit=options.unit or "m", up=options.up or "z", names=options.names)


Joints = list[tuple[str, str]]
Parsed = tuple[float, list[str], Joints, list[Floats], list[Floats]]


def _parse(file: IO[bytes], path: str | Path) -> Parsed:
    """Rate, names of segments, pairs of joined ones, and each frame's turns and places."""
    fps, names, joints = 0.0, list[str](), list[tuple[str, str]]()
    turns, places = list[Floats](), list[Floats]()
    ends: dict[str, str] = {}
    try:
        for event, element in ElementTree.iterparse(file, events=("start", "end")):
            tag = element.tag.rpartition("}")[2]
            if event == "start":
                if tag == "subject":
                    fps = float(element.get("frameRate", "nan"))
                elif tag == "segment" and len(names) < _MOST_SEGMENTS:
                    names.append(element.get("label", f"segment{len(names)}"))
                continue
            if tag in ("connector1", "connector2"):
                ends[tag] = (element.text or "").partition("/")[0].strip()
            elif tag == "joint" and len(ends) == 2:
                joints.append((ends["connector1"], ends["connector2"]))
                ends = {}
            elif tag == "frame":
                if element.get("type", "normal") == "normal":
                    turns.append(_numbers(element, "orientation", 4 * len(names), len(turns), path))
                    places.append(_numbers(element, "position", 3 * len(names), len(places), path))
                element.clear()
    except ElementTree.ParseError as error:
        line = error.position[0] if error.position else None
        raise InputError("the XML is damaged or cut short.", path=path, line=line) from error
    except ValueError as error:
        raise InputError("the frame rate is no number.", path=path) from error
    if not names:
        raise InputError("the file names no segment: it is no MVNX.", path=path)
    if not 1 <= fps <= 10_000:
        raise InputError(f"the file's frame rate is {fps:g}.", path=path)
    return fps, names, joints, turns, places


def _numbers(
    frame: ElementTree.Element, name: str, count: int, number: int, path: str | Path
) -> Floats:
    found = next((e for e in frame if e.tag.rpartition("}")[2] == name), None)
    try:
        values = np.array((found.text or "").split() if found is not None else [], dtype=np.float64)
    except ValueError as error:
        raise InputError(f"'{name}' is not numbers.", path=path, frame=number) from error
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(
            f"'{name}' has {len(values)} numbers, {count} finite ones are needed.",
            path=path,
            frame=number,
        )
    return values


def _parents(names: list[str], joints: Joints, path: str | Path) -> list[int]:
    place = {name: i for i, name in enumerate(names)}
    parents = [-1] * len(names)
    for above, below in joints:
        if above in place and below in place:
            parents[place[below]] = place[above]
    for start in range(len(names)):
        at = start
        for _ in range(len(names)):
            at = parents[at]
            if at < 0:
                break
        else:
            raise InputError(f"segment {names[start]!r} hangs on itself.", path=path)
    return parents


def _parents_first(parents: list[int]) -> list[int]:
    """Indices so that each comes after its parent."""

    def depth(joint: int) -> int:
        return 0 if parents[joint] < 0 else 1 + depth(parents[joint])

    return sorted(range(len(parents)), key=depth)
