"""One key pose file being worked on: every change is saved at once, and can be taken back.

The file is the truth. It is read again before each change, so that hand edits and another tab's
changes are picked up; a change that was made on an older state is refused, not merged. A file that
cannot be read is never written over.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from threading import RLock

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.errors import InputError, UsageError
from physretarget.keyposes import (
    KeyPose,
    KeyPoseSet,
    load,
    propose,
    save,
    settled,
    without_heading,
)
from physretarget.keyposes.candidates import start_name
from physretarget.keyposes.limbs import check_choice
from physretarget.keyposes.mirror import mirrored
from physretarget.keyposes.propose import planted_points
from physretarget.kinematics import difference, integrate
from physretarget.mjcf import Character
from physretarget.mjcf.written import drop_point, put_point
from physretarget.studio.model_file import ModelFile
from physretarget.studio.take import Take

Array = NDArray[np.float64]

LICENSE = "unknown: write here under which terms the captures may be used"
MOST_POSES = 2000
_POINT = re.compile(r"(contact|marker)_[\w.-]{1,80}")


class Conflict(InputError):
    """The state was changed elsewhere, by another tab or by hand: look at the new one first."""


@dataclass(frozen=True)
class _Step:
    """A state and what led to it; ``model`` is the character's text where that was changed here."""

    keyposes: KeyPoseSet
    what: str
    model: str | None = None


class Session:
    """Key poses of one character, in one file.

    Attributes:
        path: of the file; it need not exist yet.
        takes: the captures.
    """

    def __init__(self, character: Character, path: str | Path, takes: Sequence[Take] = ()) -> None:
        """Open a key pose file, or begin one.

        Raises:
            InputError: the file is there and cannot be used.
        """
        if not character.has_root:
            raise InputError(
                f"{character.name!r} has no free joint, so it cannot be posed in space",
                path=character.path,
            )
        self.path, self.takes = Path(path), tuple(takes)
        self._model = ModelFile(character)
        self._lock = RLock()
        self._digest = ""
        self._done: list[_Step] = []
        self._undone: list[_Step] = []
        self._revision = 0
        content = self._content()
        first = self._read() if content is not None else self._blank()
        self._digest = _digest(content)
        self._done.append(_Step(first, "opened"))

    @property
    def character(self) -> Character:
        """Whose key poses they are; another one after its points were changed."""
        return self._model.character

    def _blank(self) -> KeyPoseSet:
        return KeyPoseSet(
            character_name=self.character.name, character_sha256=self.character.sha256,
            license=LICENSE, poses=(),
        )  # fmt: skip

    # ---- state ---------------------------------------------------------------------------------

    @property
    def keyposes(self) -> KeyPoseSet:
        """What the file holds; hand edits are picked up.

        Raises:
            InputError: somebody made the file unreadable.
        """
        with self._lock:
            self._refresh()
            return self._done[-1].keyposes

    @property
    def revision(self) -> int:
        """Grows with every change, undo and redo."""
        return self._revision

    @property
    def undoable(self) -> str | None:
        """What undo would take back."""
        return self._done[-1].what if len(self._done) > 1 else None

    @property
    def redoable(self) -> str | None:
        """What redo would do again."""
        return self._undone[-1].what if self._undone else None

    def find(self, name: str) -> KeyPose:
        """A key pose by name.

        Args:
            name: Name of the key pose.

        Returns:
            The key pose.

        Raises:
            InputError: there is none.
        """
        for pose in self.keyposes.poses:
            if pose.name == name:
                return pose
        raise InputError(f"there is no key pose {name!r}", path=self.path)

    def take(self, number: int) -> Take:
        """A capture by its number.

        Args:
            number: Number of the capture, from 0.

        Returns:
            The capture.

        Raises:
            UsageError: there is none.
        """
        if not 0 <= number < len(self.takes):
            raise UsageError(f"there is no capture {number}; there are {len(self.takes)}.")
        return self.takes[number]

    # ---- changes -------------------------------------------------------------------------------

    def add(self, take: int, time: float, revision: int) -> str:
        """Begin a key pose of a frame with the proposed pose. Its name.

        Args:
            take: Number of the capture.
            time: Of the frame, s.
            revision: State that the caller has seen.

        Returns:
            The new key pose's name.
        """
        own = self.take(take)
        actor = own.actor(time)
        planted = planted_points(actor)
        exact = float(own.motion.time[own.frame(time)])
        pose = KeyPose(
            name=start_name(own.motion, own.frame(time)), source=own.name,
            sha256=own.motion.source.sha256, time=exact, actor_qpos=actor,
            qpos=propose(self.character, actor, planted=planted, limbs=self.keyposes.limbs),
            planted=planted,
        )  # fmt: skip

        def grow(old: KeyPoseSet) -> KeyPoseSet:
            taken = {each.name for each in old.poses}
            fresh = replace(pose, name=free_name(pose.name, taken))
            return replace(old, poses=(*old.poses, fresh))

        return self._change(f"pose {pose.name}", revision, grow).poses[-1].name

    def put(
        self, name: str, qpos: Array, revision: int, *, planted: Sequence[str] | None = None,
        what: str = "pose",
    ) -> None:  # fmt: skip
        """Give a key pose the character's pose ``qpos`` (nq,), as a gesture left it.

        Args:
            name: Name of the key pose.
            qpos: (nq,) pose of the character.
            revision: State that the caller has seen.
            planted: The actor's points that stand; unchanged if None.
            what: What undo calls it.
        """
        if qpos.shape != (self.character.tree.nq,) or not np.isfinite(qpos).all():
            raise UsageError(f"a pose has {self.character.tree.nq} finite numbers.")
        unknown = set(planted or ()) - set(CONTACT_POINTS)
        if unknown:
            raise UsageError(
                f"planted is {', '.join(sorted(unknown))}; it can be {', '.join(CONTACT_POINTS)}."
            )
        qpos = self.canonical(np.clip(qpos, self.character.lower, self.character.upper))

        def altered(pose: KeyPose) -> KeyPose:
            return replace(
                pose, qpos=qpos, planted=pose.planted if planted is None else tuple(planted)
            )

        self._change_one(name, f"{what} {name}", revision, altered)

    def rename(self, name: str, new: str, revision: int) -> None:
        """Call a key pose something else.

        Args:
            name: Name of the key pose.
            new: Its new name.
            revision: State that the caller has seen.
        """
        self._ready(revision)
        new = " ".join(new.split())[:200]
        if not new or any(pose.name == new for pose in self.keyposes.poses):
            raise UsageError(f"a key pose cannot be named {new!r}: it must be new, and not empty.")
        self._change_one(name, f"rename {name}", revision, lambda pose: replace(pose, name=new))

    def delete(self, name: str, revision: int) -> None:
        """Take a key pose away.

        Args:
            name: Name of the key pose.
            revision: State that the caller has seen.
        """
        self._ready(revision)
        self.find(name)
        self._change(
            f"delete {name}", revision,
            lambda old: replace(old, poses=tuple(p for p in old.poses if p.name != name)),
        )  # fmt: skip

    def mirror(self, name: str, revision: int) -> str:
        """Add the key pose's mirror image. Its name.

        Args:
            name: Name of the key pose.
            revision: State that the caller has seen.

        Returns:
            The new key pose's name.
        """
        self._ready(revision)
        pose = self.find(name)
        new = free_name(f"{name}-mirrored", {each.name for each in self.keyposes.poses})
        made = mirrored(pose, self.character, name=new)
        self._change(f"mirror {name}", revision, lambda old: replace(old, poses=(*old.poses, made)))
        return new

    def blend(self, name: str, other: str, share: float, revision: int) -> None:
        """Move a key pose's character towards another's: 0 leaves it, 1 copies the other.

        Args:
            name: Name of the key pose.
            other: Name of the other key pose.
            share: From 0 to 1.
            revision: State that the caller has seen.
        """
        if not 0.0 <= share <= 1.0:
            raise UsageError(f"the share is {share:g}; it is between 0 and 1.")
        self._ready(revision)
        tree = self.character.tree
        mine, theirs = self.find(name).qpos, self.find(other).qpos
        way = difference(tree, mine[None], theirs[None])
        qpos = integrate(tree, mine[None], share * way)[0]
        planted = self.find(name).planted
        self.put(name, settled(self.character, qpos, planted=planted), revision, what="blend")

    def choose_limb(self, actor: str, mine: str | None, revision: int) -> None:
        """Which of the character's limbs acts for one of the actor's, in poses begun from now on.

        Args:
            actor: the actor's limb.
            mine: the body at which the character's begins, "" for none, None for what the shape
                says.
            revision: that it is made on.
        """
        if mine is not None:
            check_choice(self.character, actor, mine)
        self._ready(revision)
        kept = {name: begins for name, begins in self.keyposes.limbs if name != actor}
        if mine is not None:
            kept[actor] = mine
        words = f"limb for the {actor.replace('_', ' ')}"
        self._change(words, revision, lambda old: replace(old, limbs=tuple(kept.items())))

    def put_point(
        self, name: str, body: int, place: Array, revision: int, *, tie: str | None = None
    ) -> None:
        """Write a contact point or a marker into the character's file, or move it there.

        Comments and order of the file stay. A character without markers of its own gets those
        that are made for it written down first, so that one can be moved.

        Args:
            name: Of the site, ``contact_...`` or ``marker_...``.
            body: The body that it is fixed on.
            place: (3,) m in that body's frame.
            revision: State that the caller has seen.
            tie: The actor's point that a contact point follows, None for none.

        Raises:
            InputError: the file does not hold the body itself, or MuJoCo refuses the result.
        """
        if not _POINT.fullmatch(name) or (tie is not None and tie not in CONTACT_POINTS):
            raise UsageError(f"{name!r} tied to {tie!r} is no point that a character can have.")
        if body not in self.character.bodies.tolist() or not np.isfinite(place).all():
            raise UsageError("there is no such place on the character.")
        markers = self.character.markers
        if name.startswith("marker_") and name not in markers.names:
            raise UsageError(f"{name!r} is no marker of {self.character.name!r}.")

        def write(text: str) -> str:
            if name.startswith("marker_"):
                for each, own, local in zip(
                    markers.names, markers.body, markers.local, strict=True
                ):
                    text = put_point(text, name=each, body=self._body(own), place=local.tolist())
            return put_point(text, name=name, body=self._body(body), place=place.tolist(), tie=tie)

        self._change_model(f"point {name}", revision, write)

    def drop_point(self, name: str, revision: int) -> None:
        """Take a contact point out of the character's file.

        Args:
            name: Of its site.
            revision: State that the caller has seen.
        """
        if name not in self.character.contacts.names:
            raise UsageError(f"{name!r} is no contact point of {self.character.name!r}.")
        self._change_model(f"point {name} away", revision, lambda text: drop_point(text, name))

    def _body(self, body: int) -> str:
        return str(self.character.model.body(int(body)).name)

    def undo(self, revision: int) -> None:
        """Take the last change back, without end.

        Args:
            revision: State that the caller has seen.
        """
        with self._lock:
            self._ready(revision)
            if len(self._done) < 2:
                raise UsageError("there is nothing to undo.")
            self._return_to(self._done[-2])
            self._undone.append(self._done.pop())

    def redo(self, revision: int) -> None:
        """Do again what was taken back last.

        Args:
            revision: State that the caller has seen.
        """
        with self._lock:
            self._ready(revision)
            if not self._undone:
                raise UsageError("there is nothing to do again.")
            self._return_to(self._undone[-1])
            self._done.append(self._undone.pop())

    def canonical(self, qpos: Array) -> Array:
        """The pose over the origin with heading zero, as key poses are kept.

        Args:
            qpos: (nq,) pose.

        Returns:
            (nq,) the pose.
        """
        return without_heading(qpos, front=self.character.front, up=self.character.up)

    # ---- the file ------------------------------------------------------------------------------

    def _change_one(
        self, name: str, what: str, revision: int, alter: Callable[[KeyPose], KeyPose]
    ) -> None:
        self._ready(revision)
        self.find(name)
        self._change(
            what, revision,
            lambda old: replace(
                old, poses=tuple(alter(p) if p.name == name else p for p in old.poses)
            ),
        )  # fmt: skip

    def _change(
        self, what: str, revision: int, alter: Callable[[KeyPoseSet], KeyPoseSet]
    ) -> KeyPoseSet:
        with self._lock:
            self._ready(revision)
            new = alter(self._done[-1].keyposes)
            if len(new) > MOST_POSES:
                raise UsageError(f"a file holds at most {MOST_POSES} key poses.")
            self._write(new)
            self._done.append(_Step(new, what))
            self._undone.clear()
            return new

    def _change_model(self, what: str, revision: int, alter: Callable[[str], str]) -> None:
        with self._lock:
            self._ready(revision)
            text = self._model.text()
            try:
                new = alter(text)
            except InputError as error:
                raise InputError(error.message, path=self.character.path) from error
            # What undo returns to.
            self._done[-1] = replace(self._done[-1], model=text)
            self._model.write(new)
            step = _Step(self._posed_on(self._done[-1].keyposes), what, new)
            self._write(step.keyposes)
            self._done.append(step)
            self._undone.clear()

    def _return_to(self, step: _Step) -> None:
        """Write a state's files again; the character's only if this session changed it since."""
        keyposes = step.keyposes
        if step.model is not None and step.model != (now := self._model.text()):
            if now not in {each.model for each in (*self._done, *self._undone)}:
                raise Conflict(
                    "was changed by hand: what was done here cannot be taken back",
                    path=self.character.path,
                )
            self._model.write(step.model)
        self._write(self._posed_on(keyposes))

    def _posed_on(self, keyposes: KeyPoseSet) -> KeyPoseSet:
        return replace(keyposes, character_sha256=self.character.sha256)

    def _ready(self, revision: int) -> None:
        with self._lock:
            self._refresh()
        if revision != self._revision:
            raise Conflict("was changed meanwhile: look at it again", path=self.path)

    def _refresh(self) -> None:
        content = self._content()
        if _digest(content) == self._digest:
            return
        # A file that was taken away is a file that somebody wants gone: its state can be undone.
        new = self._read() if content is not None else self._blank()
        self._digest = _digest(content)
        self._done.append(_Step(new, "changes by hand"))
        self._undone.clear()
        self._revision += 1

    def _write(self, keyposes: KeyPoseSet) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        save(keyposes, self.path, self.character)
        self._digest = _digest(self._content())
        self._revision += 1

    def _read(self) -> KeyPoseSet:
        return load(self.path, self.character)

    def _content(self) -> bytes | None:
        try:
            return self.path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", path=self.path) from error


def _digest(content: bytes | None) -> str:
    return "" if content is None else hashlib.sha256(content).hexdigest()


def free_name(name: str, taken: set[str]) -> str:
    """The name, or with the first number behind it that is free.

    Args:
        name: what it would be called.
        taken: names that are in use.

    Returns:
        The name to use.
    """
    number, found = 1, name
    while found in taken:
        number += 1
        found = f"{name}-{number}"
    return found
