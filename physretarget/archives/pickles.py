"""A pickle reader that admits NumPy arrays and plain containers, and runs nothing.

A pickle is a program. This one may build dicts, lists, tuples, sets, text, numbers and
arrays; any other name it asks for ends the reading before anything is called.
"""

from __future__ import annotations

import io
import math
import pickle
import pickletools
from collections.abc import Callable
from typing import Any

import numpy as np

from physretarget.errors import InputError, UnsafeInputError

_ARRAY_MODULES = ("numpy.core.multiarray", "numpy._core.multiarray")
_BUFFER_MODULES = ("numpy.core.numeric", "numpy._core.numeric")
# Objects by persistent id, by extension registry, or built through a class: never needed.
_DEPTH = 64  # of containers in containers; NumPy has arrays of 64 dimensions at most
FORBIDDEN = {"PERSID", "BINPERSID", "EXT1", "EXT2", "EXT4", "INST", "OBJ", "NEWOBJ", "NEWOBJ_EX"}


DAMAGE = (
    pickle.UnpicklingError, ValueError, TypeError, EOFError, KeyError, IndexError, AttributeError,
    ImportError, MemoryError, RecursionError, OverflowError, SystemError, UnicodeError,
)  # fmt: skip
"""What damaged pickles raise."""


class _NdarrayName:
    """Stands for numpy.ndarray, so that a pickle can name the class but not call it."""


class _Dtype:
    """A data type under construction; NumPy's own restoring trusts its input, and crashes."""

    def __init__(self, code: str) -> None:
        self.value = np.dtype(code)

    def __setstate__(self, state: Any) -> None:
        """Take the byte order alone: plain types have nothing else to restore."""
        order = state[1] if isinstance(state, tuple) and len(state) >= 5 else None
        if order not in ("<", ">", "|", "=") or any(part is not None for part in state[2:5]):
            raise pickle.UnpicklingError("a data type that is no plain one")
        if order in ("<", ">"):
            self.value = self.value.newbyteorder(order)


class _Array(np.ndarray[Any, Any]):
    """An array under construction."""

    def __setstate__(self, state: Any) -> None:
        """Take shape, type and data that fit together, and nothing else."""
        if not isinstance(state, tuple) or len(state) != 5:
            raise pickle.UnpicklingError("an array of an unknown version")
        _, shape, dtype, fortran, data = state
        kind = plain_dtype(dtype)
        count = element_count(shape)
        if kind.hasobject:
            fits = isinstance(data, list) and len(data) == count
        else:
            fits = isinstance(data, bytes) and len(data) == count * kind.itemsize
        if not fits:
            raise pickle.UnpicklingError("an array whose data do not fill its shape")
        given: Any = (1, shape, kind, bool(fortran), data)  # NumPy's stubs want their own bool
        super().__setstate__(given)


def plain_dtype(value: Any) -> np.dtype[Any]:
    """The data type that a pickle has restored."""
    if not isinstance(value, _Dtype):
        raise pickle.UnpicklingError("something else than a data type")
    return value.value


def element_count(shape: Any) -> int:
    """Elements of a shape of plain numbers."""
    sound = isinstance(shape, tuple) and len(shape) <= _DEPTH
    if not sound or not all(isinstance(n, int) and n >= 0 for n in shape):
        raise pickle.UnpicklingError("a shape that is none")
    return math.prod(shape)


RESTORED = (_Dtype, _Array)
"""What a pickle may give a state to."""


def _reconstruct(kind: Any, shape: Any, code: Any) -> np.ndarray[Any, Any]:
    # NumPy pickles always start from an empty array; a large shape here is an attack.
    if kind is not _NdarrayName or shape != (0,):
        raise pickle.UnpicklingError("an array starts from something else than nothing")
    return _Array((0,), "b")


def _frombuffer(buffer: Any, dtype: Any, shape: Any, order: str) -> np.ndarray[Any, Any]:
    kind = plain_dtype(dtype)
    if kind.hasobject:
        raise pickle.UnpicklingError("a buffer of objects")
    element_count(shape)
    return np.frombuffer(buffer, dtype=kind).reshape(shape, order="F" if order == "F" else "C")


def _scalar(dtype: Any, data: Any) -> Any:
    kind = plain_dtype(dtype)
    if kind.hasobject or not isinstance(data, bytes):
        raise pickle.UnpicklingError("a scalar that is none")
    return np.frombuffer(data, dtype=kind, count=1)[0]


def _dtype(code: Any, align: Any = False, copy: Any = False) -> _Dtype:
    if not isinstance(code, str) or len(code) > 16:
        raise pickle.UnpicklingError("a data type that is no plain one")
    return _Dtype(code)


def _encode(text: Any, encoding: Any) -> bytes:
    # Protocol 2 writes bytes as latin-1 text.
    if not isinstance(text, str) or encoding != "latin1":
        raise pickle.UnpicklingError("text in an unknown coding")
    return text.encode("latin1")


class _Restricted(pickle.Unpickler):
    def __init__(self, content: bytes, path: str) -> None:
        super().__init__(io.BytesIO(content))
        self._path = path

    def find_class(self, module: str, name: str) -> Any:
        return admitted_class(module, name, self._path)

    def persistent_load(self, pid: Any) -> Any:
        raise UnsafeInputError("the pickle refers to outside objects.", path=self._path)


def admitted_class(module: str, name: str, path: str) -> Any:
    """What stands for a name that a pickle asks for.

    Raises:
        UnsafeInputError: The name is none of arrays and plain containers.
    """
    known: dict[tuple[str, str], Any] = {
        ("numpy", "ndarray"): _NdarrayName,
        ("numpy", "dtype"): _dtype,
        ("_codecs", "encode"): _encode,
        ("builtins", "bytes"): _empty_bytes,
    }
    known |= {(m, "_reconstruct"): _reconstruct for m in _ARRAY_MODULES}
    known |= {(m, "scalar"): _scalar for m in _ARRAY_MODULES}
    known |= {(m, "_frombuffer"): _frombuffer for m in _BUFFER_MODULES}
    found: Callable[..., Any] | None = known.get((module, name))
    if found is None:
        raise UnsafeInputError(
            f"the pickle asks for {module}.{name}, only NumPy arrays and plain containers "
            "are admitted; nothing was run.",
            path=path,
        )
    return found


def _empty_bytes(*args: Any) -> bytes:
    if args:
        raise pickle.UnpicklingError("bytes built by a call")
    return b""


def unpickle(content: bytes, *, path: str) -> Any:
    """The plain value that a pickle holds, or an error; no code of the pickle runs.

    The stream is walked once beforehand, so that claimed lengths and memo slots beyond the
    file cannot make the reader allocate.
    """
    check_opcodes(content, path)
    try:
        value = _Restricted(content, path).load()
        check_written_out(value, len(content), path)
        return value
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError("is not a readable pickle of arrays.", path=path) from error


def check_opcodes(content: bytes, path: str, admitted: frozenset[str] = frozenset()) -> None:
    """Walk a pickle without running it.

    Args:
        content: Its bytes.
        path: The file's name, for errors.
        admitted: Opcodes that are allowed although they are forbidden elsewhere.

    Raises:
        UnsafeInputError: It builds objects, or claims absurd memory.
        InputError: It is damaged.
    """
    count = 0
    try:
        for opcode, argument, _ in pickletools.genops(content):
            count += 1
            if opcode.name in FORBIDDEN - admitted:
                raise UnsafeInputError(
                    f"the pickle builds objects ({opcode.name}), only NumPy arrays and plain "
                    "containers are admitted; nothing was run.",
                    path=path,
                )
            slot = int(argument or 0) if opcode.name in ("PUT", "BINPUT", "LONG_BINPUT") else 0
            if slot > count + 256:
                raise UnsafeInputError("the pickle claims an absurd memo slot.", path=path)
    except UnsafeInputError:
        raise
    except (ValueError, TypeError, EOFError, IndexError, UnicodeError, OverflowError) as error:
        raise InputError("is not a readable pickle: cut off or damaged.", path=path) from error


def check_written_out(value: Any, length: int, path: str) -> None:
    """Refuse lists that name each other again and again: sixty of them make 2^60 elements.

    Whoever makes an array of such a list, or prints it, writes it out.
    """
    most = 16 * length + 1000
    size: dict[int, int] = {}  # of each container, by identity; 0 while it is being looked at
    waiting: list[tuple[Any, int, bool]] = [(value, 0, False)]
    while waiting:
        each, depth, inside_done = waiting.pop()
        if not isinstance(each, list | tuple | dict | set | frozenset):
            continue
        parts = [*each, *each.values()] if isinstance(each, dict) else list(each)
        if inside_done:
            size[id(each)] = 1 + sum(size.get(id(part), 1) for part in parts)
            if size[id(each)] > most:
                raise UnsafeInputError("the pickle writes out to far more than it is.", path=path)
        elif id(each) not in size:
            size[id(each)] = 0
            if depth > _DEPTH:
                raise UnsafeInputError(f"the pickle nests deeper than {_DEPTH}.", path=path)
            waiting.append((each, depth, True))
            waiting += [(part, depth + 1, False) for part in parts]
        elif size[id(each)] == 0:
            raise UnsafeInputError("the pickle holds a container that holds itself.", path=path)
