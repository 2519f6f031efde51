"""Starting children from a warm process: :func:`~physretarget.sandbox.child.run` without the wait.

Importing MuJoCo, SciPy and the rest takes a second; here it is done once.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from physretarget.errors import PhysretargetError
from physretarget.sandbox import child
from physretarget.sandbox.child import Cancelled, Process, Progress
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.warm import READY

MODULES = ("physretarget.service.tasks", "physretarget.sandbox.trials")
_START_S = 120.0
_LAST_WORDS_S = 2.0


class Pool:
    """One warm process from which jobs are forked; may be used by many threads at once.

    It is started at the first job, or by :meth:`start`, and again if it should die; jobs that
    were running then are done again, once.

    Args:
        modules: what it imports, with everything that a task imports late.
    """

    def __init__(self, modules: Sequence[str] = MODULES) -> None:
        self._modules = tuple(modules)
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None

    def run(
        self,
        task: str,
        request: Mapping[str, Any],
        *,
        folder: Path,
        limits: Limits,
        inputs: Sequence[Path] = (),
        progress: Progress | None = None,
        cancelled: Cancelled | None = None,
    ) -> dict[str, Any]:
        """As :func:`physretarget.sandbox.child.run`.

        Raises:
            ChildError: the task failed; says how.
            PhysretargetError: the warm process cannot be started.
        """
        run = partial(
            child.run, task, request, folder=folder, limits=limits, inputs=inputs,
            progress=progress, cancelled=cancelled, start=self._fork,
        )  # fmt: skip
        try:
            return run()
        except child.ChildError as error:
            if error.error != child.LOST:
                raise
        self._bury()
        return run()  # the warm process died under it, which says nothing about the job

    def start(self) -> None:
        """Start the warm process now, and wait until it is ready.

        Raises:
            PhysretargetError: it does not start; tells what it said.
        """
        with self._lock:
            self._ready()

    def close(self) -> None:
        """End the warm process and all its jobs."""
        with self._lock:
            self._end()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _ready(self) -> socket.socket:
        if self._control is not None and self._process is not None:
            if self._process.poll() is None:
                return self._control
            self._end()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                child.command("warm", theirs.fileno(), os.getpid()),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                env=child.environment(),
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
            )
        self._control = ours
        ours.send(json.dumps(self._modules).encode())
        ours.settimeout(_START_S)
        with suppress(TimeoutError, ConnectionError):
            if ours.recv(16) == READY:
                ours.settimeout(None)
                return ours
        raise PhysretargetError(f"the sandbox cannot be started: {self._last_words()}.")

    def _last_words(self) -> str:
        assert self._process is not None
        with suppress(subprocess.TimeoutExpired):  # it hung up, and is about to say why
            self._process.wait(_LAST_WORDS_S)
        self._process.kill()
        _, said = self._process.communicate()
        lines = [line for line in said.decode("utf-8", "replace").splitlines() if line.strip()]
        self._end()
        return lines[-1][:300] if lines else "it ended without a word"

    def _end(self) -> None:
        if self._control is not None:
            self._control.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            if self._process.stderr is not None:
                self._process.stderr.close()
        self._control = self._process = None

    def _bury(self) -> None:
        """Clear away a warm process that is dying, so that the next job starts another."""
        with self._lock, suppress(subprocess.TimeoutExpired):
            if self._process is not None:
                self._process.wait(_LAST_WORDS_S)
                self._end()

    def _fork(self, request: bytes) -> Process:
        asked, request_end = os.pipe()
        messages, messages_end = os.pipe()
        log, log_end = os.pipe()
        line, line_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        theirs = [asked, messages_end, log_end, line_end.fileno()]
        try:
            with self._lock:
                control = self._ready()
                socket.send_fds(control, [b"start"], theirs)
        except OSError as error:
            line.close()
            for handle in (request_end, messages, log):
                os.close(handle)
            raise child.lost("") from error
        finally:
            for handle in theirs[:3]:
                os.close(handle)
            line_end.close()
        _write(request_end, request)
        return Process(
            messages=messages, log=log, kill=lambda: _hang_up(line), wait=lambda: _status(line)
        )


def _write(handle: int, content: bytes) -> None:
    # One that died already cannot take it; its status will say how.
    with suppress(BrokenPipeError), os.fdopen(handle, "wb") as pipe:
        pipe.write(content)


def _hang_up(line: socket.socket) -> None:
    with suppress(OSError):  # the other end is gone, and with it the job
        line.shutdown(socket.SHUT_WR)


def _status(line: socket.socket) -> int:
    """The job's return code, ``GONE`` when the warm process went away first."""
    with line, suppress(OSError):
        said = line.recv(16)
        return int(said) if said else child.GONE
    return child.GONE
