"""A process that has imported everything already and forks one confined child per job.

The child's side of :class:`physretarget.sandbox.pool.Pool`. It never sees a stranger's file
itself: it imports, waits, and forks. It has one thread only, so that a fork copies no lock that
is held; a module that starts threads when imported is refused.

One connection serves for starting: each start brings four descriptors, the request, the pipe
for messages, the log, and a socket of this job alone. Whatever comes over that socket, its end
included, ends the job; when the job has ended its status goes back over it. The server's death
closes all sockets, so nothing outlives it.
"""

from __future__ import annotations

import fcntl
import gc
import importlib
import json
import os
import selectors
import signal
import socket
import sys
import traceback

from physretarget.sandbox import confine, inside

READY = b"ready"
_MESSAGES = 3  # the child's descriptor after standard input, output and error


def main(control: int, parent: int) -> None:
    """Serve starts that come over the socket ``control`` until it closes."""
    del parent  # its end closes the socket; a signal would come when one of its threads ends
    with socket.socket(fileno=control) as server:
        wanted: list[str] = json.loads(server.recv(65536))
        for name in wanted:
            importlib.import_module(name)
        threads = len(os.listdir("/proc/self/task"))
        if threads != 1:
            sys.exit(f"importing {', '.join(wanted)} started {threads - 1} threads")
        gc.collect()
        gc.freeze()  # so that children share the memory of what is imported
        server.send(READY)
        _Jobs(server).serve()


class _Jobs:
    """The running children, by the descriptor that tells of their end."""

    def __init__(self, server: socket.socket) -> None:
        self._server = server
        self._selector = selectors.DefaultSelector()
        self._selector.register(server, selectors.EVENT_READ)

    def serve(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if key.fileobj is self._server:
                    if not self._accept():
                        return
                elif isinstance(key.fileobj, socket.socket):
                    self._kill(key.fileobj, key.data)
                else:
                    self._reap(key.fd, *key.data)

    def _accept(self) -> bool:
        """Fork for one start; False when the server is gone."""
        content, handles, _, _ = socket.recv_fds(self._server, 16, 4)
        if not content:
            return False
        request, messages, log, line = handles
        pid = os.fork()
        if pid == 0:
            _child(request, messages, log)
        for handle in (request, messages, log):
            os.close(handle)
        job = socket.socket(fileno=line)
        job.setblocking(False)
        self._selector.register(job, selectors.EVENT_READ, pid)
        self._selector.register(os.pidfd_open(pid), selectors.EVENT_READ, (pid, job))
        return True

    def _kill(self, job: socket.socket, pid: int) -> None:
        if job.fileno() < 0:
            return  # reaped a moment ago, in the same round; the number may be another's now
        self._selector.unregister(job)
        os.kill(pid, signal.SIGKILL)

    def _reap(self, handle: int, pid: int, job: socket.socket) -> None:
        self._selector.unregister(handle)
        os.close(handle)
        _, status = os.waitpid(pid, 0)
        if job in self._selector.get_map():
            self._selector.unregister(job)
        with job:
            try:
                job.send(str(os.waitstatus_to_exitcode(status)).encode())
            except OSError:
                return  # nobody waits for it any more


def _child(request: int, messages: int, log: int) -> None:
    """Never returns: keeps its own descriptors only, and does the job."""
    try:
        confine.die_with_parent(os.getppid())
        os.setsid()
        # Away from the low numbers first, which may be among those that are given out.
        handles = [fcntl.fcntl(h, fcntl.F_DUPFD, 64) for h in (request, log, log, messages)]
        for number, handle in enumerate(handles):
            os.dup2(handle, number)
        os.closerange(_MESSAGES + 1, 4096)
        inside.serve(0, _MESSAGES)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)
