"""Styles kept beside their library: learning takes seconds, reading takes none.

A style belongs to a library's content, a frame rate, the programme's prices and this room's source;
where any of them differs it is learned anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from physretarget.errors import InputError
from physretarget.face.library import TORN, Library
from physretarget.face.parts import source_hash
from physretarget.face.programme import ProgrammeSettings
from physretarget.face.style import Style
from physretarget.files import npz_bytes, write_file

_MOST = 12  # styles in one file; the oldest go


@dataclass(frozen=True)
class StyleFile:
    """A file of styles.

    Attributes:
        path: the .npz file; it is made when the first style is learned.
    """

    path: Path

    @classmethod
    def beside(cls, library: Path) -> StyleFile:
        """The file that belongs to a library's file.

        Args:
            library: Where the library is stored.

        Returns:
            The file, ``NAME.styles.npz`` for ``NAME.npz``.
        """
        return cls(library.with_name(f"{library.stem}.styles.npz"))

    def get(
        self,
        library: Library,
        fps: float,
        settings: ProgrammeSettings,
        learn: Callable[[], Style | None],
    ) -> Style | None:
        """The style, from the file or learned now and then kept.

        A folder that cannot be written to is no reason to fail: the style is learned every time.
        """
        told = [library.to_bytes().hex(), fps, asdict(settings), source_hash()]
        name = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:24]
        kept = self._read()
        if name in kept:
            return _style(kept[name])
        made = learn()
        row = np.empty(0) if made is None else _row(made)
        recent = dict(list(kept.items())[1 - _MOST :]) if kept else {}
        # Members are stored by name: a number ahead of it keeps their order.
        stored = {f"{k:03d}_{n}": v for k, (n, v) in enumerate({**recent, name: row}.items())}
        with contextlib.suppress(InputError):
            write_file(self.path, npz_bytes(stored))
        return made

    def _read(self) -> dict[str, np.ndarray]:
        try:
            with np.load(self.path, allow_pickle=False) as archive:
                return {n.partition("_")[2]: archive[n] for n in sorted(archive.files)}
        except (OSError, *TORN):
            return {}  # missing, or torn by an interruption: learned anew


def _row(style: Style) -> np.ndarray:
    return np.concatenate([style.mean, style.scale, style.weight, [style.gain]])


def _style(row: np.ndarray) -> Style | None:
    """The other way; an empty row is a library that teaches nothing."""
    if not len(row):
        return None
    clues = (len(row) - 2) // 3
    mean, scale, weight, gain = np.split(row, [clues, 2 * clues, 3 * clues + 1])
    return Style(mean, scale, weight, float(gain[0]))
