"""Running a task on a stranger's files in a process of its own that can reach nothing else.

The child has bounded memory, processor time, wall clock and files (:class:`Limits`); the
kernel keeps it from every other file, from the network, and from other processes
(:mod:`physretarget.sandbox.confine`). It dies with the server. It may be taken over by what it
reads, so nothing that it says is believed: its lines are bounded, and files that it left are to
be opened with :func:`open_result`.

:func:`run` starts an interpreter for every task; :class:`Pool` forks a warm one, which saves
the second that the imports take.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal, Protocol

from physretarget.errors import PhysretargetError
from physretarget.sandbox.inside import LINE_BYTES
from physretarget.sandbox.limits import Limits

Kind = Literal["input", "timeout", "memory", "crash", "cancelled"]
Progress = Callable[[float, str], None]
Cancelled = Callable[[], bool]

TASKS = frozenset(
    {
        f"physretarget.service.tasks:{name}"
        for name in ("validate", "retarget", "check_model", "check_clip")
    }
    | {
        f"physretarget.sandbox.trials:{name}"
        for name in ("nothing", "reach", "read", "hold", "burn", "wait", "fill", "fail", "flood")
    }
)
LOST = "lost"  # ``error`` of a job whose starter died under it
GONE = -1000  # the return code of such a job
_TAIL = 16 * 1024  # of standard output and error, for the log
_LOOK_S = 0.1  # between two looks at the clock and at whether the job was cancelled
_WEIGH_S = 1.0  # between two looks at what the folder holds
_BLOCK = 4096
_KEPT = ("LD_LIBRARY_PATH", "TZ", "SYSTEMROOT")
_START = (
    "import sys; sys.path[:] = sys.argv[3].split(':'); "
    "from physretarget.sandbox.{module} import main; main(int(sys.argv[1]), int(sys.argv[2]))"
)


class ChildError(PhysretargetError):
    """A task failed.

    Attributes:
        kind: ``input`` the files cannot be used; ``timeout`` wall clock or processor time;
            ``memory``; ``crash`` the process ended without an answer, or with one that is
            none, or the task has a fault; ``cancelled``.
        message: one sentence for the person who sent the files; names no path of the server.
        error: class of the error in the child, "" where there was none.
        log: what the child wrote to standard output and error, its end; not for strangers.
    """

    def __init__(
        self, kind: Kind, message: str, *, error: str = "", log: str = "",
        line: int | None = None, frame: int | None = None,
    ) -> None:  # fmt: skip
        super().__init__(message)
        self.kind: Kind = kind
        self.message = message
        self.error = error
        self.log = log
        self.line = line
        self.frame = frame


@dataclass(frozen=True, kw_only=True)
class Process:
    """A started child: its two pipes, and how to end it."""

    messages: int
    log: int
    kill: Callable[[], None]
    wait: Callable[[], int]  # return code as of subprocess: negative for a signal


class Starter(Protocol):
    """Starts a child with a request on its standard input."""

    def __call__(self, request: bytes) -> Process:
        """The started child."""


def run(
    task: str,
    request: Mapping[str, Any],
    *,
    folder: Path,
    limits: Limits,
    inputs: Sequence[Path] = (),
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    start: Starter | None = None,
) -> dict[str, Any]:
    """Run a task of :data:`TASKS` and return its answer.

    Args:
        task: ``module:function``; the function is called with the request, the folder, and a
            function for progress, and returns plain data.
        request: plain data.
        folder: the only place where the child may write, and its working directory.
        limits: bounds on the child.
        inputs: files and folders that the child may read besides.
        progress: called with a fraction in [0, 1] and a stage.
        cancelled: asked ten times a second whether to stop.
        start: how to start the child; a :class:`Pool`'s by default of its own ``run``.

    Raises:
        ChildError: the task failed; says how.
    """
    if task not in TASKS:
        raise ValueError(f"{task!r} is no task of the sandbox")
    content = json.dumps(
        {
            "task": task,
            "request": dict(request),
            "folder": str(folder.resolve(strict=True)),
            "inputs": [str(path.resolve(strict=True)) for path in inputs],
            "limits": limits.to_dict(),
        }
    ).encode()
    if len(content) > limits.request_bytes:
        raise ChildError("input", f"the request is longer than {limits.request_bytes} bytes.")
    process = (start or _spawn)(content)
    watch = _Watch(process, folder, limits, progress, cancelled)
    try:
        ended = watch.follow()
    finally:
        process.kill()
        code = process.wait()
        watch.drain()
        os.close(process.messages)
        os.close(process.log)
    if ended is not None:
        raise ChildError(ended[0], ended[1], log=watch.tail)
    return _answer(watch, code)


def open_result(folder: Path, name: str, *, limits: Limits) -> BinaryIO:
    """Open a file that a child left, which may have tried to leave something else.

    Raises:
        ChildError: it is no regular file directly in the folder, or larger than allowed.
    """
    refused = ChildError("crash", f"the job left no usable {name}.")
    if Path(name).name != name:
        raise refused
    try:
        handle = os.open(folder / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise refused from error
    about = os.fstat(handle)
    # A second name of a file elsewhere would have a second link.
    if not stat.S_ISREG(about.st_mode) or about.st_nlink != 1 or about.st_size > limits.file_bytes:
        os.close(handle)
        raise refused
    return os.fdopen(handle, "rb")


# ---- the parent's watch --------------------------------------------------------------------------


class _Watch:
    """Reads a child's two pipes until it ends or has to be ended."""

    def __init__(
        self, process: Process, folder: Path, limits: Limits,
        progress: Progress | None, cancelled: Cancelled | None,
    ) -> None:  # fmt: skip
        self._process = process
        self._folder = folder
        self._limits = limits
        self._progress = progress
        self._cancelled = cancelled
        self._log = b""
        self._line = b""
        self._received = self._printed = 0
        self.last: dict[str, Any] = {}

    @property
    def tail(self) -> str:
        """The end of what the child printed."""
        return self._log.decode("utf-8", "replace")

    def follow(self) -> tuple[Kind, str] | None:
        """Until both pipes are closed: None, or why the child has to be ended."""
        began = weighed = time.monotonic()
        open_pipes = {self._process.messages: self._message, self._process.log: self._print}
        with selectors.DefaultSelector() as selector:
            for handle in open_pipes:
                os.set_blocking(handle, False)
                selector.register(handle, selectors.EVENT_READ)
            while open_pipes:
                for key, _ in selector.select(_LOOK_S):
                    content = os.read(key.fd, 65536)
                    if not content:
                        selector.unregister(key.fd)
                        del open_pipes[key.fd]
                        if key.fd == self._process.messages:
                            return None  # it has nothing more to say
                    elif not open_pipes[key.fd](content):
                        return "crash", "the job sent more than it may."
                now = time.monotonic()
                if self._cancelled is not None and self._cancelled():
                    return "cancelled", "the job was cancelled."
                if now - began > self._limits.seconds:
                    return "timeout", f"the job took longer than {self._limits.seconds:g} s."
                if now - weighed > _WEIGH_S:
                    weighed = now
                    if weight(self._folder) > self._limits.folder_bytes:
                        return "crash", "the job wrote more than it may."
        return None

    def drain(self) -> None:
        """Take in what the child printed last; it has ended."""
        with suppress(BlockingIOError):  # nothing there, and the pipe still held by someone
            self._print(os.read(self._process.log, 65536))

    def _print(self, content: bytes) -> bool:
        self._printed += len(content)
        self._log = (self._log + content)[-_TAIL:]
        return self._printed <= self._limits.answer_bytes

    def _message(self, content: bytes) -> bool:
        """Take in whole lines; False when there is too much."""
        self._received += len(content)
        if self._received > self._limits.answer_bytes:
            return False
        *lines, self._line = (self._line + content).split(b"\n")
        for line in lines:
            self._take(line)
        return True

    def _take(self, line: bytes) -> None:
        try:
            value = json.loads(line, parse_constant=_no_number)
        except (ValueError, RecursionError):
            return
        if not isinstance(value, dict):
            return
        if "progress" not in value:
            self.last = value
            return
        fraction, stage = value["progress"], value.get("stage")
        if len(line) > LINE_BYTES or not isinstance(fraction, int | float):
            return
        if self._progress is not None and isinstance(stage, str) and 0 <= fraction <= 1:
            self._progress(float(fraction), printable(stage, 200))


def _no_number(word: str) -> None:
    raise ValueError(f"{word} is not JSON")


def printable(text: str, most: int) -> str:
    """Text of a child as one short line."""
    return "".join(c if c.isprintable() else " " for c in text[:most])


def weight(folder: Path) -> int:
    """Bytes of all files below a folder, links not followed; an empty one takes a block too."""
    total = 0
    waiting = [os.fspath(folder)]
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
                    else:
                        total += entry.stat(follow_symlinks=False).st_size
                    total += _BLOCK
        except OSError:
            continue  # it went away meanwhile
    return total


def _answer(watch: _Watch, code: int) -> dict[str, Any]:
    told = watch.last
    answer = told.get("answer")
    if isinstance(answer, dict):
        return answer
    kind, message = told.get("failed"), told.get("message")
    if kind in ("input", "memory", "crash") and isinstance(message, str):
        line, frame = told.get("line"), told.get("frame")
        raise ChildError(
            kind,
            printable(message, 2000),
            error=printable(str(told.get("error", "")), 80),
            log=watch.tail,
            line=line if isinstance(line, int) else None,
            frame=frame if isinstance(frame, int) else None,
        )
    raise _died(code, watch.tail)


def lost(log: str) -> ChildError:
    """The error of a job whose starter died under it."""
    return ChildError("crash", "the sandbox ended under the job.", error=LOST, log=log)


def _died(code: int, log: str) -> ChildError:
    """What the status of a child tells that ended without an answer."""
    if code == GONE:
        return lost(log)
    if code == -signal.SIGXCPU:
        return ChildError("timeout", "the job took more processor time than it may.", log=log)
    words = log[-2000:].lower()
    if any(word in words for word in ("bad_alloc", "memoryerror", "cannot allocate", "out of mem")):
        return ChildError("memory", "the job needs more memory than it may have.", log=log)
    if code == -signal.SIGXFSZ:
        return ChildError("crash", "the job wrote more than it may.", log=log)
    how = f"by signal {-code}" if code < 0 else f"with status {code}"
    return ChildError("crash", f"the job's process ended {how} without an answer.", log=log)


# ---- starting ------------------------------------------------------------------------------------


def environment() -> dict[str, str]:
    """What a child knows of the server's environment: no secrets, one thread, no display."""
    kept = {name: os.environ[name] for name in _KEPT if name in os.environ}
    threads = dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
    )
    return {
        **kept,
        **threads,
        "PATH": "/usr/bin:/bin",
        "LANG": "C.UTF-8",
        "MUJOCO_GL": "disable",
        "MPLBACKEND": "agg",
        "MALLOC_ARENA_MAX": "2",
    }


def command(module: str, *numbers: int) -> list[str]:
    """An isolated interpreter that runs ``main(*numbers)`` of a module of the sandbox."""
    path = ":".join(p for p in sys.path if os.path.isabs(p))
    return [sys.executable, "-I", "-c", _START.format(module=module), *map(str, numbers), path]


def _spawn(request: bytes) -> Process:
    read, write = os.pipe()
    try:
        child = subprocess.Popen(
            command("inside", write, os.getpid()),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment(),
            pass_fds=(write,),
            start_new_session=True,
        )
    finally:
        os.close(write)
    assert child.stdin is not None
    assert child.stdout is not None
    log = os.dup(child.stdout.fileno())
    child.stdout.close()
    # One that died already cannot take it; its status will say how.
    with suppress(BrokenPipeError), child.stdin as pipe:
        pipe.write(request)

    def kill() -> None:
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGKILL)

    return Process(messages=read, log=log, kill=kill, wait=child.wait)
