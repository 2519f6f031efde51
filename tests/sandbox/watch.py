"""Whether anything in a folder was opened."""

from __future__ import annotations

import ctypes
import os
import struct
from pathlib import Path


class Watch:
    """Tells whether anything in a folder was opened, by inotify."""

    def __init__(self, folder: Path) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        self.handle = libc.inotify_init1(os.O_NONBLOCK)
        opened, read, written, made = 0x20, 0x1, 0x2, 0x100
        mask = opened | read | written | made
        assert libc.inotify_add_watch(self.handle, os.fsencode(folder), mask) >= 0

    def close(self) -> None:
        os.close(self.handle)

    def seen(self) -> list[str]:
        try:
            content = os.read(self.handle, 65536)
        except BlockingIOError:
            return []
        names = []
        while content:
            (length,) = struct.unpack("I", content[12:16])
            names.append(content[16 : 16 + length].rstrip(b"\0").decode())
            content = content[16 + length :]
        return names
