"""Broken input, and the one line that says what is behind it.

Every kind of mistake is made with clean clips of several bodies, most of which no rule was made
for; the cause that the report names first is compared with the mistake. Clean clips have none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.planted_faults.bases import (
    Base,
    clip_of,
    g1,
    hop,
    lamp_acting,
    played,
    six_legs_walk,
)
from physretarget.kinematics import quat_conjugate, quat_multiply
from physretarget.kinematics.order import breadth_first
from physretarget.validation import Settings, validate

Array = NDArray[np.float64]

RATES = (30, 60, 120)
Break = Callable[[Base, Array], Array]


@dataclass(frozen=True, eq=False)
class Broken:
    """One mistake: how poses are broken, or by what factor the frame rate is told wrongly.

    ``code`` names it; ``needs`` says which bases can have it at all.
    """

    name: str
    code: str
    poses: Break = lambda base, qpos: qpos
    rate: float = 1.0
    needs: Callable[[Base], bool] = lambda base: True


def _root(how: Callable[[Array], Array], part: slice) -> Break:
    def broken(base: Base, qpos: Array) -> Array:
        qpos[:, part] = how(qpos[:, part])
        return qpos

    return broken


def _turned(axis: str, degrees: float) -> Break:
    turn = Rotation.from_euler(axis, degrees, degrees=True)
    quat = turn.as_quat(scalar_first=True)

    def broken(base: Base, qpos: Array) -> Array:
        qpos[:, :3] = turn.apply(qpos[:, :3])
        qpos[:, 3:7] = quat_multiply(quat, qpos[:, 3:7])
        return qpos

    return broken


def _level_first(base: Base, qpos: Array) -> Array:
    return qpos[:, np.argsort(breadth_first(base.character.tree))]


def _pitched(base: Base, qpos: Array) -> Array:
    for side in ("left", "right"):
        joint = base.character.model.joint(f"{side}_ankle_pitch_joint")
        qpos[:, joint.qposadr[0]] += np.radians(10)
    return qpos


def _cut(base: Base, qpos: Array) -> Array:
    """What comes later at once, gone on with where the body was, turned by a quarter."""
    at, gone = len(qpos) // 3, len(qpos) // 4
    rest = qpos[at + gone :]
    turn = Rotation.from_euler("z", 90, degrees=True)
    rest[:, :3] = turn.apply(rest[:, :3] - rest[0, :3]) * [1, 1, 0] + qpos[at - 1, :3] * [1, 1, 0] \
        + rest[:, :3] * [0, 0, 1]  # fmt: skip
    rest[:, 3:7] = quat_multiply(turn.as_quat(scalar_first=True), rest[:, 3:7])
    return np.concatenate([qpos[:at], rest])


def _ordered(base: Base) -> bool:
    tree = base.character.tree
    return bool((breadth_first(tree) != np.arange(tree.nq)).any())


def _walks(base: Base) -> bool:
    return "walk" in base.name


def _is_g1(base: Base) -> bool:
    return base.name.startswith("G1")


_PLACE, _FLAT, _HEIGHT, _TURN = slice(0, 3), slice(0, 2), slice(2, 3), slice(3, 7)
BROKEN = (
    Broken("quaternion order", "DAT010", _root(lambda q: np.roll(q, -1, axis=1), _TURN)),
    Broken("quaternion inverted", "DAT010", _root(quat_conjugate, _TURN),
           needs=lambda base: base is not lamp_acting()),
    Broken("joint order", "DAT011", _level_first, needs=_ordered),
    Broken("up axis y", "DAT013", _turned("x", -90)),
    Broken("up axis x", "DAT013", _turned("y", 90)),
    Broken("centimetres", "DAT006", _root(lambda p: 100 * p, _PLACE)),
    Broken("inches", "DAT006", _root(lambda p: 39.37 * p, _PLACE)),
    Broken("5 cm too high", "CON007", _root(lambda z: z + 0.05, _HEIGHT)),
    Broken("5 cm too low", "CON007", _root(lambda z: z - 0.05, _HEIGHT)),
    Broken("root's path × 1.3", "DAT014", _root(lambda p: 1.3 * p, _FLAT), needs=_walks),
    Broken("feet pitched by 10°", "CON006", _pitched, needs=_is_g1),
    Broken("hard cut", "DAT015", _cut),
    Broken("frame rate told × 1/4", "DAT012", rate=0.25,
           needs=lambda base: _walks(base) or "hop" in base.name),
    Broken("frame rate told × 1/2", "DAT012", rate=0.5,
           needs=lambda base: _walks(base) or "hop" in base.name),
    Broken("frame rate told × 2", "DAT012", rate=2.0, needs=lambda base: base is not lamp_acting()),
    Broken("frame rate told × 4", "DAT012", rate=4.0, needs=lambda base: base is not lamp_acting()),
    Broken("nothing", ""),
)  # fmt: skip


def bases() -> list[Base]:
    """Clean clips of many kinds."""
    found = [six_legs_walk(), lamp_acting(), hop(), *(g1(n) for n in ("walk", "wave", "dance"))]
    found += [played(*take) for take in (
        ("penguin", "hop", 21), ("squirrel", "dance", 22), ("person", "dance", 23),
        ("turtle", "push", 24), ("bird", "hop", 25), ("rover", "roll", 26), ("arm", "fall", 27),
        ("snake", "dance", 28),
    )]  # fmt: skip
    return [base for base in found if base is not None]


def causes(base: Base, broken: Broken, fps: float) -> tuple[str, ...]:
    """Codes of the causes named, the first one first."""
    qpos = broken.poses(base, np.array(base.qpos(fps)))
    clip = clip_of(base.character, qpos, fps * broken.rate)
    report = validate(clip, base.character, settings=Settings(profile=base.profile))
    return tuple(cause.code for cause in report.causes)


def told(broken: Broken, found: Sequence[tuple[str, ...]]) -> str:
    """ "right", or what was named at the frame rates instead."""
    firsts = [codes[0] if codes else "" for codes in found]
    if all(code == broken.code for code in firsts):
        return "right" if broken.code else "silent"
    named = [
        "right" if broken.code and code == broken.code else code or ("none" if broken.code else "–")
        for code in firsts
    ]
    return " / ".join(named)


def rows(names: Sequence[str]) -> Iterator[tuple[Broken, list[str]]]:
    """Every mistake, with a cell for every base; empty where it cannot be made."""
    every = bases()
    for broken in BROKEN:
        if broken.name not in names:
            continue
        yield broken, [
            told(broken, [causes(base, broken, fps) for fps in RATES])
            if broken.needs(base) else ""
            for base in every
        ]  # fmt: skip


def table(names: Sequence[str]) -> list[str]:
    """The table, and how many cells are right."""
    if not names:
        return []
    done = list(rows(names))
    lines = [
        "| mistake | code | " + " | ".join(base.name for base in bases()) + " |",
        "|---" * (2 + len(bases())) + "|",
        *(f"| {b.name} | {b.code or '–'} | " + " | ".join(cells) + " |" for b, cells in done),
    ]
    made = [c for b, cells in done if b.code for c in cells if c]
    clean = [c for b, cells in done if not b.code for c in cells]
    right = sum(c == "right" for c in made)
    silent = sum(c == "silent" for c in clean)
    return [
        f"{right} of {len(made)} mistakes have the right cause first at all three frame rates; "
        f"{silent} of {len(clean)} clean clips have none.",
        "",
        *lines,
    ]
