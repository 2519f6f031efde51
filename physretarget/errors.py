"""The one error tree.

::

    PhysretargetError            everything raised on purpose; exit code 2
    ├── InputError               a file or an array cannot be used: says which, where and why
    │   └── UnsafeInputError     refused because it could execute, escape or exhaust something
    ├── UsageError               an argument, option or combination that makes no sense
    ├── MissingExtraError        an optional dependency is not installed: says which extra
    └── SolverError              a numerical solver gave no usable answer

Every message is one sentence that says what was given and what is allowed.
"""

from __future__ import annotations

from os import PathLike, fspath

__all__ = [
    "InputError",
    "MissingExtraError",
    "PhysretargetError",
    "SolverError",
    "UnsafeInputError",
    "UsageError",
]


class PhysretargetError(Exception):
    """Base of every error that this package raises on purpose."""

    exit_code = 2


class InputError(PhysretargetError):
    """Input that cannot be used.

    The text reads ``path:line: message`` or ``path, frame N: message`` so that the
    place can be found (frames count from 0).
    """

    def __init__(
        self,
        message: str,
        *,
        path: str | PathLike[str] | None = None,
        line: int | None = None,
        frame: int | None = None,
    ) -> None:
        self.message = message
        self.path = None if path is None else fspath(path)
        self.line = line
        self.frame = frame
        super().__init__(message)

    def __str__(self) -> str:
        where = self.path or ""
        if self.line is not None:
            where += f":{self.line}" if where else f"line {self.line}"
        if self.frame is not None:
            where += f", frame {self.frame}" if where else f"frame {self.frame}"
        return f"{where}: {self.message}" if where else self.message


class UnsafeInputError(InputError):
    """Input refused because reading it could execute, escape or exhaust something."""


class UsageError(PhysretargetError):
    """An argument, option or combination of them that makes no sense."""


class MissingExtraError(PhysretargetError):
    """An optional dependency is missing."""

    def __init__(self, package: str, *, extra: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs {package}, which is not installed: "
            f"run pip install 'physretarget[{extra}]'."
        )


class SolverError(PhysretargetError):
    """A numerical solver gave no usable answer."""
