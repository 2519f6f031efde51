"""What a joint recording says about each of the actor's segments, before any calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.names import SIDES, recognise
from physretarget.capture.recording import Floats, JointRecording
from physretarget.capture.skeleton import to_world
from physretarget.errors import InputError

# Joints of the trunk as shares of the way from the mid hip to the neck (de Leva 1996).
ABDOMEN_SHARE, CHEST_SHARE = 0.24, 0.60
_DEGENERATE = 0.015  # m: an end site nearer than this says nothing


@dataclass(frozen=True, eq=False)
class Measured:
    """Per segment of the actor, as far as the file has it.

    ``centre`` (T, 3): the segment's joint centre; ``turn`` (T, 3, 3): the rotation of the file's
    joint that moves it; ``end`` (T, 3): top of the head, finger, ball of the toes; ``rest``:
    the centres with all joint rotations equal, in the joints' common local axes (3,), and
    ``rest_end`` the ends. ``up`` (3,): the world's vertical in those axes.
    """

    centre: Mapping[str, Floats]
    turn: Mapping[str, Floats]
    end: Mapping[str, Floats]
    rest: Mapping[str, Floats]
    rest_end: Mapping[str, Floats]
    up: Floats
    fps: float
    notes: tuple[str, ...]


def unit(vector: Floats) -> Floats:
    """The vector(s) at length one; zero stays zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return np.asarray(vector / np.where(length > 1e-12, length, 1.0))


def rest_offsets(recording: JointRecording) -> Floats:
    """Each joint's place in its parent's frame (J, 3), median over the clip; roots at zero."""
    offsets = np.zeros((len(recording.names), 3))
    for j, parent in enumerate(recording.parents):
        if parent >= 0:
            way = recording.position[:, j] - recording.position[:, parent]
            local = np.einsum("tji,tj->ti", recording.rotation[:, parent], way)
            good = local[np.isfinite(local).all(axis=1)]
            if len(good):
                offsets[j] = np.median(good, axis=0)
    return offsets


def rest_positions(recording: JointRecording) -> Floats:
    """The skeleton with all joint rotations equal (J, 3), in the joints' local axes."""
    offsets = rest_offsets(recording)
    for j, parent in enumerate(recording.parents):
        if parent >= 0:
            offsets[j] += offsets[parent]
    return offsets


def measure(recording: JointRecording, *, swapped: bool = False) -> Measured:
    """Find the segments' joints; ``swapped`` exchanges the labels left and right.

    Raises InputError naming what is missing: hips and both legs are needed.
    """
    body = recognise(recording.names, recording.parents)
    roles = dict(body.roles)
    reader = _Reader(recording)
    reader.legs(roles)
    if swapped:
        roles = {_other_side(role): joint for role, joint in roles.items()}
    spine = [j for j in body.spine if j != roles["hips"]]
    reader.pelvis(roles)
    reader.trunk(roles, spine)
    for side in SIDES:
        reader.limb(roles, side, ("thigh", "shank", "foot"), "toe")
        reader.limb(roles, side, ("clavicle", "upper_arm", "forearm", "hand"), "finger")
    return Measured(
        centre=reader.centre,
        turn=reader.turn,
        end=reader.end,
        rest=reader.rest,
        rest_end=reader.rest_end,
        up=to_world(recording.source.up)[2],
        fps=recording.source.fps,
        notes=tuple(reader.notes),
    )


def _other_side(role: str) -> str:
    for side, other in (("left_", "right_"), ("right_", "left_")):
        if role.startswith(side):
            return other + role.removeprefix(side)
    return role


class _Reader:
    """Collects centres, turns and ends segment by segment."""

    def __init__(self, recording: JointRecording) -> None:
        self.recording = recording
        self.at_rest = rest_positions(recording)
        self.centre: dict[str, Floats] = {}
        self.turn: dict[str, Floats] = {}
        self.end: dict[str, Floats] = {}
        self.rest: dict[str, Floats] = {}
        self.rest_end: dict[str, Floats] = {}
        self.notes: list[str] = []

    def legs(self, roles: Mapping[str, int]) -> None:
        """Refuse a skeleton without hips and legs."""
        missing = []
        for side in SIDES:
            for part in ("thigh", "shank"):
                if f"{side}_{part}" not in roles:
                    missing.append(f"{side} {part}")
            shank = roles.get(f"{side}_shank")
            if f"{side}_foot" not in roles and (shank is None or self._site(shank) is None):
                missing.append(f"{side} foot")
        if "hips" not in roles:
            missing.insert(0, "hips")
        if missing:
            known = ", ".join(self.recording.names[:12])
            raise InputError(
                f"No joint was recognised as {', '.join(missing)}; the file's joints are "
                f"{known}{', …' if len(self.recording.names) > 12 else ''}.",
                path=self.recording.source.path,
            )

    def add(self, segment: str, joint: int) -> None:
        self.centre[segment] = self.recording.position[:, joint]
        self.turn[segment] = self.recording.rotation[:, joint]
        self.rest[segment] = self.at_rest[joint]

    def _site(self, joint: int) -> Floats | None:
        """The offset of the joint's end site, if it has one that is not degenerate."""
        for parent, offset in self.recording.end_sites.values():
            if parent == joint and np.linalg.norm(offset) > _DEGENERATE:
                return offset
        return None

    def _ending(self, joint: int) -> tuple[Floats, Floats] | None:
        """Where the joint's end site is over time, and at rest."""
        offset = self._site(joint)
        if offset is None:
            return None
        moved = np.einsum("tij,j->ti", self.recording.rotation[:, joint], offset)
        return self.recording.position[:, joint] + moved, self.at_rest[joint] + offset

    def pelvis(self, roles: Mapping[str, int]) -> None:
        """The pelvis turns with the hips' joint; its centre is midway between the hip joints."""
        thighs = [roles["left_thigh"], roles["right_thigh"]]
        self.turn["pelvis"] = self.recording.rotation[:, roles["hips"]]
        self.centre["pelvis"] = self.recording.position[:, thighs].mean(axis=1)
        self.rest["pelvis"] = self.at_rest[thighs].mean(axis=0)

    def trunk(self, roles: Mapping[str, int], spine: list[int]) -> None:
        """Abdomen, chest and head: the actor bends at two places, the file may at any number."""
        head, neck = roles.get("head"), roles.get("neck")
        top = neck if neck is not None else head
        if top is None:
            self.notes.append("no neck or head joint was recognised: the head is held still")
        else:
            self.add("head", top)
            moved = head if head is not None else top
            self.turn["head"] = self.recording.rotation[:, moved]
            ending = self._ending(moved)
            if ending is not None:
                self.end["head"], self.rest_end["head"] = ending
        if not spine:
            self.notes.append("no joint of the spine was recognised: the trunk is held straight")
            return
        chest = spine[-1]
        share = self._shares(spine, top)
        if len(spine) == 1:
            is_chest = abs(share[0] - CHEST_SHARE) < abs(share[0] - ABDOMEN_SHARE)
            self.add("chest" if is_chest else "abdomen", chest)
            return
        self.add("chest", chest)
        lower = int(np.argmin(np.abs(np.array(share[:-1]) - ABDOMEN_SHARE)))
        if np.linalg.norm(self.at_rest[spine[lower]] - self.at_rest[chest]) > _DEGENERATE:
            self.add("abdomen", spine[lower])

    def _shares(self, spine: list[int], top: int | None) -> list[float]:
        """Path length from the mid hip to each spine joint, as a share of that to the neck."""
        chain = [self.rest["pelvis"], *(self.at_rest[j] for j in spine)]
        if top is not None:
            chain.append(self.at_rest[top])
        lengths = np.linalg.norm(np.diff(chain, axis=0), axis=1)
        path = np.cumsum(lengths)
        whole = path[-1] if top is not None else path[-1] / CHEST_SHARE
        return [float(part / max(whole, 1e-9)) for part in path[: len(spine)]]

    def limb(self, roles: Mapping[str, int], side: str, parts: tuple[str, ...], tip: str) -> None:
        """One arm or leg, down to the ends that are only marked by an End Site."""
        last: int | None = None
        for part in parts:
            segment = f"{side}_{part}"
            joint = roles.get(segment)
            # A bone without length has no direction.
            if (
                part in ("forearm", "hand")
                and joint is not None
                and last is not None
                and not self._apart(joint, last)
            ):
                self.notes.append(f"the {side} {part} joint lies on the one before: held still")
                return
            if joint is not None:
                self.add(segment, joint)
                last = joint
            elif last is not None and part in ("foot", "hand"):
                ending = self._ending(last)
                if ending is not None:  # the joint is marked, but the segment has no rotation
                    self.centre[segment], self.rest[segment] = ending
                    self.notes.append(f"the file does not turn the {side} {part}: held still")
                return
            elif part != "clavicle":
                name = part.replace("_", " ")
                self.notes.append(f"no joint was recognised as {side} {name}: held still")
                return
        if last is None:
            return
        beyond = roles.get(f"{side}_{tip}")
        end = f"{side}_{parts[-1]}"
        if beyond is not None and self._apart(beyond, last):
            self.end[end] = self.recording.position[:, beyond]
            self.rest_end[end] = self.at_rest[beyond]
        else:
            ending = self._ending(last)
            if ending is not None:
                self.end[end], self.rest_end[end] = ending

    def _apart(self, a: int, b: int) -> bool:
        return bool(np.linalg.norm(self.at_rest[a] - self.at_rest[b]) > _DEGENERATE)


def finite_frames(measured: Measured) -> NDArray[np.bool_]:
    """Frames in which every joint that is used has numbers (T,)."""
    good = np.ones(len(measured.centre["pelvis"]), dtype=np.bool_)
    for centre in (*measured.centre.values(), *measured.end.values()):
        good &= np.isfinite(centre).all(axis=1)
    for turn in measured.turn.values():
        good &= np.isfinite(turn).all(axis=(1, 2))
    return good
