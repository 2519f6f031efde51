"""Unpacking a stranger's zip: plain files and folders only, counted while they are written.

Python's ``zipfile`` finds the members and inflates them. It believes what the archive says of
itself, so everything that it would believe is looked at first: the end record before it reads
the directory, each member's local header against the directory, and that no two members share
bytes (which is how a small archive holds terabytes without being nested).
"""

from __future__ import annotations

import os
import shutil
import stat
import struct
import unicodedata
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from physretarget.errors import InputError, UnsafeInputError
from physretarget.sandbox.limits import MIB, Limits

_LOCAL, _END, _END64 = b"PK\x03\x04", b"PK\x05\x06", b"PK\x06\x07"
_ENCRYPTED = 0x1 | 0x40 | 0x2000  # also strong encryption, and names masked by it
_STREAMED = 0x8  # sizes follow the data instead of standing before it
_DESCRIPTOR = 24  # bytes after the data of a streamed member, at most
_REPARSE = 0x400  # Windows' own kind of link
_CHUNK = 1 << 16
# A picture of one colour, a height field of zeros: small things may shrink as they like.
_FREE_RATIO_BYTES = 4 * MIB
_ARCHIVES = frozenset((".zip", ".gz", ".tgz", ".bz2", ".xz", ".7z", ".rar", ".tar", ".zst", ".jar"))
# Names that mean devices, or lose their last character, where the files may be taken next.
_DEVICES = frozenset(
    {"con", "prn", "aux", "nul"} | {f"{port}{n}" for port in ("com", "lpt") for n in range(10)}
)


@dataclass(frozen=True)
class _Member:
    entry: zipfile.ZipInfo
    name: str
    folder: bool
    start: int  # of its local header
    end: int  # of its data


def unpack(archive: Path, into: Path, limits: Limits) -> tuple[Path, ...]:
    """Unpack a zip file into a folder that is made, or is empty.

    Returns the files, sorted. When anything is refused nothing stays in the folder.

    Raises:
        InputError: it is no readable zip file, or damaged.
        UnsafeInputError: it tries to escape, to hide something, or to exhaust the disk; names
            the member.
    """
    try:
        with archive.open("rb") as file:
            members = _members(file, archive, limits)
            into.mkdir(parents=True, exist_ok=True)
            if any(into.iterdir()):
                raise ValueError(f"{into} is not empty")
            try:
                return _write_all(file, members, into, archive, limits)
            except BaseException:
                shutil.rmtree(into)
                raise
    except OSError as error:
        raise InputError(f"cannot be unpacked: {error.strerror or error}.", path=archive) from error


# ---- what the archive claims ---------------------------------------------------------------------


def _members(file: BinaryIO, path: Path, limits: Limits) -> list[_Member]:
    directory = _directory(file, path, limits)
    try:
        with zipfile.ZipFile(file) as archive:
            entries = archive.infolist()
    except (zipfile.BadZipFile, NotImplementedError, ValueError, struct.error, EOFError) as error:
        raise InputError("is no readable zip file.", path=path) from error
    if not entries:
        raise InputError("the archive is empty.", path=path)
    members = [_member(file, entry, path, limits) for entry in entries]
    _check_places(members, directory, path)
    _check_names(members, path)
    _check_sizes(members, path, limits)
    return members


def _directory(file: BinaryIO, path: Path, limits: Limits) -> int:
    """Where the directory begins; the archive must be all of the file, of one disk, bounded."""
    size = file.seek(0, os.SEEK_END)
    if size > limits.upload_bytes:
        raise _refuse(path, f"has {size} bytes, at most {limits.upload_bytes} are read")
    if size < 22:
        raise InputError("is no zip file: too short.", path=path)
    tail = min(size, 22 + 0xFFFF + 20)
    file.seek(size - tail)
    content = file.read(tail)
    at = content.rfind(_END)
    # Its comment reaches to the end of the file, and holds no other end: readers differ there.
    if at < 0 or at + 22 + int.from_bytes(content[at + 20 : at + 22], "little") != len(content):
        raise InputError("is no zip file, or has something after its end.", path=path)
    if content[max(0, at - 20) : at].startswith(_END64):
        raise _refuse(path, "is a zip64 archive, nothing that is accepted needs one")
    disk, first_disk, here, entries, length, offset = struct.unpack(
        "<HHHHII", content[at + 4 : at + 20]
    )
    if disk or first_disk or here != entries:
        raise InputError("is one part of a zip file in several.", path=path)
    if entries > limits.archive_files:
        raise _refuse(path, f"has {entries} members, at most {limits.archive_files} are unpacked")
    # Each takes 46 bytes and its name; extra fields and comments are small in honest archives.
    if length > entries * (46 + limits.name_bytes + 1024):
        raise _refuse(path, f"has a directory of {length} bytes for {entries} members")
    if offset + length != size - tail + at:
        raise _refuse(path, "has something before or after it, or its directory lies elsewhere")
    return int(offset)


def _member(file: BinaryIO, entry: zipfile.ZipInfo, path: Path, limits: Limits) -> _Member:
    # The name as written: ``filename`` has been cut at a NUL already.
    name = entry.orig_filename
    shown = printable(name)
    if entry.flag_bits & _ENCRYPTED:
        raise _refuse(path, f"member {shown} is encrypted")
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise _refuse(path, f"member {shown} is compressed by method {entry.compress_type}")
    file.seek(entry.header_offset)
    head = file.read(30)
    if len(head) < 30 or head[:4] != _LOCAL:
        raise InputError(f"member {shown} is not where the directory says.", path=path)
    flags, method = struct.unpack("<HH", head[6:10])
    crc, packed, unpacked, name_length, extra = struct.unpack("<IIIHH", head[14:30])
    local_name = file.read(name_length)
    coding = "utf-8" if entry.flag_bits & 0x800 else "cp437"
    same = local_name == name.encode(coding, "replace")
    same &= (flags, method) == (entry.flag_bits, entry.compress_type)
    if not flags & _STREAMED:
        same &= (crc, packed, unpacked) == (entry.CRC, entry.compress_size, entry.file_size)
    if not same:
        raise _refuse(path, f"member {shown} says one thing in the directory, another before it")
    folder = name.endswith("/")
    _check_kind(entry, folder, shown, path)
    _check_name(name, folder, path, limits)
    data = entry.header_offset + 30 + name_length + extra
    return _Member(entry, name, folder, entry.header_offset, data + entry.compress_size)


def _check_kind(entry: zipfile.ZipInfo, folder: bool, shown: str, path: Path) -> None:
    kind = stat.S_IFMT(entry.external_attr >> 16)
    if kind not in (0, stat.S_IFREG, stat.S_IFDIR) or entry.external_attr & _REPARSE:
        what = "a symbolic link" if kind == stat.S_IFLNK else "neither a file nor a folder"
        raise _refuse(path, f"member {shown} is {what}")
    if (kind == stat.S_IFDIR and not folder) or (kind == stat.S_IFREG and folder):
        raise _refuse(path, f"member {shown} is a folder by one sign, a file by another")
    if folder and entry.file_size:
        raise _refuse(path, f"folder {shown} has content")


def _check_name(name: str, folder: bool, path: Path, limits: Limits) -> None:
    shown = printable(name)
    if any(unicodedata.category(c)[0] == "C" for c in name):
        raise _refuse(path, f"member {shown} has control characters in its name")
    if name.startswith("/") or "\\" in name or ":" in name:
        raise _refuse(path, f"member {shown} has an absolute path, a drive letter or a backslash")
    parts = name.rstrip("/").split("/") if folder else name.split("/")
    if any(part in ("", ".", "..") for part in parts):
        raise _refuse(path, f"member {shown} leads out of the archive, or to no place in it")
    if any(part[-1] in ". " or part.split(".")[0].lower() in _DEVICES for part in parts):
        raise _refuse(path, f"member {shown} has a name that not every system can keep")
    if len(name.encode()) > limits.name_bytes or len(parts) > limits.name_depth:
        raise _refuse(path, f"member {shown} has too long a name, or lies too deep")
    if not folder and PurePosixPath(name).suffix.lower() in _ARCHIVES:
        raise _refuse(path, f"member {shown} is an archive itself")


def _check_places(members: list[_Member], directory: int, path: Path) -> None:
    """Members lie one after the other from the first byte to the directory, sharing nothing."""
    ordered = sorted(members, key=lambda m: m.start)
    if ordered[0].start != 0:
        raise _refuse(path, "has something before its first member")
    last = 0
    for member in ordered:
        shown = printable(member.name)
        if member.start < last:
            raise _refuse(path, f"member {shown} overlaps another")
        if member.start > last + _DESCRIPTOR:
            raise _refuse(path, f"has {member.start - last} hidden bytes before member {shown}")
        last = member.end
    if not last <= directory <= last + _DESCRIPTOR:
        raise _refuse(path, "has hidden bytes before its directory, or data reaching into it")


def _check_names(members: list[_Member], path: Path) -> None:
    """No two members may be one file, or one a file and a folder, on any file system."""
    files: set[str] = set()
    folders: dict[str, str] = {}
    for member in members:
        spelled = PurePosixPath(member.name)
        inside = [*spelled.parents][:-1] + ([spelled] if member.folder else [])
        for folder in inside:
            if folders.setdefault(_same(str(folder)), str(folder)) != str(folder):
                raise _refuse(path, f"has folder {printable(str(folder))} in two spellings")
        if not member.folder:
            if _same(member.name) in files:
                raise _refuse(path, f"has member {printable(member.name)} twice")
            files.add(_same(member.name))
    for name in sorted(files & set(folders)):
        raise _refuse(path, f"has {printable(name)} as a file and as a folder")


def _same(name: str) -> str:
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())


def _check_sizes(members: list[_Member], path: Path, limits: Limits) -> None:
    total = sum(m.entry.file_size for m in members)
    if total > limits.archive_bytes:
        raise _refuse(
            path, f"unpacks to {total} bytes, at most {limits.archive_bytes} are unpacked"
        )
    for member in members:
        size, packed = member.entry.file_size, member.entry.compress_size
        if size > _FREE_RATIO_BYTES and size > limits.archive_ratio * packed:
            raise _refuse(
                path,
                f"member {printable(member.name)} unpacks {packed} bytes to {size}, "
                f"at most {limits.archive_ratio} times as much is believed",
            )
    packed = sum(m.entry.compress_size for m in members)
    if total > _FREE_RATIO_BYTES and total > limits.archive_ratio * max(packed, 1):
        raise _refuse(path, f"unpacks {packed} bytes to {total}")


# ---- writing -------------------------------------------------------------------------------------


def _write_all(
    file: BinaryIO, members: list[_Member], into: Path, path: Path, limits: Limits
) -> tuple[Path, ...]:
    written: list[Path] = []
    left = limits.archive_bytes
    with zipfile.ZipFile(file) as archive:
        for member in members:
            target = into.joinpath(*member.name.rstrip("/").split("/"))
            (target if member.folder else target.parent).mkdir(parents=True, exist_ok=True)
            if not member.folder:
                left -= _write(archive, member, target, path, left)
                written.append(target)
    return tuple(sorted(written))


def _write(archive: zipfile.ZipFile, member: _Member, target: Path, path: Path, most: int) -> int:
    """Write one file and return its size; believes no claim of it."""
    shown = printable(member.name)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    size = 0
    try:
        with (
            archive.open(member.entry) as source,
            os.fdopen(os.open(target, flags, 0o600), "wb") as sink,
        ):
            while chunk := source.read(_CHUNK):
                size += len(chunk)
                if size > min(most, member.entry.file_size):
                    raise _refuse(path, f"member {shown} unpacks to more than it claims")
                sink.write(chunk)
    except (zipfile.BadZipFile, EOFError, NotImplementedError, RuntimeError, zlib.error) as error:
        raise InputError(f"member {shown} is damaged.", path=path) from error
    if size != member.entry.file_size:
        raise _refuse(path, f"member {shown} unpacks to {size} bytes, it claims another size")
    return size


def printable(name: str) -> str:
    """A name as it may stand in a message: short, quoted, on one line."""
    return repr(name if len(name) <= 80 else name[:77] + "...")


def _refuse(path: Path, what: str) -> UnsafeInputError:
    return UnsafeInputError(f"{what}.", path=path)
