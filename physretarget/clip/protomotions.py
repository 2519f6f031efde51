"""ProtoMotions' .motion: a torch archive of joints and world poses of bodies, read without torch.

The archive is a zip of one pickle and the storages that it names. The pickle may build containers
and tensors of these storages; what else it names (the package's own enumerations) stays a name.
"""

from __future__ import annotations

import io
import math
import pickle
import zipfile
from collections.abc import Sequence
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from physretarget.archives.arrays import MAX_BYTES, ZIP_DAMAGE, Frames, as_floats
from physretarget.archives.pickles import DAMAGE, check_opcodes, check_written_out
from physretarget.clip.raw import Raw, rows_of
from physretarget.errors import InputError, UnsafeInputError

_STORAGES = {
    "FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2", "LongStorage": "<i8",
    "IntStorage": "<i4", "ShortStorage": "<i2", "CharStorage": "i1", "ByteStorage": "u1",
    "BoolStorage": "?",
}  # fmt: skip
_MOST_PICKLE = 1 << 20


def read(file: IO[bytes], *, path: str, sha256: str) -> Raw:
    """Root and joints of a motion; the root is the first body, quaternions are xyzw.

    Args:
        file: The open file.
        path: Its name, for errors.
        sha256: Its hash.

    Raises:
        InputError: It is damaged, or no motion.
        UnsafeInputError: It names what no motion needs.
    """
    value = _load(file, path)
    if not isinstance(value, dict):
        raise InputError(f"the archive holds a {type(value).__name__}, not a dict.", path=path)
    missing = [k for k in ("dof_pos", "rigid_body_pos", "rigid_body_rot") if k not in value]
    if missing:
        has = ", ".join(str(key) for key in list(value)[:8])
        raise InputError(f"a .motion needs '{missing[0]}', this one has {has}.", path=path)
    joints = as_floats(value["dof_pos"], name="dof_pos", ndim=2, path=path)
    place = as_floats(value["rigid_body_pos"], name="rigid_body_pos", ndim=3, path=path)
    turn = as_floats(value["rigid_body_rot"], name="rigid_body_rot", ndim=3, path=path)
    if place.shape[:2] != turn.shape[:2] or len(place) != len(joints) or 0 in place.shape:
        raise InputError(
            f"rigid_body_pos {place.shape}, rigid_body_rot {turn.shape} and dof_pos "
            f"{joints.shape} do not belong together.",
            path=path,
        )
    rate = np.asarray(value.get("fps", np.nan))
    return Raw(
        format="ProtoMotions .motion",
        path=path,
        sha256=sha256,
        rows=rows_of(*(Frames.of(a) for a in (place[:, 0], turn[:, 0], joints))),
        order="xyzw",
        fps=float(rate) if rate.size == 1 and rate.dtype.kind in "iuf" else None,
    )


def _load(file: IO[bytes], path: str) -> Any:
    try:
        archive = zipfile.ZipFile(file)
        entries = {entry.filename: entry for entry in archive.infolist()}
        names = [name for name in entries if name.endswith("/data.pkl")]
        if len(names) != 1:
            raise InputError("is no torch archive: it has no data.pkl.", path=path)
        if sum(entry.file_size for entry in entries.values()) > MAX_BYTES:
            raise UnsafeInputError(f"unpacks to more than {MAX_BYTES} bytes.", path=path)
        if entries[names[0]].file_size > _MOST_PICKLE:
            raise UnsafeInputError("the archive's pickle is larger than a motion's.", path=path)
        folder = names[0].removesuffix("data.pkl")
        program = archive.read(names[0])
        check_opcodes(program, path, admitted=frozenset({"BINPERSID"}))
        value = _Tensors(program, archive, folder, path).load()
        check_written_out(value, len(program), path)
        return value
    except InputError:
        raise
    except (*ZIP_DAMAGE, *DAMAGE) as error:
        raise InputError("is not a readable torch archive.", path=path) from error


class _Name:
    """Stands for a class of the writer's that no motion needs; calling it gives nothing."""

    def __new__(cls, *args: Any) -> Any:
        return None


class _Tensors(pickle.Unpickler):
    """Containers, and tensors as arrays of the archive's storages; nothing else is built."""

    def __init__(self, content: bytes, archive: zipfile.ZipFile, folder: str, path: str) -> None:
        super().__init__(io.BytesIO(content))
        self._archive, self._folder, self._path = archive, folder, path

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _tensor
        if module in ("torch", "torch.storage") and name in _STORAGES:
            return np.dtype(_STORAGES[name])
        if (module, name) == ("collections", "OrderedDict"):
            return dict
        if module.split(".")[0] == "protomotions":
            return _Name
        raise UnsafeInputError(
            f"the archive asks for {module}.{name}, only tensors and plain containers are "
            "admitted; nothing was run.",
            path=self._path,
        )

    def persistent_load(self, pid: Any) -> Any:
        if not (isinstance(pid, tuple) and len(pid) == 5 and pid[0] == "storage"):
            raise UnsafeInputError("the archive refers to outside objects.", path=self._path)
        _, dtype, key, _, count = pid
        if not (isinstance(dtype, np.dtype) and isinstance(key, str) and key.isalnum()):
            raise UnsafeInputError("the archive names a storage that is none.", path=self._path)
        flat = np.frombuffer(self._archive.read(f"{self._folder}data/{key}"), dtype)
        if not isinstance(count, int) or len(flat) < count:
            raise InputError(f"storage {key} is cut off.", path=self._path)
        return flat


def _tensor(
    storage: Any, offset: Any, size: Any, stride: Any, *_: Any
) -> NDArray[np.float64] | NDArray[np.int64]:
    """A view of a storage, refused where it would reach beyond its end or repeat its numbers."""
    whole = (offset, *size, *stride)
    if not isinstance(storage, np.ndarray) or len(size) != len(stride) or len(size) > 8:
        raise pickle.UnpicklingError("a tensor of no storage")
    if not all(isinstance(number, int) and number >= 0 for number in whole):
        raise pickle.UnpicklingError("a tensor with a claim that is no number")
    last = offset + _reach(size, stride)
    if math.prod(size) > len(storage) or (math.prod(size) and last >= len(storage)):
        raise pickle.UnpicklingError("a tensor beyond its storage")
    step = storage.itemsize
    view = np.lib.stride_tricks.as_strided(
        storage[offset:], tuple(size), tuple(step * s for s in stride), writeable=False
    )
    return view.copy()


def _reach(size: Sequence[int], stride: Sequence[int]) -> int:
    return sum((n - 1) * s for n, s in zip(size, stride, strict=True) if n > 0)
