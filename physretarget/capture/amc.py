"""Acclaim motion (AMC) on an Acclaim skeleton (ASF).

Each bone has rest axes C ("axis", Euler angles in the given order) and turns about them:
``R_local = C M C^-1``, with M from the AMC's values in the order of "dof". Euler angles are
applied first letter first ("XYZ": Rz Ry Rx). A bone starts where its parent ends and reaches
``direction * length`` (in the world of the rest pose). Lengths are multiplied by 1/length of the
":units" section and are then inches.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.capture.reader import ReadOptions
from physretarget.capture.recording import Floats, JointRecording, Names, sha256_of
from physretarget.capture.skeleton import Raw, chain_positions, finish
from physretarget.capture.text import decoded
from physretarget.errors import InputError

_FPS = 120.0  # AMC files don't say; the CMU database's are 120 Hz
_DOFS = ("tx", "ty", "tz", "rx", "ry", "rz", "l")
_MAX = 1e7
_INCH = 0.0254


@dataclass
class _Bone:
    name: str
    direction: Floats = field(default_factory=lambda: np.zeros(3))
    length: float = 0.0
    axis: Floats = field(default_factory=lambda: np.eye(3))
    dofs: tuple[str, ...] = ()
    parent: int = -1


@dataclass
class _Skeleton:
    bones: list[_Bone]
    degrees: bool
    length_unit: float  # ":units length"
    root_position: Floats

    def index(self) -> dict[str, int]:
        return {bone.name: i for i, bone in enumerate(self.bones)}


def find_asf(path: Path) -> Path:
    """The skeleton beside a motion: the same name, the subject's ("11_01" -> "11"), or the only."""
    beside = sorted(p for p in path.parent.iterdir() if p.suffix.lower() == ".asf")
    for stem in (path.stem, re.split(r"[_\-. ]", path.stem)[0]):
        for candidate in beside:
            if candidate.stem.lower() == stem.lower():
                return candidate
    if len(beside) == 1:
        return beside[0]
    found = ", ".join(p.name for p in beside[:5]) if beside else "none"
    raise InputError(
        f"An AMC motion needs its ASF skeleton; beside it there is {found}: tell the skeleton.",
        path=path,
    )


def read(path: str | Path, options: ReadOptions) -> JointRecording:
    """Read a motion as the registry of readers does; see :func:`read_amc`."""
    return read_amc(
        path, skeleton=options.skeleton, unit=options.unit, up=options.up, names=options.names
    )


def read_amc(
    path: str | Path,
    *,
    skeleton: str | Path | None = None,
    unit: str | None = None,
    up: str | None = None,
    names: Names | None = None,
) -> JointRecording:
    """Read an AMC motion with its ASF skeleton (found beside it unless told).

    The unit follows from the ASF's ":units" unless told. InputError with file and line for
    anything unsound.
    """
    path = Path(path)
    content = path.read_bytes()
    asf = Path(skeleton) if skeleton is not None else find_asf(path)
    if not asf.is_file():
        raise InputError("The skeleton file does not exist.", path=asf)
    rig = _parse_asf(_lines(asf.read_bytes(), asf), asf)
    frames = _parse_amc(_lines(content, path), rig, path)
    position, rotation = _assemble(rig, frames)
    notes = [f"skeleton from {asf.name}", f"frame rate taken as {_FPS:g}: AMC files don't say"]
    stated = None
    if rig.length_unit != 1.0:  # which is what writers put who do not say
        stated = "cmu" if rig.length_unit == 0.45 else repr(_INCH / rig.length_unit)
    raw = Raw(
        path=str(path),
        sha256=sha256_of(content),
        format="amc",
        fps=_FPS,
        names=tuple(bone.name for bone in rig.bones),
        parents=tuple(bone.parent for bone in rig.bones),
        position=position,
        rotation=rotation,
        end_sites=_ends(rig),
        notes=tuple(notes),
        unit=stated,
    )
    return finish(raw, unit=unit, up=up, names=names)


def _lines(content: bytes, path: Path) -> list[tuple[int, list[str]]]:
    """Line numbers and words, comments and blank lines left out."""
    text = decoded(content)
    if not text.strip():
        raise InputError("The file is empty.", path=path)
    lines = []
    for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        words = line.split("#")[0].split()
        if words:
            lines.append((number, words))
    return lines


def _numbers(words: list[str], path: Path, line: int) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        raise InputError("A value is not a number.", path=path, line=line) from None
    if any(abs(number) > _MAX for number in numbers):
        raise InputError("A value is infinite or too large.", path=path, line=line)
    return numbers


def _vector(words: list[str], path: Path, line: int) -> Floats:
    numbers = _numbers(words, path, line)
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise InputError("Three finite numbers are needed here.", path=path, line=line)
    return np.array(numbers)


# ---------------------------------------------------------------------------------- skeleton


def _parse_asf(lines: list[tuple[int, list[str]]], path: Path) -> _Skeleton:
    sections = _sections(lines)
    degrees, length_unit = True, 1.0
    for line, words in sections.get("units", []):
        if words[0].lower() == "angle" and len(words) > 1:
            degrees = words[1].lower().startswith("deg")
        if words[0].lower() == "length" and len(words) > 1:
            length_unit = _numbers(words[1:2], path, line)[0]
            if not 1e-4 < length_unit < 1e4:
                raise InputError("The unit of length is no size.", path=path, line=line)
    root, position = _parse_root(sections.get("root", []), degrees, path)
    bones = [root, *_parse_bones(sections.get("bonedata", []), degrees, path)]
    return _arrange(bones, sections.get("hierarchy", []), degrees, length_unit, position, path)


def _sections(
    lines: list[tuple[int, list[str]]],
) -> dict[str, list[tuple[int, list[str]]]]:
    sections: dict[str, list[tuple[int, list[str]]]] = {}
    current: list[tuple[int, list[str]]] = []
    for line, words in lines:
        if words[0].startswith(":"):
            current = sections.setdefault(words[0][1:].lower(), [])
            words = words[1:]
        if words:
            current.append((line, words))
    return sections


def _euler(order: str, angles: Floats, degrees: bool, path: Path, line: int) -> Floats:
    """Acclaim's Euler angles: the first letter is applied first, about fixed axes."""
    order = order.lower()
    if sorted(order) != ["x", "y", "z"]:
        raise InputError(f"{order!r} is no order of the axes x, y, z.", path=path, line=line)
    matrix: Floats = Rotation.from_euler(order, angles, degrees=degrees).as_matrix()
    return matrix


def _parse_root(
    lines: list[tuple[int, list[str]]], degrees: bool, path: Path
) -> tuple[_Bone, Floats]:
    bone = _Bone("root", dofs=("tx", "ty", "tz", "rx", "ry", "rz"))
    position, orientation, order = np.zeros(3), np.zeros(3), "xyz"
    last = 1
    for line, words in lines:
        last = line
        key, rest = words[0].lower(), words[1:]
        if key == "order":
            bone.dofs = _dofs(rest, path, line)
        elif key == "axis" and rest:
            order = rest[0]
        elif key == "position":
            position = _vector(rest, path, line)
        elif key == "orientation":
            orientation = _vector(rest, path, line)
    bone.axis = _euler(order, orientation, degrees, path, last)
    return bone, position


def _dofs(words: list[str], path: Path, line: int) -> tuple[str, ...]:
    dofs = tuple(word.lower() for word in words)
    if not set(dofs) <= set(_DOFS) or len(set(dofs)) != len(dofs):
        raise InputError(f"Unknown degrees of freedom {' '.join(words)!r}.", path=path, line=line)
    return dofs


def _parse_bones(lines: list[tuple[int, list[str]]], degrees: bool, path: Path) -> Iterator[_Bone]:
    bone: _Bone | None = None
    for line, words in lines:
        key, rest = words[0].lower(), words[1:]
        if key == "begin":
            bone = _Bone("")
        elif bone is None:
            raise InputError("Bone data stands outside begin … end.", path=path, line=line)
        elif key == "end":
            if not bone.name:
                raise InputError("A bone has no name.", path=path, line=line)
            yield bone
            bone = None
        elif key == "name" and rest:
            bone.name = rest[0]
        elif key == "direction":
            bone.direction = _vector(rest, path, line)
        elif key == "length":
            bone.length = _numbers(rest[:1] or ["?"], path, line)[0]
            if not np.isfinite(bone.length):
                raise InputError("A bone's length is not finite.", path=path, line=line)
        elif key == "axis":
            angles = _vector(rest[:3], path, line)
            order = rest[3] if len(rest) > 3 else "xyz"
            bone.axis = _euler(order, angles, degrees, path, line)
        elif key == "dof":
            bone.dofs = _dofs(rest, path, line)
    if bone is not None:
        raise InputError("A bone's data has no end: the file is truncated.", path=path)


def _arrange(
    bones: list[_Bone],
    lines: list[tuple[int, list[str]]],
    degrees: bool,
    length_unit: float,
    position: Floats,
    path: Path,
) -> _Skeleton:
    """Parents from the hierarchy; bones in an order with parents first."""
    by_name = {bone.name: bone for bone in bones}
    if len(by_name) != len(bones) or len(bones) < 2:
        raise InputError("The skeleton has no bones, or two of one name.", path=path)
    parent: dict[str, str] = {}
    for line, words in lines:
        if words[0].lower() in ("begin", "end"):
            continue
        for name in words:
            if name not in by_name:
                raise InputError(
                    f"The hierarchy names an unknown bone {name!r}.", path=path, line=line
                )
        for child in words[1:]:
            if child in parent or child == "root":
                raise InputError(f"The bone {child!r} has two parents.", path=path, line=line)
            parent[child] = words[0]
    ordered = ["root"]
    for name in ordered:
        ordered += [child for child, above in parent.items() if above == name]
    lost = set(by_name) - set(ordered)
    if lost:
        raise InputError(f"The bone {min(lost)!r} hangs from nothing.", path=path)
    index = {name: i for i, name in enumerate(ordered)}
    arranged = [by_name[name] for name in ordered]
    for bone in arranged[1:]:
        bone.parent = index[parent[bone.name]]
    return _Skeleton(arranged, degrees, length_unit, position)


# ------------------------------------------------------------------------------------ motion


def _parse_amc(lines: list[tuple[int, list[str]]], rig: _Skeleton, path: Path) -> dict[int, Floats]:
    """Per bone with degrees of freedom its values (T, dofs); angles in radians."""
    index = rig.index()
    moving = [i for i, bone in enumerate(rig.bones) if bone.dofs]
    rows: dict[int, list[list[float]]] = {i: [] for i in moving}
    degrees = rig.degrees
    frames, start, line = 0, 1, 0
    for line, words in lines:
        if words[0].startswith(":"):
            degrees = {":DEGREES": True, ":RADIANS": False}.get(words[0].upper(), degrees)
        elif len(words) == 1 and words[0].isdecimal():
            _complete(rows, frames, rig, path, start)
            frames, start = frames + 1, line
        elif frames == 0:
            raise InputError("Values stand before the first frame's number.", path=path, line=line)
        else:
            _add_row(rows, index, rig, words, frames, path, line)
    _complete(rows, frames, rig, path, start)
    if frames == 0:
        raise InputError("There are no frames.", path=path, line=line)
    scale = np.pi / 180 if degrees else 1.0
    values = {}
    for i in moving:
        turns = np.array([dof.startswith("r") for dof in rig.bones[i].dofs])
        values[i] = np.array(rows[i]) * np.where(turns, scale, 1.0)
    return values


def _add_row(
    rows: dict[int, list[list[float]]],
    index: dict[str, int],
    rig: _Skeleton,
    words: list[str],
    frames: int,
    path: Path,
    line: int,
) -> None:
    bone = index.get(words[0])
    if bone is None:
        raise InputError(
            f"The bone {words[0][:40]!r} is not in the skeleton.", path=path, line=line
        )
    dofs = rig.bones[bone].dofs
    if len(words) - 1 != len(dofs):
        raise InputError(
            f"The bone {words[0]!r} needs {len(dofs)} values, this line has {len(words) - 1}.",
            path=path,
            line=line,
        )
    if dofs:
        rows[bone].append(_numbers(words[1:], path, line))
        if len(rows[bone]) != frames:
            raise InputError(
                f"The bone {words[0]!r} appears twice in a frame, or is missing in one.",
                path=path,
                line=line,
            )


def _complete(
    rows: dict[int, list[list[float]]], frames: int, rig: _Skeleton, path: Path, line: int
) -> None:
    """Every moving bone must have a row in the frame that ends here."""
    for i, values in rows.items():
        if len(values) != frames:
            raise InputError(
                f"The bone {rig.bones[i].name!r} is missing in this frame.", path=path, line=line
            )


def _assemble(rig: _Skeleton, values: dict[int, Floats]) -> tuple[Floats, Floats]:
    """World positions of the bones' starts, and rotations that are equal in the rest pose."""
    frames = len(next(iter(values.values())))

    def local() -> Iterator[tuple[Floats, Floats]]:
        for i, bone in enumerate(rig.bones):
            place = np.tile(_start(rig, i), (frames, 1))
            turn = np.tile(np.eye(3), (frames, 1, 1))
            for column, dof in enumerate(bone.dofs):
                if dof.startswith("t"):
                    place[:, "xyz".index(dof[1])] += values[i][:, column]
                elif dof.startswith("r"):
                    turn = _about("xyz".index(dof[1]), values[i][:, column]) @ turn
            yield place, bone.axis @ turn @ bone.axis.T

    return chain_positions([bone.parent for bone in rig.bones], local(), frames)


def _start(rig: _Skeleton, i: int) -> Floats:
    """Where a bone starts, from its parent's start, in the rest pose."""
    parent = rig.bones[i].parent
    if parent < 0:
        return rig.root_position
    return rig.bones[parent].direction * rig.bones[parent].length


def _about(axis: int, angle: Floats) -> Floats:
    vector = np.zeros((len(angle), 3))
    vector[:, axis] = np.where(np.isfinite(angle), angle, 0.0)
    turn: Floats = Rotation.from_rotvec(vector).as_matrix()
    turn[~np.isfinite(angle)] = np.nan
    return turn


def _ends(rig: _Skeleton) -> dict[str, tuple[int, Floats]]:
    parents = {bone.parent for bone in rig.bones}
    return {
        f"{bone.name}_end": (i, bone.direction * bone.length)
        for i, bone in enumerate(rig.bones)
        if i not in parents and bone.length > 0
    }
