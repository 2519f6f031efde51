"""Whether a clip's frames follow one another as a body's must: read as given, never filtered.

A body's position has no jumps. An impact changes its velocity at once, within a frame, and that
bends its path; it does not break it. With the second differences d of a coordinate,

    d[t] = q[t - 1] - 2 q[t] + q[t + 1],

one impact anywhere between frames t and t + 1 leaves d[t] and d[t + 1] of the same sign, whatever
its strength, and so does steady acceleration. A jump by J between them leaves d[t] = J and
d[t + 1] = -J. What opposes in the two, min(|d[t]|, |d[t + 1]|) where their signs differ and else 0,
is therefore the smallest jump that explains the frames: it is 0 for motion and impacts, J for a
jump, and of the size of the noise in every frame of a noisy clip. For vectors it is the distance
of 0 from the segment between d[t] and -d[t + 1]. Two impacts within two frames can look like a
jump; they leave the velocity changed, and a jump does not: that change is taken off.

All sizes are in metres and radians: they mean the same at any frame rate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import Tree, difference
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Noise is looked for in stretches this long, each half overlapping the next.
NOISE_WINDOW_S = 1.0
# Noise of clips finer than that is looked for at this rate too: interpolation hides it from frame
# to frame. Human motion comes in 30 frames/s.
NOISE_HZ = 30.0
# The median of min(|d[t]|, |d[t+1]|) where signs differ, else 0, of white noise of deviation 1.
NOISE_MEDIAN = 0.766
_FEWEST_PAIRS = 8

_BLOCK = 4096
# Steps of this share of the ones around are as good as none, whatever a converter did to them.
_STILL_SHARE = 0.02
_ROUNDING = 1e-9
# Steps below this many of the file's smallest ones may come from rounding to few digits.
_QUANTA = 20.0
# A step across one missing frame is twice as long as those around; halfway between 1 and 2, and a
# tenth for what bodies do themselves.
_LONGER = 1.6
# What of such a step may point elsewhere than the steps around, and what these may differ.
_ASIDE, _UNSTEADY = 0.3, 0.6


@dataclass(frozen=True, kw_only=True, eq=False)
class Continuity:
    """Per step from frame t to t + 1 (T - 1,), per frame (T,) and per stretch (W,).

    Attributes:
        step: (T - 1,) largest change of a coordinate, m or rad.
        jump_position, jump_rotation: (T - 1,) m, rad: jump of the root; 0 without a root.
        jump_joint: (T - 1,) rad or m: largest jump of another joint, ``jump_dof`` which.
        jump_pose: (T - 1,) rad: jump of the whole pose, the root mean square over all degrees of
            freedom, one CoM height for a radian; ``pace`` (T - 1,) rad: how far it moves in the
            faster one of the steps before and after.
        jumping: (T - 1,) share of the other joints whose jump exceeds ``JUMPING``.
        repeats: (T - 1,) whether the step is none among steps in one direction.
        skipped: (T - 1,) by how many frames the whole pose runs ahead along its path, else 0.
        spike_position, spike_rotation: (T,) m, rad: how far the root's frame lies off those
            before and those after, which agree; ``spike_joint`` and ``spike_dof`` likewise.
        noise_first, noise_last: (W,) frames of the stretches.
        noise_position, noise_rotation, noise_joint: (W,) m, rad: standard deviation of white
            noise in the worst coordinate; ``noise_dof`` (W,) that of the joints.
        noise_joints: (W,) rad or m: the same of the middle one of the joints.
        noise_step: (W,) s between the instants that were compared.
    """

    step: Floats
    jump_position: Floats
    jump_rotation: Floats
    jump_joint: Floats
    jump_dof: Ints
    jump_pose: Floats
    pace: Floats
    jumping: Floats
    repeats: NDArray[np.bool_]
    skipped: Floats
    spike_position: Floats
    spike_rotation: Floats
    spike_joint: Floats
    spike_dof: Ints
    noise_first: Ints
    noise_last: Ints
    noise_position: Floats
    noise_rotation: Floats
    noise_joint: Floats
    noise_joints: Floats
    noise_dof: Ints
    noise_step: Floats

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.spike_position)

    def noise_around(self, kind: str) -> Floats:
        """(T,) the noise of ``kind`` (position, rotation, joint) in the stretches of each frame."""
        level = np.zeros(self.frames)
        rows = (self.noise_first, self.noise_last, getattr(self, f"noise_{kind}"))
        for first, last, value in zip(*rows, strict=True):
            here = slice(int(first), int(last) + 1)
            level[here] = np.maximum(level[here], value)
        return level

    @property
    def paced(self) -> NDArray[np.bool_]:
        """(T - 1,) steps at or beside a frame repeated or missing: they are no jumps."""
        paced = self.repeats | (self.skipped > 0)
        near = paced.copy()
        near[1:] |= paced[:-1]
        near[:-1] |= paced[1:]
        return near


# A joint jumps in the sense of ``jumping`` beyond this, and beyond what its own acceleration of so
# much moves it in a frame (rad, rad/s^2; for slides m and m/s^2).
JUMPING = 0.03
JUMPING_ACCELERATION = 45.0


def continuity(
    character: Character, poses: Callable[[int, int], Floats], frames: int, fps: float
) -> Continuity:
    """Read a clip of ``frames`` frames block by block; ``poses`` (first, last) gives some."""
    steps = [_steps(character, poses, frames, fps, first) for first in range(0, frames, _BLOCK)]
    noise = list(_noise(character, poses, frames, fps))
    parts = {name: np.concatenate([part[name] for part in steps]) for name in steps[0]}
    rows = {name: np.array([row[name] for row in noise]) for name in _NOISE}
    return Continuity(**parts, **rows)


_NOISE = tuple(f.name for f in fields(Continuity) if f.name.startswith("noise"))
Series = dict[str, NDArray[np.generic]]


def _steps(
    character: Character, poses: Callable[[int, int], Floats], frames: int, fps: float, first: int
) -> Series:
    """Everything per step and frame of a block that begins at ``first``."""
    last = min(first + _BLOCK, frames)
    start, stop = max(0, first - 4), min(frames, last + 4)
    qpos = poses(start, stop)
    change = difference(character.tree, qpos[:-1], qpos[1:])
    bend = np.diff(change, axis=0)
    root, joints = _dofs(character)
    steps = slice(first - start, min(last, frames - 1) - start)
    inside = slice(first - start, last - start)
    found: Series = {"step": np.abs(np.diff(qpos, axis=0)).max(axis=1, initial=0.0)[steps]}
    for name, dofs in (("position", root[:3]), ("rotation", root[3:])):
        found[f"jump_{name}"] = _padded(_jump(bend[:, dofs]), len(change))[steps]
        found[f"spike_{name}"] = _padded(_spike(bend[:, dofs]), len(qpos))[inside]
    jump = _padded(_joint_jump(bend[:, joints]), len(change))[steps]
    spike = _padded(_spike(bend[:, joints, None]), len(qpos))[inside]
    for name, values in (("jump", jump), ("spike", spike)):
        found[f"{name}_joint"] = values.max(axis=1, initial=0.0)
        worst = values.argmax(axis=1) if len(joints) else np.zeros(len(values), np.int64)
        found[f"{name}_dof"] = joints[worst] if len(joints) else worst
    limit = JUMPING + JUMPING_ACCELERATION / fps**2 if fps else JUMPING
    share = (jump > limit).mean(axis=1) if len(joints) else np.zeros(len(jump))
    found["jumping"] = share
    scaled = change * _scale(character)
    size = np.sqrt(max(character.tree.nv, 1))
    found["jump_pose"] = _padded(_jump(np.diff(scaled, axis=0)), len(change))[steps] / size
    speed = np.pad(np.linalg.norm(scaled, axis=1) / size, 1)
    found["pace"] = np.maximum(speed[:-2], speed[2:])[steps]
    repeats, skipped = _paces(scaled, np.diff(qpos, axis=0))
    return found | {"repeats": repeats[steps], "skipped": skipped[steps]}


def _dofs(character: Character) -> tuple[Ints, Ints]:
    """The root's degrees of freedom, three along and three about axes, and all others."""
    every = np.arange(character.tree.nv)
    if not character.has_root:
        return every[:0], every
    root = every[character.root_dof : character.root_dof + 6]
    return root, np.setdiff1d(every, root)


def linear_dofs(tree: Tree) -> NDArray[np.bool_]:
    """(nv,) which degrees of freedom move in metres."""
    linear = np.zeros(tree.nv, dtype=bool)
    for joint in tree.joints:
        if joint.kind in ("free", "slide"):
            linear[joint.dof : joint.dof + (3 if joint.kind == "free" else 1)] = True
    return linear


def _scale(character: Character) -> Floats:
    """(nv,) what makes metres and radians comparable: one CoM height is one radian."""
    height = max(character.com_height, 1e-3)
    return np.where(linear_dofs(character.tree), 1 / height, 1.0)


def _padded(values: Floats, length: int) -> Floats:
    """As many zeros before as behind, until there are ``length``."""
    missing = max(0, length - len(values))
    widths = [(missing // 2, missing - missing // 2), *[(0, 0)] * (values.ndim - 1)]
    return np.pad(values, widths)


def _jump(bend: Floats) -> Floats:
    """(n - 1,) of second differences (n, k): the jump between each and the next, net."""
    if len(bend) < 2 or bend.shape[1] == 0:
        return np.zeros(max(0, len(bend) - 1))
    before, behind = bend[:-1], -bend[1:]
    way = behind - before
    square = (way**2).sum(axis=1)
    share = np.clip(-(before * way).sum(axis=1) / np.where(square > 0, square, 1.0), 0, 1)
    jump = np.linalg.norm(before + share[:, None] * way, axis=1)
    net: Floats = np.maximum(0.0, jump - np.linalg.norm(bend[:-1] + bend[1:], axis=1))
    return net


def _opposed(before: Floats, behind: Floats) -> Floats:
    """What opposes in two second differences of a coordinate: the smaller, where signs differ."""
    size = np.minimum(np.abs(before), np.abs(behind))
    return np.where(before * behind < 0, size, 0.0)


def _joint_jump(bend: Floats) -> Floats:
    """(n - 1, k) the net jump of every coordinate for itself."""
    before, behind = bend[:-1], bend[1:]
    net: Floats = np.maximum(0.0, _opposed(before, behind) - np.abs(before + behind))
    return net


def _spike(bend: Floats) -> Floats:
    """(n - 2, ...) of second differences (n, ..., k): how far one frame alone lies off.

    A frame off by s leaves s, -2 s, s. An impact beside it bends on one side only: of what the
    two sides and the middle say, the least counts.
    """
    if len(bend) < 3 or bend.shape[-1] == 0:
        return np.zeros((max(0, len(bend) - 2), *bend.shape[1:-1]))
    middle = np.linalg.norm(bend[1:-1], axis=-1)
    along = -bend[1:-1] / np.where(middle > 0, middle, 1.0)[..., None]
    sides = [(side * along).sum(axis=-1) for side in (bend[:-2], bend[2:])]
    off: Floats = np.maximum(0.0, np.minimum(np.minimum(*sides), middle / 2))
    return off


def _paces(v: Floats, raw: Floats) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """(n,) which of the steps (n, nv) repeat a frame, and how many frames others skip.

    The whole pose goes on along its path: by nothing, or by several steps at once. ``raw`` are
    the same steps in coordinates of the file.
    """
    count = len(v)
    repeats, skipped = np.zeros(count, dtype=bool), np.zeros(count)
    if count < 5:
        return repeats, skipped
    speed = np.linalg.norm(v, axis=1)
    largest = np.abs(raw).max(axis=1, initial=0.0)
    sizes = np.abs(raw[raw != 0])
    quantum = float(sizes.min()) if len(sizes) else 0.0
    t = np.arange(1, count - 1)
    before, behind = v[t - 1], v[t + 1]
    together = (before * behind).sum(axis=1)
    slower = np.minimum(speed[t - 1], speed[t + 1])
    moves = np.minimum(largest[t - 1], largest[t + 1]) > max(_QUANTA * quantum, 1e-6)
    still = (largest[t] <= _ROUNDING) | (speed[t] < _STILL_SHARE * slower)
    repeats[t] = still & moves & (together > 0.5 * speed[t - 1] * speed[t + 1])
    t = np.arange(2, count - 2)
    mean = (v[t - 1] + v[t + 1]) / 2
    square = (mean**2).sum(axis=1)
    pace = (v[t] * mean).sum(axis=1) / np.where(square > 0, square, 1.0)
    aside = np.linalg.norm(v[t] - pace[:, None] * mean, axis=1)
    around = np.max([speed[t - 2], speed[t - 1], speed[t + 1], speed[t + 2]], axis=0)
    unsteady = np.linalg.norm(v[t + 1] - v[t - 1], axis=1)
    skips = (
        (speed[t] > _LONGER * around) & (pace > _LONGER) & (aside < _ASIDE * speed[t])
        & (unsteady < _UNSTEADY * np.sqrt(square)) & (largest[t] > max(_QUANTA * quantum, 1e-6))
    )  # fmt: skip
    skipped[t[skips]] = np.round(pace[skips]) - 1
    return repeats, skipped


def _noise(
    character: Character, poses: Callable[[int, int], Floats], frames: int, fps: float
) -> Iterator[dict[str, float]]:
    """Of each stretch the noise of root and joints, at the clip's rate and at a coarser one."""
    if fps <= 0:
        return
    window = max(_FEWEST_PAIRS, round(NOISE_WINDOW_S * fps))
    root, joints = _dofs(character)
    spans = sorted({1, max(1, round(fps / NOISE_HZ))})
    for first in range(0, max(1, frames - window // 2), max(1, window // 2)):
        last = min(first + window, frames)
        qpos = poses(first, last)
        for span in spans:
            sigma = _deviation(character.tree, qpos, span)
            if sigma is None:
                continue
            # What a body's own acceleration may hide grows with the step: fine steps say more.
            found = {
                "noise_first": first, "noise_last": last - 1, "noise_step": span / fps,
                "noise_position": sigma[root[:3]].max(initial=0.0),
                "noise_rotation": sigma[root[3:]].max(initial=0.0),
                "noise_joint": sigma[joints].max(initial=0.0),
                "noise_joints": np.median(sigma[joints]) if len(joints) else 0.0,
                "noise_dof": joints[sigma[joints].argmax()] if len(joints) else 0,
            }  # fmt: skip
            yield found


def _deviation(tree: Tree, qpos: Floats, span: int) -> Floats | None:
    """(nv,) deviation of white noise, from frames ``span`` apart; None of too few."""
    change = difference(tree, qpos[:-span], qpos[span:])
    bend = change[span:] - change[:-span]
    before, behind = bend[:-span], bend[span:]
    if len(before) < _FEWEST_PAIRS:
        return None
    return np.asarray(np.median(_opposed(before, behind), axis=0) / NOISE_MEDIAN)
