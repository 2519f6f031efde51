"""BVH (Biovision hierarchy) files.

Any channel order and count per joint, position channels on every joint, End Sites anywhere,
names with blanks, colons and dots, CRLF, tabs and blank lines, decimal commas. Angles are
degrees, applied in the order of the channels: ``R = R_first @ R_second @ R_third``.

Position channels replace the joint's OFFSET, as the writers of 6-channel files mean it, unless
a file's numbers say that they are meant as an addition.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from physretarget.capture.bvh_hierarchy import Hierarchy, parse_hierarchy
from physretarget.capture.bvh_motion import parse_motion
from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, Names, sha256_of
from physretarget.capture.skeleton import Raw, chain_positions, finish, nice_rate, one_person
from physretarget.capture.text import decoded, plain_numbers
from physretarget.errors import InputError


def read(path: str | Path, options: ReadOptions) -> JointRecording:
    """Read a BVH file as the registry of readers does; see :func:`read_bvh`."""
    return read_bvh(
        path, unit=options.unit, up=options.up, subject=options.subject, names=options.names
    )


def read_bvh(
    path: str | Path,
    *,
    unit: str | None = None,
    up: str | None = None,
    subject: str | None = None,
    names: Names | None = None,
) -> JointRecording:
    """Read a BVH file; unit and up axis are guessed, and the guess noted, unless told.

    Args:
        path: The file.
        unit: The file's length unit, see :func:`physretarget.capture.read`.
        up: The file's up axis.
        subject: Whose skeleton to take where the file holds several.

    Raises:
        InputError: With path and line, for anything that is not a sound BVH file. A value written
            as ``nan`` stays NaN.
    """
    content = Path(path).read_bytes()
    digest = sha256_of(content)
    hierarchy, frame_time, values, remarks = _parse(content, path)
    del content
    position, rotation, notes = _assemble(hierarchy, values)
    raw = Raw(
        path=str(path),
        sha256=digest,
        format="bvh",
        fps=nice_rate(frame_time),
        names=tuple(joint.name for joint in hierarchy.joints),
        parents=tuple(joint.parent for joint in hierarchy.joints),
        position=position,
        rotation=rotation,
        end_sites=hierarchy.end_sites,
        notes=(*remarks, *notes),
    )
    return finish(one_person(raw, subject), unit=unit, up=up, names=names)


def _parse(content: bytes, path: str | Path) -> tuple[Hierarchy, float, Floats, tuple[str, ...]]:
    """Skeleton, frame time, the channels' values (T, channels), and what was odd."""
    text = decoded(content).rstrip("\x00\x1a")  # padding, and DOS' end of file
    if not text.strip():
        raise InputError("The file is empty.", path=path)
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    start = _motion_line(lines, path)
    hierarchy = parse_hierarchy(lines[:start], path)
    lines[start:], odd = plain_numbers(lines[start:])
    frame_time, values, remarks = parse_motion(lines, start, hierarchy.width, path)
    return hierarchy, frame_time, values, (*odd, *remarks)


def _motion_line(lines: list[str], path: str | Path) -> int:
    if next(line for line in lines if line.strip()).strip().upper() != "HIERARCHY":
        raise InputError("A BVH file starts with HIERARCHY; this one does not.", path=path, line=1)
    for number, line in enumerate(lines):
        if line.strip().upper() == "MOTION":
            return number
    raise InputError(
        "There is no MOTION section: the file is truncated or holds a skeleton alone.",
        path=path,
        line=len(lines),
    )


def _elementary(axis: int, degrees: Floats) -> Floats:
    """Rotations (T, 3, 3) about one coordinate axis."""
    angle = np.radians(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[:, axis, axis] = 1.0
    matrix[:, i, i] = matrix[:, j, j] = cos
    matrix[:, i, j] = -sin
    matrix[:, j, i] = sin
    return matrix


def _assemble(tree: Hierarchy, values: Floats) -> tuple[Floats, Floats, tuple[str, ...]]:
    """World positions and rotations from the channels."""
    added: list[str] = []
    parents = [joint.parent for joint in tree.joints]
    position, rotation = chain_positions(parents, _local(tree, values, added), len(values))
    carriers = {j.name for j in tree.joints if j.parent >= 0 and parents[j.parent] < 0}
    if added and carriers.issuperset(added):
        # What hangs on the root carries the body: where it goes shows in how the body stands.
        placed = chain_positions(parents, _local(tree, values, None), len(values))
        body = [j for j, parent in enumerate(parents) if parent >= 0]
        if _off_floor(placed[0][:, body]) < _off_floor(position[:, body]):
            return *placed, ()
    notes: tuple[str, ...] = ()
    if added:
        notes = (f"position channels of {len(added)} joints are added to their OFFSET",)
    return position, rotation, notes


def _off_floor(position: Floats) -> float:
    """How far from zero the lowest joints (T, J, 3) usually are, along the body's longest way."""
    axis = int(np.argmax(np.nanmedian(np.ptp(position, axis=1), axis=0)))
    along = position[..., axis]
    ends = np.nanmedian(np.nanmin(along, axis=1)), np.nanmedian(np.nanmax(along, axis=1))
    return float(min(abs(ends[0]), abs(ends[1])))


def _local(
    tree: Hierarchy, values: Floats, added: list[str] | None
) -> Iterator[tuple[Floats, Floats]]:
    """Each joint's place and rotation in its parent's frame.

    ``added`` collects the names of joints whose channels mean an addition; None: none does.
    """
    frames, column = len(values), 0
    for joint in tree.joints:
        offset = np.array(joint.offset)
        place = np.tile(offset, (frames, 1))
        rotation = np.tile(np.eye(3), (frames, 1, 1))
        moves, columns = [], []
        for kind, axis in joint.channels or ():
            if kind == "rotation":
                rotation = rotation @ _elementary(axis, values[:, column])
            else:
                moves.append(axis)
                columns.append(column)
            column += 1
        if moves:
            place[:, moves] = values[:, columns]
            adds = joint.parent >= 0 and _means_addition(offset[moves], place[:, moves])
            if adds and added is not None:
                place[:, moves] += offset[moves]
                added.append(joint.name)
        yield place, rotation


def _means_addition(offset: Floats, moved: Floats) -> bool:
    """Whether a joint's position channels stay near zero although its OFFSET is far from it."""
    good = moved[np.isfinite(moved).all(axis=1)]
    if not len(good):
        return False
    middle = np.median(good, axis=0)
    size = float(np.linalg.norm(offset))
    return float(np.linalg.norm(middle)) < 0.2 * size < 0.5 * float(np.linalg.norm(middle - offset))
