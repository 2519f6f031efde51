"""Looking at uploads before they are accepted, in child processes of their own.

Apart from the workers, so that a long queue does not keep an upload waiting; bounded, so that
many uploads do not take the machine.
"""

from __future__ import annotations

import asyncio
import os
import secrets
import stat
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

from physretarget.sandbox.child import ChildError
from physretarget.sandbox.limits import Limits
from physretarget.service.errors import ApiError
from physretarget.service.home import Home, remove
from physretarget.service.supervisor import Runner
from physretarget.service.uploads import Upload

_THREADS = 2
_WAITING = 32


class Checks:
    """Runs the check tasks, a few at a time."""

    def __init__(self, home: Home, runner: Runner, limits: Limits, seconds: float) -> None:
        self._home = home
        self._runner = runner
        self._limits = replace(
            limits,
            seconds=min(seconds, limits.seconds),
            cpu_seconds=min(int(seconds) + 1, limits.cpu_seconds),
        )
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="check")
        self._waiting = 0

    def close(self) -> None:
        """Wait for the checks under way."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    async def model(self, upload: Path, name: str, main: str) -> tuple[dict[str, Any], Path]:
        """Check a model: its facts, and the folder with its files, to be moved away.

        Raises:
            ApiError: 422 it is refused, 503 too many wait already.
        """
        folder = self._home.incoming / f"model-{secrets.token_hex(12)}"
        request = {
            "upload": str(upload), "name": name, "main": main, "limits": self._limits.to_dict(),
        }  # fmt: skip
        try:
            facts = await self._run("check_model", request, folder, upload)
            root = folder / "model"
            await asyncio.to_thread(_only_files, root)
            kept = self._home.incoming / f"kept-{secrets.token_hex(12)}"
            os.rename(root, kept)
            return facts, kept
        finally:
            await asyncio.to_thread(remove, folder)

    async def motion(
        self,
        upload: Upload,
        *,
        skeleton: Upload | None = None,
        fps: float | None = None,
        quat: str | None = None,
    ) -> None:
        """Read a clip or a capture as far as that goes without a model.

        Raises:
            ApiError: 422 it is refused, 503 too many wait already.
        """
        folder = self._home.incoming / f"motion-{secrets.token_hex(12)}"
        try:
            named = {role: str(_link(each, folder, role)) for role, each in
                     (("path", upload), ("skeleton", skeleton)) if each}  # fmt: skip
            request = {
                "skeleton": None, **named, "fps": fps, "quat": quat,
                "clip_frames": self._limits.clip_frames,
            }  # fmt: skip
            given = [each.path for each in (upload, skeleton) if each]
            await self._run("check_clip", request, folder, *given)
        finally:
            await asyncio.to_thread(remove, folder)

    async def _run(
        self, task: str, request: Mapping[str, Any], folder: Path, *inputs: Path
    ) -> dict[str, Any]:
        if self._waiting >= _WAITING:
            raise ApiError(503, "Too many uploads are being checked.", headers={"Retry-After": "5"})
        folder.mkdir(mode=0o700, exist_ok=True)
        self._waiting += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(
                self._pool,
                lambda: self._runner.run(
                    f"physretarget.service.tasks:{task}", request, folder=folder,
                    limits=self._limits, inputs=inputs,
                ),
            )  # fmt: skip
        except ChildError as error:
            raise _refused(error) from error
        finally:
            self._waiting -= 1


def _link(upload: Upload, folder: Path, role: str) -> Path:
    """The upload under the name that its client gave it: readers go by a file's suffix."""
    place = folder / role / upload.name
    place.parent.mkdir(parents=True, mode=0o700)
    place.symlink_to(upload.path)
    return place


def _refused(error: ChildError) -> ApiError:
    code = "unsafe" if error.error == "UnsafeInputError" else {
        "input": "unusable", "timeout": "too_expensive", "memory": "too_expensive",
    }.get(error.kind, "unusable")  # fmt: skip
    message = f"{error.message[:1].upper()}{error.message[1:]}"
    return ApiError(422, message, code=code)


def _only_files(root: Path) -> None:
    """Refuse what a child left besides plain files and folders."""
    for folder, folders, files in os.walk(root, followlinks=False):
        for name in (*folders, *files):
            about = os.lstat(os.path.join(folder, name))
            plain = stat.S_ISREG(about.st_mode) and about.st_nlink == 1
            if not (plain or stat.S_ISDIR(about.st_mode)):
                raise ApiError(422, "The model holds what is no plain file.", code="unsafe")
