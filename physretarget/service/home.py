"""The data folder: who it is, what lies where, one server at a time."""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
from pathlib import Path

from physretarget.errors import InputError, UsageError
from physretarget.files import write_file


class Home:
    """A service's data folder.

    ``history.db`` unless the history is elsewhere, ``blobs/<sha256>`` uploads, ``models/<id>/``
    unpacked models, ``jobs/<id>/`` results, ``incoming/`` what is not whole yet.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(os.path.abspath(folder))
        self.blobs = self.folder / "blobs"
        self.models = self.folder / "models"
        self.jobs = self.folder / "jobs"
        self.incoming = self.folder / "incoming"
        self._lock: int | None = None
        try:
            for each in (self.blobs, self.models, self.jobs, self.incoming):
                each.mkdir(parents=True, exist_ok=True, mode=0o700)
            (probe := self.incoming / f".probe-{os.getpid()}").touch()
            probe.unlink()
        except OSError as error:
            raise InputError(
                f"cannot be written to: {error.strerror}.", path=self.folder
            ) from error
        self.id = self._identity()

    def _identity(self) -> str:
        place = self.folder / "id"
        if not place.exists():
            write_file(place, f"{secrets.token_hex(16)}\n".encode())
        found = place.read_text("ascii", errors="replace").strip()
        if not re.fullmatch(r"[0-9a-f]{32}", found):
            raise InputError("does not hold the folder's id, 32 hexadecimal digits.", path=place)
        return found

    def lock(self) -> None:
        """Hold the folder until the process ends.

        Raises:
            UsageError: another server holds it.
        """
        handle = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(handle)
            raise UsageError(f"{self.folder} is in use by another server.") from error
        self._lock = handle

    def unlock(self) -> None:
        """Let go of the folder."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def sweep(self) -> None:
        """Remove what a server that died left unfinished; for who holds the folder."""
        for left in self.incoming.iterdir():
            remove(left)
        for job in self.jobs.iterdir():
            for left in job.glob(".work-*"):
                remove(left)

    @property
    def history(self) -> str:
        """URL of the database in this folder."""
        return f"sqlite:///{self.folder / 'history.db'}"

    def blob(self, sha256: str) -> Path:
        """Where an upload of that content lies."""
        return self.blobs / sha256

    def job(self, id: str) -> Path:
        """A job's folder."""
        return self.jobs / id


def remove(path: Path) -> None:
    """Remove a file or a folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
