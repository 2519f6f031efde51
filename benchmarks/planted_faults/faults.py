"""The faults: each plants itself, at a size, into a clean clip."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.planted_faults import puppets
from benchmarks.planted_faults.bases import (
    Base,
    all_bases,
    clip_of,
    crane,
    hop,
    lamp_acting,
    statues,
    times,
    walks,
    yaw,
)
from physretarget.clip import Clip
from physretarget.mjcf import Character
from physretarget.options.judging import Profile

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Planted:
    """One fault in one place; ``clip`` makes it at frames per second and size, where it can.

    ``clean`` makes the clip without it; findings that are there too do not count.
    """

    base: str
    character: Character
    profile: Profile
    clip: Callable[[float, float], Clip | None]
    clean: Callable[[float], Clip]


@dataclass(frozen=True, eq=False)
class Fault:
    """A kind of fault.

    Attributes:
        name, unit: what grows with ``sizes``, from mild to bad.
        codes: beginnings of the codes that name it.
        planted: where.
    """

    name: str
    unit: str
    sizes: tuple[float, ...]
    codes: tuple[str, ...]
    planted: Callable[[], Iterator[Planted]]


Change = Callable[[Base, Array, float, float], Array]
"""(base, qpos, frames per second, size) → qpos with the fault in it."""
DATA = ("DAT", "KIN003", "KIN004")


def _in(bases: Callable[[], Sequence[Base]], change: Change) -> Callable[[], Iterator[Planted]]:
    def plant(base: Base, fps: float, size: float) -> Clip:
        return clip_of(base.character, change(base, base.qpos(fps).copy(), fps, size), fps)

    def planted() -> Iterator[Planted]:
        for base in bases():
            yield Planted(
                base.name,
                base.character,
                base.profile,
                lambda fps, size, base=base: plant(base, fps, size),  # type: ignore[misc]
                lambda fps, base=base: clip_of(base.character, base.qpos(fps), fps),  # type: ignore[misc]
            )

    return planted


def _statues(
    lean: Callable[[puppets.Statue, float], float | None],
) -> Callable[[], Iterator[Planted]]:
    def leaning(statue: puppets.Statue, fps: float, size: float) -> Clip | None:
        angle = lean(statue, size)
        return None if angle is None else still(statue, fps, angle)

    def still(statue: puppets.Statue, fps: float, angle: float) -> Clip:
        return clip_of(statue.character, np.tile(statue.pose(angle), (round(2 * fps), 1)), fps)

    def planted() -> Iterator[Planted]:
        for statue in statues():
            robot: Profile = "robot" if "g1" in statue.character.name else "animation"
            yield Planted(
                f"{statue.character.name}, statue",
                statue.character,
                robot,
                lambda fps, size, s=statue: leaning(s, fps, size),  # type: ignore[misc]
                lambda fps, s=statue: still(s, fps, 0.0),  # type: ignore[misc]
            )

    return planted


def _puppet(
    motion: Callable[[Array, float], Array], harmless: float
) -> Callable[[], Iterator[Planted]]:
    character = puppets.six_legs()

    def planted() -> Iterator[Planted]:
        yield Planted(
            "six legs, planted",
            character,
            "animation",
            lambda fps, size: clip_of(character, motion(times(fps), size), fps),
            lambda fps: clip_of(character, motion(times(fps), harmless), fps),
        )

    return planted


OVERLOADS = (0.9, 1.1, 1.2, 1.5, 2.0, 2.5, 3.0, 5.0)


def _crane() -> Iterator[Planted]:
    """The more level the bar, the more torque it takes to hold it."""
    character = crane(9.81 / OVERLOADS[-1])

    def still(fps: float, ratio: float) -> Clip:
        pose = character.reference_qpos.copy()
        pose[7] = -np.arccos(ratio / OVERLOADS[-1])
        return clip_of(character, np.tile(pose, (round(2 * fps), 1)), fps)

    yield Planted("crane", character, "animation", still, lambda fps: still(fps, 0.5))


def _rng(size: float) -> np.random.Generator:
    return np.random.default_rng([11, round(1e3 * size)])


def _lifted(base: Base, qpos: Array, fps: float, size: float) -> Array:
    qpos[:, 2] += 1e-3 * size
    return qpos


def _lowered(base: Base, qpos: Array, fps: float, size: float) -> Array:
    return _lifted(base, qpos, fps, -size)


def _sliding(base: Base, qpos: Array, fps: float, size: float) -> Array:
    qpos[:, 1] += 0.01 * size * np.arange(len(qpos)) / fps
    return qpos


def _root_noise(base: Base, qpos: Array, fps: float, size: float) -> Array:
    qpos[:, :3] += 1e-3 * size * _rng(size).normal(size=(len(qpos), 3))
    return qpos


def _joint_noise(base: Base, qpos: Array, fps: float, size: float) -> Array:
    qpos[:, base.joint_at] += np.radians(size) * _rng(size).normal(size=len(qpos))
    return qpos


def _heading_jump(base: Base, qpos: Array, fps: float, size: float) -> Array:
    at = len(qpos) // 2
    turn, out = yaw(np.radians(size)), np.zeros(4)
    pivot, moved = qpos[at, :3].copy(), np.zeros(3)
    for row in qpos[at:]:
        mujoco.mju_mulQuat(out, turn, row[3:7])
        mujoco.mju_rotVecQuat(moved, row[:3] - pivot, turn)
        row[:3], row[3:7] = pivot + moved, out
    return qpos


def _position_jump(base: Base, qpos: Array, fps: float, size: float) -> Array:
    qpos[len(qpos) // 2 :, :2] += 0.01 * size * np.sqrt(0.5)
    return qpos


def _root_spike(base: Base, qpos: Array, fps: float, size: float) -> Array:
    qpos[len(qpos) // 2, :2] += 0.01 * size * np.sqrt(0.5)
    return qpos


def _joint_spike(base: Base, qpos: Array, fps: float, size: float) -> Array:
    qpos[len(qpos) // 2, base.joint_at] += np.radians(size)
    return qpos


def _doubled(base: Base, qpos: Array, fps: float, size: float) -> Array:
    frames = np.arange(len(qpos))
    return qpos[np.where(frames % round(size) == round(size) - 1, frames - 1, frames)]


def _gap(base: Base, qpos: Array, fps: float, size: float) -> Array:
    at = len(qpos) // 2
    return np.delete(qpos, slice(at, at + round(size)), axis=0)


def _thinned(base: Base, qpos: Array, fps: float, size: float) -> Array:
    return np.delete(qpos, slice(round(size) - 1, None, round(size)), axis=0)


def _frozen(base: Base, qpos: Array, fps: float, size: float) -> Array:
    at = len(qpos) // 3
    qpos[at : at + round(size * fps)] = qpos[at]
    return qpos


def _beyond_limit(base: Base, qpos: Array, fps: float, size: float) -> Array:
    beyond = base.character.upper[base.joint_at] + np.radians(size)
    t = times(fps, (len(qpos) - 1) / fps)
    bump = np.exp(-(((t - t.mean()) / 0.4) ** 2))
    qpos[:, base.joint_at] += bump * (beyond - qpos[:, base.joint_at])
    return qpos


def _too_fast(base: Base, qpos: Array, fps: float, size: float) -> Array:
    """A smooth step of 1.5 rad whose greatest speed is ``size`` rad/s."""
    t = times(fps, (len(qpos) - 1) / fps)
    qpos[:, base.joint_at] += 0.75 * np.tanh(size / 0.75 * (t - t.mean()))
    return qpos


def _foot_pitch(base: Base, qpos: Array, fps: float, size: float) -> Array:
    for side in ("left", "right"):
        joint = base.character.model.joint(f"{side}_ankle_pitch_joint")
        qpos[:, joint.qposadr[0]] -= np.radians(size)
    return qpos


def _scaled(base: Base, qpos: Array, fps: float, size: float) -> Array:
    qpos[:, :2] *= 1 + 0.01 * size
    return qpos


def _slowed(fps: float, size: float) -> Clip:
    """More frames of the same motion: at the frame rate told, it takes longer."""
    base = hop()
    return clip_of(base.character, _resampled(base.qpos(500), 500, fps * size), fps)


def _resampled(qpos: Array, have: float, want: float) -> Array:
    """Between frames linearly: at 500 frames/s that is beyond what matters."""
    t = np.arange(int((len(qpos) - 1) / have * want) + 1) / want
    out = np.stack([np.interp(t, np.arange(len(qpos)) / have, c) for c in qpos.T], axis=1)
    out[:, 3:7] /= np.linalg.norm(out[:, 3:7], axis=1, keepdims=True)
    return out


def _flights() -> Iterator[Planted]:
    character = hop().character
    yield Planted(
        hop().name, character, "animation", _slowed, lambda fps: _slowed(fps, 1.0)
    )  # fmt: skip


def _moving() -> list[Base]:
    return [*walks(), lamp_acting()]


def _feet() -> list[Base]:
    return [b for b in walks() if b.name.startswith("G1")]


FAULTS: tuple[Fault, ...] = (
    Fault("centre of mass past the toe", "cm", (0.2, 0.5, 1, 1.5, 2, 3, 5, 8),
          ("DYN002", "DYN005"), _statues(lambda s, size: s.lean_for(0.01 * size))),
    Fault("statue that leans on flat feet", "°", (5, 8, 10, 12, 15, 20, 25, 35, 45),
          ("DYN002", "DYN005"), _statues(lambda s, size: float(np.radians(size)))),
    Fault("clip lifted", "mm", (2, 3, 5, 8, 10, 15, 20, 30, 50), ("CON003", "DAT"),
          _in(all_bases, _lifted)),
    Fault("clip lowered", "mm", (2, 3, 5, 8, 10, 15, 20, 30, 50), ("CON001", "DAT"),
          _in(all_bases, _lowered)),
    Fault("planted feet slide", "cm/s", (1, 2, 3, 5, 8, 10, 15, 20, 30), ("CON002",),
          _in(all_bases, _sliding)),
    Fault("root noise", "mm", (0.3, 0.5, 1, 2, 3, 5, 10), DATA, _in(all_bases, _root_noise)),
    Fault("joint noise", "°", (0.1, 0.2, 0.5, 1, 2, 5), DATA, _in(all_bases, _joint_noise)),
    Fault("heading jumps", "°", (1, 2, 3, 5, 8, 10, 15, 20, 45), DATA,
          _in(all_bases, _heading_jump)),
    Fault("position jumps", "cm", (0.5, 1, 2, 3, 5, 10, 20, 50), DATA,
          _in(all_bases, _position_jump)),
    Fault("root off for one frame", "cm", (0.3, 0.5, 1, 2, 3, 5, 10, 20), DATA,
          _in(all_bases, _root_spike)),
    Fault("joint off for one frame", "°", (1, 2, 5, 10, 20, 45), DATA,
          _in(all_bases, _joint_spike)),
    Fault("every n-th frame doubled", "n", (50, 20, 10, 5, 3, 2), DATA, _in(_moving, _doubled)),
    Fault("frames missing at one place", "frames", (1, 2, 3, 5, 10, 20), DATA,
          _in(_moving, _gap)),
    Fault("every n-th frame missing", "n", (50, 20, 10, 5, 3), DATA, _in(_moving, _thinned)),
    Fault("frozen", "s", (0.05, 0.1, 0.2, 0.3, 0.5, 1.0), DATA, _in(_moving, _frozen)),
    Fault("joint beyond its limit", "°", (0.5, 1, 2, 5, 10, 20), ("KIN001",),
          _in(all_bases, _beyond_limit)),
    Fault("joint too fast", "rad/s", (10, 15, 20, 30, 40, 60, 100, 150), ("KIN002",),
          _in(all_bases, _too_fast)),
    Fault("joint beyond its torque", "×", OVERLOADS, ("DYN008",), _crane),
    Fault("floor that pulls", "BW", (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5), ("DYN003",),
          _puppet(puppets.crouching, -0.5)),
    Fault("friction demanded", "× µ", (1.02, 1.05, 1.1, 1.2, 1.3, 1.5, 1.7), ("DYN004", "DYN001"),
          _puppet(puppets.swaying, 0.7)),
    Fault("flight, played too slowly", "×", (1.02, 1.05, 1.1, 1.2, 1.5, 2, 4),
          ("DYN006", "DAT"), _flights),
    Fault("feet pitched", "°", (2, 3, 5, 8, 10, 15), ("CON",), _in(_feet, _foot_pitch)),
    Fault("root's path scaled", "%", (1, 2, 5, 10, 20, 50), ("CON002", "DAT"),
          _in(walks, _scaled)),
)  # fmt: skip
