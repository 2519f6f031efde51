"""The character's file, which the studio changes only where points are placed on it."""

from __future__ import annotations

from pathlib import Path

import physretarget
from physretarget.errors import InputError, UsageError
from physretarget.files import beside
from physretarget.mjcf import Character

__all__ = ["ModelFile"]

# What lies here came with the package, or with its repository.
_INSTALLED = Path(physretarget.__file__).resolve().parent
_SHIPPED = (_INSTALLED / "models", _INSTALLED.parent / "models")


class ModelFile:
    """A character and its MJCF.

    Attributes:
        character: as the file stood when it was read or written last.
    """

    def __init__(self, character: Character) -> None:
        self.character = character

    def text(self) -> str:
        """What the file holds now.

        Returns:
            The MJCF.

        Raises:
            UsageError: the character is one of the package's, or in no file.
            InputError: it cannot be read.
        """
        path = self.character.path
        if path is None or set(_SHIPPED) & set(path.resolve().parents):
            raise UsageError(
                f"{self.character.name!r} is not in a file of yours: copy its MJCF and open the "
                "studio with the copy."
            )
        try:
            return path.read_bytes().decode("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"cannot be read as text: {error}", path=path) from error

    def write(self, text: str) -> None:
        """Write the file, unless MuJoCo refuses it, and go on with the character that it holds.

        Args:
            text: the MJCF.

        Raises:
            InputError: MuJoCo cannot build it, or it cannot be written.
            UsageError: its joints are others than before.
        """
        path = self.character.path
        assert path is not None
        with beside(path, suffix=path.suffix) as file:
            file.write_bytes(text.encode())
            if Character.load(file).joint_names != self.character.joint_names:
                raise UsageError("the joints of the character's file have changed: start again.")
        self.character = Character.load(path)
