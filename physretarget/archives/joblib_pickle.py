"""joblib's pickles (PHC, ASAP): arrays stand as raw bytes between the pickle's own.

The same restricted reading as :mod:`physretarget.archives.pickles`, in Python, since the bytes of
an array must be taken out of the stream where its description ends.
"""

from __future__ import annotations

import io
import pickle
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from physretarget.archives.pickles import (
    DAMAGE,
    FORBIDDEN,
    RESTORED,
    admitted_class,
    check_written_out,
    element_count,
    plain_dtype,
)
from physretarget.errors import InputError, UnsafeInputError

MARK = b"joblib.numpy_pickle"
"""Stands in every pickle of joblib's that holds an array."""


class _Wrapper:
    """joblib's description of the array whose bytes follow."""

    def __init__(self) -> None:
        self.state: dict[str, Any] = {}


def unpickle_joblib(content: bytes, *, path: str) -> Any:
    """The plain value of a joblib pickle; no code of the pickle runs.

    Args:
        content: Its bytes, not compressed.
        path: The file's name, for errors.

    Raises:
        UnsafeInputError: It asks for more than arrays and plain containers.
        InputError: It is damaged.
    """
    try:
        value = _Joblib(content, path).load()
        check_written_out(value, len(content), path)
        return value
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError("is not a readable joblib pickle of arrays.", path=path) from error


class _Joblib(pickle._Unpickler):
    """Reads arrays where they stand; every opcode that builds other objects is refused."""

    dispatch: ClassVar[dict[int, Any]] = dict(pickle._Unpickler.dispatch)

    def __init__(self, content: bytes, path: str) -> None:
        self._file, self._size = io.BytesIO(content), len(content)
        super().__init__(self._file)
        self._path = path

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("joblib.numpy_pickle", "NumpyArrayWrapper"):
            return _Wrapper
        return admitted_class(module, name, self._path)

    def _new(self) -> None:
        arguments = self.stack.pop()  # type: ignore[attr-defined]
        if self.stack.pop() is not _Wrapper or arguments != ():  # type: ignore[attr-defined]
            self._refuse("objects")
        self.append(_Wrapper())  # type: ignore[attr-defined]

    def _build(self) -> None:
        state = self.stack.pop()  # type: ignore[attr-defined]
        value = self.stack[-1]  # type: ignore[attr-defined]
        if isinstance(value, _Wrapper) and isinstance(state, dict):
            value.state = state
            self.stack[-1] = self._array(state)  # type: ignore[attr-defined]
        elif isinstance(value, RESTORED):
            value.__setstate__(state)
        else:
            self._refuse("the state of objects")

    def _array(self, state: dict[str, Any]) -> NDArray[Any]:
        shape, dtype = state.get("shape"), plain_dtype(state.get("dtype"))
        if dtype.hasobject:
            self._refuse("an array of objects")
        if state.get("numpy_array_alignment_bytes") is not None:
            self._file.read(self._file.read(1)[0])
        claimed = element_count(shape) * dtype.itemsize
        if claimed > self._size - self._file.tell():
            raise InputError(
                f"an array claims {claimed} bytes {shape}, fewer follow.", path=self._path
            )
        flat = np.frombuffer(self._file.read(claimed), dtype)
        return flat.reshape(shape, order="F" if state.get("order") == "F" else "C")

    def _refuse(self, what: str = "objects") -> None:
        raise UnsafeInputError(
            f"the pickle builds {what}, only arrays and plain containers are admitted; nothing "
            "was run.",
            path=self._path,
        )

    dispatch[pickle.NEWOBJ[0]] = _new
    dispatch[pickle.BUILD[0]] = _build
    for _name in FORBIDDEN - {"NEWOBJ"}:
        dispatch[getattr(pickle, _name)[0]] = _refuse
