"""From a file's numbers to a world in metres with z up: unit and up axis, told or found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.names import Body, ancestors, recognise
from physretarget.capture.recording import Floats, JointRecording, Names, Source
from physretarget.errors import InputError, UsageError
from physretarget.options.motion import CAPTURE_UNITS as UNITS

# Thigh + shank of a 1.75 m adult: 0.245 + 0.246 of height (Winter 2009, table 4.1).
_LEG = 0.491 * 1.75
_LEG_RANGE = (1 / 2.2, 1.45)  # legs from a toddler's to a giant's; others fit no known unit
_STATED_RANGE = 4.0  # and the unit that a file states is wrong

_TO_WORLD: Mapping[str, NDArray[np.float64]] = {
    # columns: where the file's x, y, z go; y up facing z becomes z up facing x
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "y": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "z": np.eye(3),
    "-x": np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]]),
    "-y": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    "-z": np.diag([1.0, -1.0, -1.0]),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Raw:
    """A skeleton in its file's unit and axes; see JointRecording for the arrays.

    ``unit`` is what the file says of itself, None where it is silent.
    """

    path: str
    sha256: str
    format: str
    fps: float
    names: tuple[str, ...]
    parents: tuple[int, ...]
    position: Floats
    rotation: Floats
    end_sites: Mapping[str, tuple[int, Floats]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unit: str | None = None


def to_world(up: str) -> Floats:
    """The rotation that takes the file's axes to the world's (z up)."""
    if up not in _TO_WORLD:
        raise UsageError(f"The up axis is {up!r}; it must be one of x, y, z, -x, -y, -z.")
    return _TO_WORLD[up].copy()


def unit_scale(unit: str) -> float:
    """Metres per unit of a named unit, or of a number written out ("0.0254")."""
    if unit in UNITS:
        return UNITS[unit]
    try:
        scale = float(unit)
    except ValueError:
        scale = -1.0
    if not 1e-6 <= scale <= 1e3:
        known = ", ".join(UNITS)
        raise UsageError(f"The unit is {unit!r}; it must be one of {known}, or metres per unit.")
    return scale


def _sample(raw: Raw, joint: int) -> Floats:
    step = max(1, len(raw.position) // 200)
    return raw.position[::step, joint]


def _leg_length(raw: Raw, body: Body) -> float | None:
    """Median length of thigh + shank in the file's unit; None if no leg is recognised."""
    lengths = []
    for side in ("left", "right"):
        if body.missing([f"{side}_{part}" for part in ("thigh", "shank", "foot")]):
            continue
        hip, knee, ankle = (
            _sample(raw, body.roles[f"{side}_{part}"]) for part in ("thigh", "shank", "foot")
        )
        length = np.linalg.norm(hip - knee, axis=1) + np.linalg.norm(knee - ankle, axis=1)
        length = length[np.isfinite(length)]
        if len(length):
            lengths.append(float(np.median(length)))
    return float(np.mean(lengths)) if lengths and min(lengths) > 0 else None


def guess_unit(raw: Raw, body: Body) -> tuple[str, float, str]:
    """Name, metres per unit and a sentence.

    The unit that the file states unless it makes a leg of nobody's; else the known one with the
    most human leg.
    """
    leg = _leg_length(raw, body)
    if raw.unit is not None:
        scale = unit_scale(raw.unit)
        if leg is None or 1 / _STATED_RANGE <= leg * scale / _LEG <= _STATED_RANGE:
            return raw.unit, scale, f"unit as the file says: {raw.unit}"
    if leg is None:
        return "cm", 0.01, "unit taken as cm: no leg to measure was recognised"
    unit, scale = min(UNITS.items(), key=lambda item: _oddness(leg * item[1]))
    if _LEG_RANGE[0] <= leg * scale / _LEG <= _LEG_RANGE[1]:
        return unit, scale, f"unit guessed as {unit}: thigh and shank measure {leg * scale:.2f} m"
    scale = _LEG / leg
    return (
        f"{scale:.6g}",
        scale,
        f"no known unit fits a leg of {leg:.4g} file units: scaled by {scale:.4g} to the leg "
        "of a 1.75 m adult; tell the unit to do better",
    )


def _oddness(leg: float) -> float:
    """How unlike a human's a leg (m) is: children are common, giants are not."""
    ratio = float(np.log(leg / _LEG))
    return -ratio if ratio < 0 else 2.5 * ratio


def guess_up(raw: Raw, body: Body) -> tuple[str, str]:
    """Up axis and a sentence: the axis along which the head is above the feet.

    In most frames; else in more than along any other axis, since acrobats stand before and
    after; else in the rest pose, which alone may say that the file is upside down.
    """
    custom = "y", "up axis taken as y, the format's custom: the clip's poses do not tell"
    top = next((body.roles[r] for r in ("head", "neck", "chest") if r in body.roles), None)
    feet = [body.roles[r] for r in ("left_foot", "right_foot") if r in body.roles]
    if top is None or not feet:
        return custom
    way = _sample(raw, top) - np.mean([_sample(raw, j) for j in feet], axis=0)
    length = np.linalg.norm(way, axis=1)
    good = np.isfinite(length) & (length > 0)
    if not good.any():
        return custom
    way = way[good] / length[good, None]
    seen, rest = upright_axis(way), _rest_up(raw, top, feet)
    if seen and rest and rest != seen and lies_down(raw.position, rest, seen, np.median(length)):
        seen = None
    if seen:
        return seen, f"up axis found as {seen}: the head is above the feet along it"
    downward = rest and rest[0] == "-" and np.mean(way[:, "xyz".index(rest[1])]) < -0.6
    if rest and (rest[0] != "-" or downward):
        return rest, f"up axis found as {rest}: the head is above the feet along it at rest"
    return custom


def lies_down(position: Floats, stated: str, seen: str, size: float) -> bool:
    """Whether ``position`` (T, K, 3) rather lies on the stated axis' floor than stands on the seen.

    Its lowest points then keep to the height zero of the one and not of the other.
    """
    some = position[:: max(1, len(position) // 200)]
    some = some[np.asarray(np.isfinite(some).any(axis=1)).all(axis=1)]
    if stated[0] == "-" or not len(some):
        return False
    low = np.abs(np.median(np.nanmin(some, axis=1), axis=0))
    return bool(low["xyz".index(stated)] < 0.15 * size and low["xyz".index(seen)] > 0.3 * size)


def upright_axis(way: Floats) -> str | None:
    """The file's axis along which unit vectors (T, 3) from feet to head point, if one stands out.

    By their mean, or by the frames in which they are within 30 degrees of it.
    """
    mean = np.mean(way, axis=0)
    best, second = np.argsort(-mean)[:2]
    if mean[best] > 0.6 and mean[best] - mean[second] > 0.2:
        return "xyz"[best]
    share = np.mean(np.abs(way) > np.cos(np.radians(30.0)), axis=0)
    upward = np.mean(way > np.cos(np.radians(30.0)), axis=0)
    best, second = np.argsort(-share)[:2]
    if upward[best] > 0.15 and upward[best] > 1.5 * max(share[second], share[best] - upward[best]):
        return "xyz"[best]
    return None


def _rest_up(raw: Raw, top: int, feet: Sequence[int]) -> str | None:
    """The axis, "-" before it if downward, from feet to head with no joint turned, if clear."""
    place = np.zeros((len(raw.names), 3))
    for j, parent in enumerate(raw.parents):
        if parent >= 0:
            way = _sample(raw, j) - _sample(raw, parent)
            step = max(1, len(raw.position) // 200)
            local = np.einsum("tji,tj->ti", raw.rotation[::step, parent], way)
            finite = local[np.isfinite(local).all(axis=1)]
            place[j] = place[parent] + (np.median(finite, axis=0) if len(finite) else 0.0)
    way = place[top] - place[list(feet)].mean(axis=0)
    length = float(np.linalg.norm(way))
    axis = int(np.argmax(np.abs(way)))
    apart = float(np.linalg.norm(place[feet[0]] - place[feet[-1]]))
    # Skeletons whose bones all rest along one axis stretch both feet to one place.
    if length == 0 or abs(way[axis]) < 0.9 * length or (len(feet) > 1 and apart < 0.03 * length):
        return None
    return ("-" if way[axis] < 0 else "") + "xyz"[axis]


def finish(
    raw: Raw, *, unit: str | None, up: str | None, names: Names | None = None
) -> JointRecording:
    """Scale and turn a raw skeleton into the world; what was guessed is noted.

    ``names`` says what joints are whose names say nothing.

    The raw arrays are used up: they become the recording's, since two copies of a long
    capture's rotations would be the largest thing in memory.
    """
    if names is not None:
        raw = replace(raw, names=names.of_joints(raw.names, raw.parents))
    body = recognise(raw.names, raw.parents)
    notes = list(raw.notes)
    if unit is None:
        unit, scale, sentence = guess_unit(raw, body)
        notes.append(sentence)
    else:
        scale = unit_scale(unit)
    if up is None:
        up, sentence = guess_up(raw, body)
        notes.append(sentence)
    turn = to_world(up)
    position, rotation = raw.position, raw.rotation
    for j in range(len(raw.names)):
        position[:, j] = position[:, j] @ (turn.T * scale)
        rotation[:, j] = turn @ rotation[:, j]
    reach = np.nanmax(np.abs(position), initial=0.0)
    if reach > 1e5:
        raise InputError(
            f"Positions reach {reach:.3g} m with the unit {unit}, which is no capture volume.",
            path=raw.path,
        )
    return JointRecording(
        source=Source(
            path=raw.path,
            sha256=raw.sha256,
            format=raw.format,
            unit=unit,
            up=up,
            fps=raw.fps,
            frames=len(position),
        ),
        names=raw.names,
        parents=raw.parents,
        time=np.arange(len(position)) / raw.fps,
        position=position,
        rotation=rotation,
        end_sites={name: (j, offset * scale) for name, (j, offset) in raw.end_sites.items()},
        notes=tuple(notes),
    )


def one_person(raw: Raw, subject: str | None) -> Raw:
    """The skeleton of one of the people that a file holds, each below a root of its own.

    Args:
        raw: The file's skeletons.
        subject: A person's name: what stands before the colon in joint names, or the root's name,
            or a number from 1. None takes the first, and notes the others.

    Raises:
        InputError: Nobody of that name is in the file.
    """
    roots = [j for j, parent in enumerate(raw.parents) if parent < 0]
    owner = [ancestors(raw.parents, j)[-1] for j in range(len(raw.names))]
    people = {root: [j for j, own in enumerate(owner) if own == root] for root in roots}
    people = {root: own for root, own in people.items() if _has_legs(raw, own)}
    names = {root: raw.names[root].rpartition(":")[0] or raw.names[root] for root in people}
    if subject is None and len(people) < 2:
        return raw
    if subject is None:
        chosen = next(iter(people))
        others = ", ".join(name for root, name in names.items() if root != chosen)
        note = f"{len(people)} people are in the file: {names[chosen]} was taken, {others} left out"
    else:
        found = [
            root
            for number, root in enumerate(people, start=1)
            if subject in (names[root], raw.names[root], str(number))
        ]
        if not found:
            listed = ", ".join(repr(name) for name in names.values()) or "nobody with legs"
            raise InputError(
                f"there is no subject {subject!r}; in the file: {listed}", path=raw.path
            )
        chosen, note = found[0], f"subject: {names[found[0]]}"
    keep = people[chosen]
    place = {old: new for new, old in enumerate(keep)}
    return replace(
        raw,
        names=tuple(raw.names[j] for j in keep),
        parents=tuple(place.get(raw.parents[j], -1) for j in keep),
        position=raw.position[:, keep],
        rotation=raw.rotation[:, keep],
        end_sites={
            name: (place[j], offset) for name, (j, offset) in raw.end_sites.items() if j in place
        },
        notes=(*raw.notes, note),
    )


def _has_legs(raw: Raw, joints: Sequence[int]) -> bool:
    place = {old: new for new, old in enumerate(joints)}
    body = recognise(
        [raw.names[j] for j in joints], [place.get(raw.parents[j], -1) for j in joints]
    )
    return not body.missing(["left_thigh", "left_shank", "right_thigh", "right_shank"])


def nice_rate(frame_time: float) -> float:
    """Frames per second of a printed frame time: 0.0333333 s means 30, not 30.00003."""
    fps = 1.0 / frame_time
    for nice in (round(fps), round(fps * 1001 / 1000) * 1000 / 1001):
        if nice > 0 and abs(fps - nice) < 3e-4 * nice:
            return float(nice)
    return fps


def chain_positions(
    parents: Sequence[int], joints: Iterable[tuple[Floats, Floats]], frames: int
) -> tuple[Floats, Floats]:
    """World positions (T, J, 3) and rotations (T, J, 3, 3), parents first.

    ``joints`` yields each joint's place (T, 3) and rotation (T, 3, 3) in its parent's frame; one
    at a time, since a long capture's do not all fit beside the result.
    """
    position = np.empty((frames, len(parents), 3))
    rotation = np.empty((frames, len(parents), 3, 3))
    for j, (parent, (place, turn)) in enumerate(zip(parents, joints, strict=True)):
        if parent < 0:
            position[:, j], rotation[:, j] = place, turn
        else:
            above = rotation[:, parent]
            position[:, j] = position[:, parent] + np.einsum("tij,tj->ti", above, place)
            rotation[:, j] = above @ turn
    return position, rotation
