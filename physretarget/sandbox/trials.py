"""Tasks that try what a job must not do: for tests, and for a server that checks its own walls.

Each is a task of :mod:`physretarget.sandbox.child` and tells how far it came.
"""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from physretarget.errors import InputError

Progress = Callable[[float, str], None]


def nothing(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Send the request back."""
    progress(0.5, "half")
    return {"request": dict(request)}


def read(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """The content of the file ``path``."""
    return {"content": Path(request["path"]).read_text()}


def reach(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Try to get out in every known way: what happened, by the name of the attempt."""
    return {name: _tried(attempt) for name, attempt in _attempts(request, folder).items()}


def _attempts(request: Mapping[str, Any], folder: Path) -> dict[str, Callable[[], object]]:
    outside = Path(request["outside"])  # an existing file of the same user
    server = int(request["server"])
    return {
        "read": outside.read_bytes,
        "read by link": lambda: _link(outside, folder / "link").read_bytes(),
        "hard link": lambda: os.link(outside, folder / "hard"),
        "list": lambda: os.listdir(outside.parent),
        "write": lambda: outside.write_text("changed"),
        "truncate": lambda: os.truncate(outside, 0),
        "create": lambda: (outside.parent / "new").write_text("new"),
        "remove": outside.unlink,
        "rename": lambda: os.rename(outside, folder / "moved"),
        "mode": lambda: os.chmod(outside, 0o777),
        "touch": lambda: os.utime(outside),
        "environment": Path(f"/proc/{server}/environ").read_bytes,
        "memory": lambda: open(f"/proc/{server}/mem", "rb").close(),
        "signal": lambda: os.kill(server, 0),
        "trace": lambda: _call("ptrace", 16, server, 0, 0),
        "fork": lambda: os.waitpid(os.fork() or os._exit(0), 0),
        "program": lambda: subprocess.run(["/bin/true"], check=True),
        "replace": lambda: os.execv("/bin/true", ["true"]),
        "internet": lambda: socket.socket(socket.AF_INET, socket.SOCK_STREAM),
        "datagram": lambda: socket.socket(socket.AF_INET6, socket.SOCK_DGRAM),
        "local socket": lambda: socket.socket(socket.AF_UNIX),
        "memory file": lambda: os.memfd_create("x"),
        "device": lambda: os.mknod(folder / "device", 0o20666, os.makedev(1, 1)),
        "pipe": lambda: os.mkfifo(folder / "pipe"),
        "root": lambda: os.chroot(folder),
        "session": lambda: _call("unshare", 0x10000000),
        "more memory": _more_memory,
        "others' limits": lambda: _call("prlimit", server, 7, bytes(16), None),
    }


def _tried(attempt: Callable[[], object]) -> str:
    try:
        attempt()
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        return f"refused: {error.__class__.__name__}"
    return "reached"


def _link(target: Path, link: Path) -> Path:
    link.symlink_to(target)
    return link


def _call(name: str, *values: object) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    if getattr(library, name)(*values) != 0:
        raise OSError(ctypes.get_errno(), name)


def _more_memory() -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))


def hold(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Take memory until there is none."""
    held = []
    while True:
        held.append(bytearray(16 * 2**20))


def burn(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Use the processor for ever."""
    while True:
        pass


def wait(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Do nothing, for ``seconds``."""
    progress(0.0, "waiting")
    (folder / "pid").write_text(str(os.getpid()))
    time.sleep(request["seconds"])
    return {}


def fill(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Write ``files`` files of ``bytes`` bytes each."""
    for index in range(request["files"]):
        with (folder / f"{index}.bin").open("wb") as file:
            file.truncate(request["bytes"])
        time.sleep(0.05)
    return {}


def flood(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Write to the descriptors from ``first`` to ``last`` that are open, without end."""
    lines = b'{"progress": 0.5, "stage": "' + b"x" * 60_000 + b'"}\n'
    while True:
        for handle in range(request["first"], request["last"] + 1):
            try:
                os.write(handle, lines)
            except OSError:
                continue


def fail(request: Mapping[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """End in the way ``how``."""
    how = request["how"]
    if how == "input":
        raise InputError("no good.", path=folder / "clip.npz", frame=3)
    if how == "bug":
        raise KeyError("a bug")
    if how == "answer":
        return {"answer": object()}
    if how == "number":
        return {"answer": float("nan")}
    if how == "long":
        return {"answer": "x" * request["bytes"]}
    if how == "exit":
        os._exit(3)
    if how == "print":
        print("word " * 100_000)
        os._exit(4)
    signal.raise_signal(signal.Signals[how])
    return {}
