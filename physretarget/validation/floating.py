"""Clips of models whose root is free in pieces, or fixed where it only stands: judged as free."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from physretarget.clip import Motion
from physretarget.mjcf import Character
from physretarget.mjcf.free_root import FreeRoot, free_root
from physretarget.validation.continuity import Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lifted(Motion):
    """A motion of another model, given in coordinates of one with a free root."""

    of: Motion
    root: FreeRoot

    @property
    def nq(self) -> int:
        """Coordinates per frame."""
        return int(self.root.character.tree.nq)

    def between(self, first: int, last: int) -> Floats:
        """(last - first, nq) poses of the frames first to last - 1."""
        return self.root.lift(self.of.between(first, last))


def with_free_root(
    clip: Motion, character: Character, *, stands: bool
) -> tuple[Motion, Character, bool]:
    """Clip and character as they can be judged, and whether a fixed base was set free.

    ``stands`` says that a model fixed to the world only stands on its floor. Raises InputError
    where such a model has no base.
    """
    root = free_root(character, stands=stands)
    if root is None:
        return clip, character, False
    told = {f.name: getattr(clip, f.name) for f in fields(Motion)}
    lifted = _Lifted(of=clip, root=root, **told)
    names = tuple(root.character.joint_names)
    return replace(lifted, joint_names=names), root.character, root.body == 0
