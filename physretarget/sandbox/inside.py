"""The child's side: give up everything, then run one task and answer.

Runs as ``python -I -c`` (one task) or as a fork of :mod:`physretarget.sandbox.warm`. Nothing
heavy is imported before the limits stand.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from physretarget.errors import InputError, PhysretargetError
from physretarget.sandbox import confine
from physretarget.sandbox.limits import Limits

Progress = Callable[[float, str], None]
LINE_BYTES = 4096  # of progress; the answer has its own limit
_PAUSE_S = 0.05  # between two lines of progress, so that a busy loop cannot flood the parent


def main(messages: int, parent: int) -> None:
    """Read a request from standard input, answer on the descriptor ``messages``, and end."""
    confine.die_with_parent(parent)
    serve(sys.stdin.fileno(), messages)


def serve(request: int, messages: int) -> None:
    """Confine this process, do what the request says, and end the process."""
    os.umask(0o077)
    with os.fdopen(request, "rb", closefd=False) as file:
        asked: dict[str, Any] = json.load(file)
    with open(os.devnull, "rb") as empty:
        os.dup2(empty.fileno(), request)
    limits = Limits.from_dict(asked["limits"])
    folder = Path(asked["folder"])
    inputs = [Path(p) for p in asked["inputs"]]
    os.chdir(folder)
    # A warm process may have chosen another place for passing files before.
    os.environ["TMPDIR"] = os.environ["HOME"] = tempfile.tempdir = str(folder)
    confine.set_limits(limits)
    confine.drop_privileges()
    confine.restrict_files([*confine.system_paths(), *inputs], [folder, Path(os.devnull)])
    confine.restrict_calls()
    _answer(messages, _outcome(asked, folder, _Teller(messages)), limits)
    sys.stdout.flush()
    sys.stderr.flush()
    # Threads and exit handlers of libraries have nothing more to say.
    os._exit(0)


class _Teller:
    """Sends progress, not more often than anyone can look at it."""

    def __init__(self, messages: int) -> None:
        self._messages = messages
        self._last = 0.0

    def __call__(self, fraction: float, stage: str) -> None:
        now = time.monotonic()
        if now - self._last < _PAUSE_S:
            return
        self._last = now
        line = json.dumps({"progress": float(fraction), "stage": str(stage)[:200]})
        _send(self._messages, line.encode()[: LINE_BYTES - 1] + b"\n")


def _outcome(asked: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """What the task returned, or how it failed."""
    try:
        module, _, name = str(asked["task"]).partition(":")
        task = getattr(importlib.import_module(module), name)
        return {"answer": task(asked["request"], folder, progress)}
    except PhysretargetError as error:
        return _failed("input", _without_folders(str(error), asked), error)
    except MemoryError as error:
        return _failed("memory", "the job needs more memory than it may have.", error)
    except Exception as error:
        traceback.print_exc()
        text = f"the job ended with a fault of its own: {type(error).__name__}."
        # MuJoCo says it in words, and so do readers that met the limit on files.
        if any(word in str(error).lower() for word in ("allocate", "bad_alloc", "out of memory")):
            return _failed("memory", "the job needs more memory than it may have.", error)
        return _failed("crash", text, error)


def _failed(kind: str, message: str, error: BaseException) -> dict[str, Any]:
    known = error if isinstance(error, InputError) else None
    return {
        "failed": kind,
        "message": "".join(c if c.isprintable() else " " for c in message)[:2000],
        "error": type(error).__name__,
        "line": known.line if known else None,
        "frame": known.frame if known else None,
    }


def _without_folders(text: str, asked: Mapping[str, Any]) -> str:
    """Names of files as the stranger gave them: where the server keeps them is not told."""
    told = [*asked["inputs"]]
    for value in asked["request"].values():
        told += [v for v in (value if isinstance(value, list) else [value]) if isinstance(v, str)]
    places = {os.path.dirname(path) for path in told if path.startswith("/")}
    for place in sorted((*places, str(asked["folder"]), *asked["inputs"]), key=len, reverse=True):
        if place != "/":
            text = text.replace(f"{place}/", "")
    return text


def _answer(messages: int, outcome: Mapping[str, Any], limits: Limits) -> None:
    try:
        line = json.dumps(outcome, allow_nan=False).encode()
    except (TypeError, ValueError, RecursionError) as error:
        traceback.print_exc()
        line = json.dumps(_failed("crash", "the job's answer is no plain data.", error)).encode()
    if len(line) >= limits.answer_bytes // 2:
        refused = ValueError("too long")
        line = json.dumps(_failed("crash", "the job's answer is too long.", refused)).encode()
    _send(messages, line + b"\n")


def _send(messages: int, line: bytes) -> None:
    while line:
        line = line[os.write(messages, line) :]
