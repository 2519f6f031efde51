"""The models that come with the package, with their key poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import physretarget
from physretarget.errors import InputError

NAMES = ("lamp", "penguin", "squirrel")


@dataclass(frozen=True, kw_only=True)
class Builtin:
    """A model of the package; its name is its id."""

    name: str
    path: Path
    keyposes: Path


def builtins() -> dict[str, Builtin]:
    """The built-in models by name.

    Raises:
        InputError: the installation is damaged.
    """
    package = Path(physretarget.__file__).resolve().parent
    for folder in (package / "models", package.parent / "models"):
        if all((folder / f"{name}.xml").is_file() for name in NAMES):
            return {
                name: Builtin(
                    name=name, path=folder / f"{name}.xml",
                    keyposes=folder / f"{name}.keyposes.toml",
                )
                for name in NAMES
            }  # fmt: skip
    raise InputError("the built-in models are missing: the installation is damaged.", path=package)
