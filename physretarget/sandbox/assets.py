"""Meshes, pictures and height fields of a stranger: do their headers fit the bytes that follow?

MuJoCo's readers are given files only whose claimed sizes are true and bounded. What is inside
the numbers is theirs to judge, in a process that may die of it.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from physretarget.errors import InputError, UnsafeInputError
from physretarget.sandbox.limits import Limits

# Element: endings that its files may have. Others of MuJoCo's formats have not been looked at.
SUFFIXES = {
    "mesh": frozenset((".stl", ".obj", ".msh")),
    "texture": frozenset((".png",)),
    "hfield": frozenset((".png", ".bin", ".hfield")),
    "skin": frozenset((".skn",)),
}
CONTENT_TYPES = {
    ".stl": "model/stl",
    ".obj": "model/obj",
    ".png": "image/png",
    ".msh": "model/vnd.mujoco.msh",
    ".hfield": "image/vnd.mujoco.hfield",
}
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type
_PNG_CHUNKS = 10_000
_LONG_LINE = 1 << 16
_FACE = re.compile(rb"^[ \t]*f[ \t]+(.*)$", re.MULTILINE)


def check_asset(path: Path, element: str, limits: Limits) -> None:
    """Compare a file's header with its size and the limits.

    Raises:
        InputError: it is cut off or not of the kind its name says.
        UnsafeInputError: it claims more than there is, or more than allowed.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES[element]:
        allowed = ", ".join(sorted(SUFFIXES[element]))
        raise UnsafeInputError(f"is no {element} file that is accepted: {allowed} are.", path=path)
    size = path.stat().st_size
    if size > limits.asset_bytes:
        raise UnsafeInputError(
            f"has {size} bytes, at most {limits.asset_bytes} are read.", path=path
        )
    if suffix == ".png":
        _check_png(path, limits)
    elif suffix == ".stl":
        _check_stl(path, size, limits)
    elif suffix == ".obj":
        _check_obj(path, limits)
    elif suffix == ".msh":
        _check_counts(path, size, limits, counts=4, sizes=(12, 12, 8, 12), exact=True)
    elif suffix == ".skn":
        _check_counts(path, size, limits, counts=4, sizes=(12, 8, 12, 56), exact=False)
    else:
        rows, columns = _header(path, "<2i", 8)
        if rows < 1 or columns < 1 or rows * columns > limits.model_numbers:
            raise _claims(path, f"{rows} x {columns} heights")
        _compare(path, 8 + 4 * rows * columns, size, exact=True)


def _header(path: Path, layout: str, length: int) -> tuple[int, ...]:
    with path.open("rb") as file:
        content = file.read(length)
    if len(content) < length:
        raise InputError("is cut off in its header.", path=path)
    return struct.unpack(layout, content)


def _check_counts(
    path: Path, size: int, limits: Limits, *, counts: int, sizes: tuple[int, ...], exact: bool
) -> None:
    """A header of counts, and so many bytes for each thing counted."""
    found = _header(path, f"<{counts}i", 4 * counts)
    if any(not 0 <= n <= limits.mesh_faces for n in found):
        raise _claims(path, f"{', '.join(map(str, found))} vertices, normals or faces")
    claimed = 4 * counts + sum(n * each for n, each in zip(found, sizes, strict=True))
    _compare(path, claimed, size, exact=exact)


def _compare(path: Path, claimed: int, size: int, *, exact: bool) -> None:
    if claimed > size or (exact and claimed != size):
        raise UnsafeInputError(f"claims {claimed} bytes, it has {size}.", path=path)


def _claims(path: Path, what: str) -> UnsafeInputError:
    return UnsafeInputError(f"claims {what}, which is more than is read.", path=path)


def _check_stl(path: Path, size: int, limits: Limits) -> None:
    with path.open("rb") as file:
        head = file.read(84)
    if len(head) < 84:
        raise InputError("is cut off in its header.", path=path)
    faces = int.from_bytes(head[80:84], "little")
    if 84 + 50 * faces != size and head.lstrip()[:5].lower() == b"solid":
        raise InputError("is an STL file in text form, MuJoCo reads the binary form.", path=path)
    if faces > limits.mesh_faces:
        raise _claims(path, f"{faces} triangles")
    _compare(path, 84 + 50 * faces, size, exact=True)


def _check_obj(path: Path, limits: Limits) -> None:
    content = path.read_bytes()
    if b"\0" in content:
        raise InputError("is no OBJ file: it holds NUL bytes.", path=path)
    if any(len(line) > _LONG_LINE for line in content.splitlines()):
        raise UnsafeInputError(f"has a line of more than {_LONG_LINE} bytes.", path=path)
    counts = [
        sum(1 for _ in re.finditer(rb"^[ \t]*" + what + rb"[ \t]", content, re.MULTILINE))
        for what in (b"v", b"vt", b"vn", b"f")
    ]
    if max(counts) > limits.mesh_faces:
        raise _claims(path, f"{max(counts)} vertices or faces")
    for face in _FACE.finditer(content):
        for corner in face.group(1).split():
            for index, count in zip(corner.split(b"/"), counts, strict=False):
                number = _index(index)
                if number is not None and not 1 <= abs(number) <= count:
                    line = content.count(b"\n", 0, face.start()) + 1
                    raise UnsafeInputError(
                        f"a face refers to number {number} of {count}.", path=path, line=line
                    )


def _index(text: bytes) -> int | None:
    if not text:
        return None
    try:
        return int(text) if len(text) < 12 else 2**40
    except ValueError:
        return None  # not a number: for MuJoCo to refuse


def _check_png(path: Path, limits: Limits) -> None:
    content = path.read_bytes()
    if content[:8] != _PNG or content[12:16] != b"IHDR" or len(content) < 33:
        raise InputError("is no PNG picture.", path=path)
    width, height, depth, colour = struct.unpack(">IIBB", content[16:26])
    if width < 1 or height < 1 or width * height > limits.asset_pixels:
        raise _claims(path, f"{width} x {height} pixels")
    channels = _PNG_CHANNELS.get(colour)
    if channels is None or depth not in (1, 2, 4, 8, 16):
        raise InputError("is a PNG picture of an unknown kind.", path=path)
    # Interlaced pictures have seven smaller ones, each with rows of its own: at most twice.
    most = 2 * height * (1 + math.ceil(width * channels * depth / 8)) + 4096
    inflater = zlib.decompressobj()
    found = 0
    for chunk in _image_data(content, path):
        while chunk and not inflater.eof:
            try:
                found += len(inflater.decompress(chunk, 1 << 20))
            except zlib.error as error:
                raise InputError("is a damaged PNG picture.", path=path) from error
            chunk = inflater.unconsumed_tail
            if found > most:
                raise UnsafeInputError(
                    f"unpacks to more than its {width} x {height} pixels take.", path=path
                )


def _image_data(content: bytes, path: Path) -> Iterator[bytes]:
    at = 8
    for _ in range(_PNG_CHUNKS):
        if at + 12 > len(content):
            raise InputError("is a PNG picture that is cut off.", path=path)
        length = int.from_bytes(content[at : at + 4], "big")
        kind = content[at + 4 : at + 8]
        if at + 12 + length > len(content):
            raise UnsafeInputError("has a PNG chunk that claims more than there is.", path=path)
        if kind == b"IDAT":
            yield content[at + 8 : at + 8 + length]
        elif kind in (b"zTXt", b"iTXt", b"iCCP") and length > 1 << 20:
            raise UnsafeInputError("has packed notes of more than a megabyte.", path=path)
        if kind == b"IEND":
            return
        at += 12 + length
    raise UnsafeInputError(f"has more than {_PNG_CHUNKS} PNG chunks.", path=path)
