"""An uploaded model as files: one XML, or a zip with an MJCF file and its assets."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from physretarget.errors import InputError
from physretarget.sandbox.archive import unpack
from physretarget.sandbox.limits import Limits

_ZIP = b"PK\x03\x04"


def lay_out(upload: Path, name: str, main: str, root: Path, limits: Limits) -> str:
    """Put a model's files below ``root``; returns its MJCF file's place there.

    Args:
        upload: the file that was sent.
        name: what its client called it.
        main: the MJCF file inside a zip, "" to take the only one.
        root: folder to make.
        limits: bounds on archives.

    Raises:
        InputError: there is no MJCF file, or several and none was told.
        UnsafeInputError: the archive is refused.
    """
    root.mkdir()
    with open(upload, "rb") as file:
        packed = file.read(4) == _ZIP
    if not packed:
        if main:
            raise InputError("'main' names a file inside a zip; this is one XML file.")
        shutil.copyfile(upload, root / "model.xml")
        return "model.xml"
    unpack(upload, root, limits)
    found = sorted(p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file())
    return _main(main, found)


def _main(main: str, found: Sequence[str]) -> str:
    if main:
        wanted = PurePosixPath(main).as_posix()
        if wanted not in found:
            raise InputError(f"the zip holds no file {main!r}.")
        return wanted
    xml = [name for name in found if name.lower().endswith((".xml", ".mjcf"))]
    # Included files lie in folders of their own, most often; the model lies on top.
    least = min((name.count("/") for name in xml), default=0)
    top = [name for name in xml if name.count("/") == least]
    if not top:
        raise InputError("the zip holds no .xml file.")
    if len(top) > 1:
        raise InputError(f"the zip holds several models: tell 'main', one of {', '.join(top[:8])}.")
    return top[0]
