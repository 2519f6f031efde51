"""What stands in for the performances of Yamane 2010: which captures, styles and characters."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

from physretarget.errors import InputError

CHARACTERS = ("lamp", "penguin", "squirrel")
STYLES = ("angry", "happy", "sad", "tired", "not-confident", "normal")
ACTIONS = ("bow", "bye", "guide", "run", "walk")
DANCES = ("dance_a", "dance_b")

PAPER_TABLE_1: dict[str, dict[str, tuple[float, int]]] = {
    "anger": {"lamp": (18.6, 16), "penguin": (14.3, 3), "squirrel": (22.9, 14)},
    "disgust": {"lamp": (34.4, 1), "penguin": (23.3, 7), "squirrel": (20.0, 3)},
    "fear": {"lamp": (29.7, 2), "penguin": (25.2, 4), "squirrel": (28.5, 18)},
    "happiness": {"lamp": (20.1, 7), "penguin": (23.7, 11), "squirrel": (25.8, 9)},
    "sadness": {"lamp": (19.5, 3), "penguin": (29.6, 4), "squirrel": (26.7, 3)},
    "surprise": {"lamp": (10.7, 1), "penguin": (26.1, 4), "squirrel": (19.2, 5)},
}
"""Yamane 2010, Table 1: seconds and key poses per emotion and character."""
PAPER_SECONDS = 418.0
PAPER_COMPUTING_SECONDS = 70 * 60.0


@dataclass(frozen=True, kw_only=True)
class Take:
    """One capture on one character; ``style`` is ``dance`` for the dances."""

    character: str
    style: str
    action: str
    capture: Path

    @property
    def name(self) -> str:
        """A path of names: character, style, action."""
        return f"{self.character}/{self.style}/{self.action}"


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Everything that a run does: takes, and where the characters are."""

    takes: tuple[Take, ...]
    models: Path
    dances: bool
    notes: tuple[str, ...] = ()

    @property
    def characters(self) -> tuple[str, ...]:
        """The characters that occur, in the paper's order."""
        found = {take.character for take in self.takes}
        return tuple(name for name in CHARACTERS if name in found)

    def captures(self) -> tuple[Take, ...]:
        """The takes of the first character: every capture once."""
        return tuple(take for take in self.takes if take.character == self.characters[0])


def keypose_files(models: Path, character: str) -> list[Path]:
    """All key pose files of a character."""
    return sorted(models.glob(f"{character}*.keyposes.toml"))


def make_plan(
    data: str | Path,
    models: Path,
    *,
    characters: tuple[str, ...] = CHARACTERS,
    actions: tuple[str, ...] = ACTIONS,
    dances: bool = True,
) -> Plan:
    """Find the captures under the folder ``data``: six styles, five actions, and dances.

    Raises:
        InputError: the Bandai captures are not there.
    """
    data = Path(data)
    folders = [f for f in (data / "bvh" / "bandai", data / "bandai", data) if _captures(f)]
    if not folders:
        raise InputError(
            "no captures named dataset-1_ACTION_STYLE_001.bvh are in bvh/bandai of this folder "
            "(Bandai Namco Research Motiondataset-1).",
            path=data,
        )
    notes = []
    missing = []
    takes = []
    for character in characters:
        for style in STYLES:
            for action in actions:
                path = folders[0] / f"dataset-1_{action}_{style}_001.bvh"
                if path.is_file():
                    takes.append(
                        Take(character=character, style=style, action=action, capture=path)
                    )
                elif character == characters[0]:
                    missing.append(path.name)
    if missing:
        notes.append(f"Not in the data folder, so not shown: {', '.join(missing)}.")
    folder = _pybullet_motions() if dances else None
    if folder is not None:
        takes += [
            Take(
                character=character,
                style="dance",
                action=name,
                capture=folder / f"humanoid3d_{name}.txt",
            )
            for character in characters
            for name in DANCES
        ]
    elif dances:
        notes.append(
            "The dances are left out: their captures come with the package pybullet, which is "
            "not installed (pip install 'physretarget[demo]')."
        )
    return Plan(takes=tuple(takes), models=models, dances=folder is not None, notes=tuple(notes))


def _captures(folder: Path) -> bool:
    return any(folder.glob("dataset-1_*.bvh"))


def _pybullet_motions() -> Path | None:
    """Where the ``pybullet`` wheel keeps its captures; None where it is not installed."""
    found = importlib.util.find_spec("pybullet_data")
    folder = Path(found.origin).parent / "data" / "motions" if found and found.origin else None
    return folder if folder is not None and folder.is_dir() else None
