"""What an importer hands over, and how it becomes a clip of a given character."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from physretarget.archives.arrays import Frames
from physretarget.clip.core import Bools, Floats, LongClip
from physretarget.clip.quaternion import Lengths, QuatOrder, decide_order, doubt_order
from physretarget.clip.scratch import Rows
from physretarget.errors import InputError, UsageError
from physretarget.kinematics import Tree
from physretarget.options.motion import JointOrder

# A thousand kilometres, or 160 000 turns of a joint: damage, not motion.
_ABSURD = 1e6
# Rounding of float32 in a quaternion's norm.
_UNIT = 1e-3
_WIDTH = {"free": 7, "ball": 4, "hinge": 1, "slide": 1}


class Layout(Protocol):
    """What reading needs to know of a character."""

    @property
    def name(self) -> str:
        """The model's name."""

    @property
    def sha256(self) -> str:
        """The model's hash."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Joint names in the model's order, the free joint's included."""

    @property
    def tree(self) -> Tree:
        """Addresses and kinds of the joints."""


@dataclass(frozen=True, kw_only=True)
class Told:
    """What the user said about a file, None where nothing was said.

    ``scale``: metres per unit of the file's lengths.
    """

    fps: float | None = None
    quat: QuatOrder | None = None
    joint_order: JointOrder | None = None
    scale: float | None = None

    def __post_init__(self) -> None:
        if self.fps is not None and not (np.isfinite(self.fps) and 0 < self.fps <= 1e5):
            raise UsageError(f"a frame rate of {self.fps} was given, one above 0 is needed.")
        if self.quat not in (None, "wxyz", "xyzw"):
            raise UsageError(f"quaternion order '{self.quat}' was given: use wxyz or xyzw.")
        if self.joint_order not in (None, "model", "breadth-first"):
            raise UsageError(
                f"joint order '{self.joint_order}' was given: use model or breadth-first."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Raw:
    """A file's numbers before they are understood.

    ``rows`` (T, n): root position and quaternion (when ``rooted``) and then the joints, or a
    whole qpos. ``joints`` names what follows the root, or all joints, or is None when the
    file names nothing. ``order`` is the root quaternion's order where the format fixes it.
    ``scale`` m to the unit of lengths and ``degrees``, joints in degrees, where the format says so.
    """

    format: str
    path: str
    sha256: str
    rows: Rows
    rooted: bool = True
    joints: tuple[str, ...] | None = None
    order: QuatOrder | None = None
    time: Floats | None = None
    fps: float | None = None
    contact_points: tuple[str, ...] = ()
    contact_active: Bools | None = None
    model_name: str = ""
    model_sha256: str = ""
    meta: dict[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    scale: float | None = None
    degrees: bool = False


def finish(raw: Raw, character: Layout | None, told: Told) -> LongClip:
    """Order, check and repair: the one way from any importer to a clip."""
    notes = list(raw.notes)
    _reject_nonfinite(raw)
    raw = _cut_to_model(raw, character, notes)
    time = _time(raw, told, notes)
    columns = _model_order(raw, character, notes)
    quats = _quaternions(raw, character)
    wanted = _quaternion_order(raw, columns, quats, told, notes)
    if wanted == "xyzw":
        for quat in quats:
            columns[quat] = columns[np.roll(quat, 1)]
    units = _Units(
        lengths=_lengths(raw, character),
        angles=_angles(raw, character, len(columns)) if raw.degrees else np.zeros(0, np.int64),
        scale=told.scale if told.scale is not None else raw.scale,
        told=told.scale is not None,
    )
    rows = _arranged(raw, columns, quats, units, notes)
    names = raw.joints or ()
    if character is not None:
        names = tuple(character.joint_names)
        _compare_model(raw, character, notes)
    return LongClip(
        rows=rows,
        time=time,
        joint_names=names,
        model_name=raw.model_name or (character.name if character else ""),
        model_sha256=raw.model_sha256,
        contact_points=raw.contact_points,
        contact_active=raw.contact_active,
        meta=dict(raw.meta),
        notes=tuple(notes),
        path=raw.path,
        sha256=raw.sha256,
        format=raw.format,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Units:
    """Which columns are ``lengths``, ``scale`` m to the unit, and which ``angles`` in degrees."""

    lengths: NDArray[np.int64]
    angles: NDArray[np.int64]
    scale: float | None
    told: bool


def _cut_to_model(raw: Raw, character: Layout | None, notes: list[str]) -> Raw:
    """The file's columns that the model has: no root where its base is fixed, no object besides.

    A robot's clip with an object carries the object's free joint behind the robot's coordinates.
    """
    if character is None:
        return raw
    nq, width = character.tree.nq, raw.rows.width
    fixed = not any(joint.kind == "free" for joint in character.tree.joints)
    named = len(raw.joints) if raw.joints is not None else width - 7
    if fixed and raw.rooted and width - 7 == nq == named:
        root = raw.rows.columns(np.arange(3))
        moved = float(np.ptp(root, axis=0).max())
        notes.append(
            f"Model '{character.name}' has a fixed base: the root in the file, which moves by "
            f"{moved:.3g} m, is left out."
        )
        return replace(raw, rows=_kept(raw.rows, slice(7, None), nq), rooted=False, order=None)
    if raw.joints is None and raw.rooted and width == nq + 7 and nq > 7:
        norm = np.linalg.norm(raw.rows.columns(np.arange(nq + 3, nq + 7)), axis=1)
        if np.abs(norm - 1).max() < _UNIT:
            notes.append(
                f"The last 7 of {width} columns are a pose (of an object) that model "
                f"'{character.name}' does not have, and are left out."
            )
            return replace(raw, rows=_kept(raw.rows, slice(0, nq), nq))
    return raw


def _kept(rows: Rows, columns: slice, width: int) -> Rows:
    return Rows((part[:, columns] for _, part in rows.parts()), width)


def _angles(raw: Raw, character: Layout | None, width: int) -> NDArray[np.int64]:
    """The clip's coordinates that are hinges' angles."""
    if character is None:
        return np.arange(7 if raw.rooted else 0, width)
    found = [joint.qpos for joint in character.tree.joints if joint.kind == "hinge"]
    return np.array(found, dtype=np.int64)


def _arranged(
    raw: Raw,
    columns: NDArray[np.int64],
    quats: NDArray[np.int64],
    units: _Units,
    notes: list[str],
) -> Rows:
    """The file's columns in the order of the clip, in m and rad, quaternions of unit length."""
    metric, scale = units.lengths, units.scale
    as_it_is = scale is None and len(units.angles) == 0 and len(quats) == 0
    if as_it_is and (columns == np.arange(raw.rows.width)).all():
        return raw.rows
    lengths = Lengths(path=raw.path)
    if scale is not None:
        how = "as told" if units.told else f"as {raw.format} has them"
        notes.append(f"Positions are read {how}, {scale:g} m to the unit.")
    if len(units.angles):
        notes.append(f"Joint angles are read as {raw.format} has them, in degrees.")

    def parts() -> Iterator[Floats]:
        for first, part in raw.rows.parts():
            qpos = part[:, columns]
            lengths.repair(qpos, quats, first)
            if scale is not None:
                qpos[:, metric] *= scale
            qpos[:, units.angles] *= np.pi / 180
            yield qpos

    rows = Rows(parts(), len(columns))
    notes += lengths.notes()
    return rows


def _reject_nonfinite(raw: Raw) -> None:
    if 0 in raw.rows.shape:
        raise InputError(f"holds no frames: its data have shape {raw.rows.shape}.", path=raw.path)
    for first, part in raw.rows.parts():
        bad = ~(np.abs(part) <= _ABSURD)
        if bad.any():
            frame, column = (int(i) for i in np.argwhere(bad)[0])
            raise InputError(
                f"column {column} is {part[frame, column]:.6g}, every value must be a finite "
                f"number (at most {_ABSURD:g}).",
                path=raw.path,
                frame=first + frame,
            )


def _time(raw: Raw, told: Told, notes: list[str]) -> Floats:
    frames = len(raw.rows)
    if raw.time is not None:
        if told.fps is not None:
            notes.append(
                f"The file carries its own time; the given {told.fps:g} frames/s is not used."
            )
        return raw.time
    fps = told.fps if told.fps is not None else raw.fps
    if fps is None:
        raise InputError(
            f"a {raw.format} clip states no frame rate: give --fps (frames per second).",
            path=raw.path,
        )
    if not (np.isfinite(fps) and 0 < fps <= 1e5):
        raise InputError(
            f"the file claims {fps} frames per second, one above 0 is needed.", path=raw.path
        )
    if raw.fps is not None and told.fps is not None and told.fps != raw.fps:
        notes.append(f"Frame rate {told.fps:g} as told; the file says {raw.fps:g}.")
    return np.arange(frames, dtype=np.float64) / fps


def _model_order(raw: Raw, character: Layout | None, notes: list[str]) -> NDArray[np.int64]:
    """For each coordinate of the clip, the file's column that holds it."""
    as_they_are = np.arange(raw.rows.width)
    if character is None:
        return as_they_are
    if raw.rows.width != character.tree.nq:
        raise InputError(
            f"the clip has {raw.rows.width} coordinates per frame, "
            f"model '{character.name}' has nq = {character.tree.nq}.",
            path=raw.path,
        )
    if raw.joints is None:
        notes.append(
            f"The file names no joints: its {character.tree.nq} columns are taken in the order "
            f"of model '{character.name}'."
        )
        return as_they_are
    columns = _columns(raw, character)
    if (np.diff(columns) != 1).any():
        notes.append("Joints were put into the model's order by their names.")
    return columns


def _columns(raw: Raw, character: Layout) -> NDArray[np.int64]:
    """For each qpos coordinate of the model, the file's column that holds it."""
    tree = character.tree
    ours = list(character.joint_names)
    theirs = list(raw.joints or ())
    kinds = [joint.kind for joint in tree.joints]
    if kinds and kinds[0] == "free" and theirs != ours:
        if len(theirs) == len(ours) - 1:
            theirs.insert(0, ours[0])
        elif len(theirs) == len(ours) and theirs[0] not in ours:
            theirs[0] = ours[0]  # the free joint goes by many names: root, floating_base_joint
    _compare_names(ours, theirs, raw.path, character.name)
    width = {name: _WIDTH[kind] for name, kind in zip(ours, kinds, strict=True)}
    starts = dict(
        zip(theirs, np.cumsum([0, *(width[n] for n in theirs[:-1])]).tolist(), strict=True)
    )
    return np.concatenate([starts[n] + np.arange(width[n]) for n in ours]).astype(np.int64)


def _compare_names(ours: list[str], theirs: list[str], path: str, model: str) -> None:
    if len(set(theirs)) != len(theirs):
        twice = sorted({n for n in theirs if theirs.count(n) > 1})
        raise InputError(f"the clip names joint '{twice[0]}' twice.", path=path)
    missing = [n for n in ours if n not in theirs]
    unknown = [n for n in theirs if n not in ours]
    if not missing and not unknown:
        return
    parts = []
    if unknown:
        close = _near(unknown[0], missing)
        parts.append(
            f"the clip's {_few(unknown)} not in model '{model}'"
            + (f" (did it mean '{close}'?)" if close else "")
        )
    if missing:
        parts.append(f"the model's {_few(missing)} not in the clip")
    raise InputError("joints differ: " + "; ".join(parts) + ".", path=path)


def _near(name: str, names: list[str]) -> str | None:
    """The one of ``names`` that ``name`` may be a misspelling of, case aside.

    Names of joints share much: 0.6, the library's own cutoff, would call left_hip near to
    right_hip. "_joint" makes any two names nearer, and is often left out: names are compared
    without it, and whole only where they are all but the same.
    """
    for shown, cutoff in ((lambda text: text.removesuffix("_joint"), 0.8), (str, 0.9)):
        candidates = {shown(other.lower()): other for other in names}
        close = get_close_matches(shown(name.lower()), candidates, n=1, cutoff=cutoff)
        if close:
            return candidates[close[0]]
    return None


def _few(names: list[str]) -> str:
    shown = ", ".join(f"'{n}'" for n in names[:5])
    rest = f" and {len(names) - 5} more" if len(names) > 5 else ""
    return f"joint{'s' if len(names) > 1 else ''} {shown}{rest} {'are' if len(names) > 1 else 'is'}"


def _quaternions(raw: Raw, character: Layout | None) -> NDArray[np.int64]:
    if character is not None:
        return character.tree.quats[0]
    if raw.rooted and raw.rows.width >= 7:
        return np.arange(3, 7, dtype=np.int64)[None]
    return np.zeros((0, 4), dtype=np.int64)


def _lengths(raw: Raw, character: Layout | None) -> NDArray[np.int64]:
    """The clip's coordinates that are lengths: positions of free joints, and slides."""
    if character is None:
        return np.arange(3 if raw.rooted and raw.rows.width >= 7 else 0)
    found: list[int] = []
    for joint in character.tree.joints:
        if joint.kind in ("free", "slide"):
            found += range(joint.qpos, joint.qpos + (3 if joint.kind == "free" else 1))
    return np.array(found, dtype=np.int64)


def _quaternion_order(
    raw: Raw,
    columns: NDArray[np.int64],
    quats: NDArray[np.int64],
    told: Told,
    notes: list[str],
) -> QuatOrder:
    """The file's order of quaternions: what was told, the format's, or inferred."""
    order = told.quat or raw.order
    if len(quats) == 0:
        return order or "wxyz"
    if told.quat and raw.order and told.quat != raw.order:
        notes.append(f"Quaternions read as {told.quat} as told; {raw.format} uses {raw.order}.")
    if order is None:
        order, reason = decide_order(raw.rows.columns(columns[quats[0]]), path=raw.path)
        notes.append(reason)
    elif told.quat is None and not raw.model_sha256:  # ours are as they say
        doubt = doubt_order(raw.rows.columns(columns[quats[0]]), order, format=raw.format)
        notes += () if doubt is None else (doubt,)
    return order


def _compare_model(raw: Raw, character: Layout, notes: list[str]) -> None:
    if raw.model_sha256 and raw.model_sha256 != character.sha256:
        notes.append(
            f"The clip was made with another version of its model: {raw.model_sha256[:12]}, "
            f"judged with {character.sha256[:12]}."
        )


def rows_of(*arrays: Frames, frames: int | None = None) -> Rows:
    """Arrays (T, n) of equal length side by side, as rows; of the first ``frames`` if told."""
    count = arrays[0].shape[0] if frames is None else min(frames, arrays[0].shape[0])

    def parts() -> Iterator[Floats]:
        done = 0
        for together in zip(*(a.parts() for a in arrays), strict=True):
            if done >= count:
                return
            yield np.concatenate(together, axis=1)[: count - done]
            done += len(together[0])

    width = sum(a.shape[1] for a in arrays)
    # Frames of nothing take no bytes: a header may claim any number of them.
    return Rows(parts() if width else (), width)


def order_of(text: str | None) -> QuatOrder | None:
    """A told quaternion order, checked."""
    if text is None or text in ("wxyz", "xyzw"):
        return cast("QuatOrder | None", text)
    raise UsageError(f"quaternion order '{text}' was given: use wxyz or xyzw.")
