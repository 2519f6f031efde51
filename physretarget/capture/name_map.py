"""A user's own map of names: which joint or marker of a file is which part of the body.

    [joints]                      # a skeleton's: part = the file's joint
    left_shank = "Bone_017"
    [markers]                     # optical markers: landmark = the file's label
    left_knee_lateral = "M07"
    ignore = ["M21", "M22"]       # labels that are of no use

What is named here gets the name by which the readers know the part; what would be taken for it
otherwise loses its own. Everything else is recognised as always.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from physretarget.capture.marker_sets import known_landmarks
from physretarget.capture.marker_sets import recognise as recognise_markers
from physretarget.capture.names import ROLES, recognise
from physretarget.errors import InputError

__all__ = ["NameMap", "load_map"]

_MOST_BYTES = 2**20


@dataclass(frozen=True, kw_only=True)
class NameMap:
    """Parts of the body and what a file calls them.

    Attributes:
        joints: role of a joint (``left_shank``) → name in the file.
        markers: landmark (``left knee_lateral``) → label in the file.
        ignored: labels that are not used.
        path: the file that it was read from, for messages.
    """

    joints: Mapping[str, str] = field(default_factory=dict)
    markers: Mapping[str, str] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()
    path: str | None = None

    def of_joints(self, names: Sequence[str], parents: Sequence[int]) -> tuple[str, ...]:
        """Names of joints as the readers know them.

        Args:
            names: The file's.
            parents: Of each joint, -1 for a root.

        Returns:
            As many names.

        Raises:
            InputError: a joint is not in the file, or cannot be that part where it hangs.
        """
        found = list(names)
        place = {role: self._place(name, names, "joint") for role, name in self.joints.items()}
        for role, at in place.items():
            found[at] = role
        for _ in names:
            roles = recognise(found, parents).roles
            wrong = [r for r, at in place.items() if roles.get(r) != at]
            rivals = {roles[r] for r in wrong if r in roles} - set(place.values())
            if not wrong:
                return tuple(found)
            if not rivals:
                break
            for at in rivals:
                found[at] = f"{names[at]}_helper"
        role = wrong[0]
        raise InputError(
            f"joint {names[place[role]]!r} cannot be the {role.replace('_', ' ')}: it does not "
            "hang below the part above it",
            path=self.path,
        )

    def of_markers(self, labels: Sequence[str]) -> tuple[str, ...]:
        """Labels as the readers know them; ignored ones and rivals get names without a meaning.

        Args:
            labels: The file's.

        Returns:
            As many labels.

        Raises:
            InputError: a label is not in the file.
        """
        found = list(labels)
        for label in self.ignored:
            at = self._place(label, labels, "marker")
            found[at] = f"unused {at}"
        mine = {self._place(label, labels, "marker"): part for part, label in self.markers.items()}
        if mine:
            for at, mark in enumerate(recognise_markers(found)):
                if mark is not None and at not in mine and mark.name in mine.values():
                    found[at] = f"unused {at}"
        for at, part in mine.items():
            found[at] = _label_of()[part]
        return tuple(found)

    def _place(self, name: str, names: Sequence[str], what: str) -> int:
        if name in names:
            return names.index(name)
        raise InputError(
            f"{what} {name!r} is not in the capture, which has {_some(names, name)}", path=self.path
        )


def load_map(path: str | Path) -> NameMap:
    """Read a map of names.

    Args:
        path: A TOML file with the tables ``joints`` and ``markers``.

    Returns:
        The map.

    Raises:
        InputError: it cannot be read, or names a part that there is not.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError("is larger than any map of names.", path=path)
        told = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}.", path=path) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"is no TOML: {error}", path=path) from error
    if unknown := sorted(told.keys() - {"joints", "markers"}):
        raise InputError(
            f"has a table {unknown[0]!r}; there are [joints] and [markers].", path=path
        )
    marked = _table(told, "markers", path)
    ignored = marked.pop("ignore", [])
    if not isinstance(ignored, list) or not all(isinstance(each, str) for each in ignored):
        raise InputError("markers.ignore must be a list of labels.", path=path)
    landmarks = {mark.replace(" ", "_"): mark for mark in _label_of()}
    joints = _checked(_table(told, "joints", path), ROLES, "joints", path)
    markers = _checked(marked, landmarks, "markers", path)
    return NameMap(
        joints=joints, markers={landmarks[part]: label for part, label in markers.items()},
        ignored=tuple(ignored), path=str(path),
    )  # fmt: skip


def _table(told: Mapping[str, object], name: str, path: Path) -> dict[str, object]:
    found = told.get(name, {})
    if not isinstance(found, dict):
        raise InputError(f"[{name}] must be a table.", path=path)
    return dict(found)


def _checked(
    table: Mapping[str, object], parts: Iterable[str], name: str, path: Path
) -> dict[str, str]:
    known = list(parts)
    found: dict[str, str] = {}
    for part, label in table.items():
        if part not in known:
            raise InputError(
                f"{name}.{part} is no part of the body; there are {_some(known, part)}", path=path
            )
        if not isinstance(label, str) or not label:
            raise InputError(f"{name}.{part} must be a name in quotes.", path=path)
        if label in found.values():
            other = next(each for each, taken in found.items() if taken == label)
            raise InputError(
                f"{label!r} is given as {name}.{other} and as {name}.{part}.", path=path
            )
        found[part] = label
    return found


def _some(known: Sequence[str], like: str) -> str:
    """The names that are most like one, first, and how many there are."""
    near = difflib.get_close_matches(like, known, n=5, cutoff=0.3)
    shown = [*near, *(name for name in known if name not in near)][:8]
    rest = len(known) - len(shown)
    return ", ".join(shown) + (f" and {rest} others." if rest > 0 else ".")


@cache
def _label_of() -> dict[str, str]:
    """Landmark → a label that means it."""
    return known_landmarks()
