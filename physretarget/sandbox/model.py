"""From an uploaded file to a model that MuJoCo may be shown."""

from __future__ import annotations

import shutil
from pathlib import Path

from physretarget.errors import InputError, UnsafeInputError
from physretarget.sandbox.archive import is_zip, unpack
from physretarget.sandbox.limits import Limits
from physretarget.sandbox.mjcf import check_model, find_main


def receive(upload: Path, into: Path, limits: Limits, *, main: str | None = None) -> Path:
    """Unpack an upload (XML or zip) into a new folder, check it, and return the model's path.

    To be called inside a job, in the job's folder: what it does with a stranger's bytes takes
    time and memory too.

    Args:
        upload: the file as it came, whatever its name.
        into: a folder that is made.
        limits: bounds.
        main: which model of an archive is meant, a path inside it.

    Raises:
        InputError: it holds no model, or one that cannot be used.
        UnsafeInputError: something in it is refused; nothing stays in the folder.
    """
    if upload.stat().st_size > limits.upload_bytes:
        raise UnsafeInputError(
            f"has {upload.stat().st_size} bytes, at most {limits.upload_bytes} are read."
        )
    try:
        if is_zip(upload):
            files = unpack(upload, into, limits)
        else:
            into.mkdir(parents=True)
            files = (into / "model.xml",)
            shutil.copyfile(upload, files[0])
        chosen = _chosen(into, files, main)
        check_model(into, chosen, limits)
    except BaseException:
        shutil.rmtree(into, ignore_errors=True)
        raise
    return chosen


def _chosen(into: Path, files: tuple[Path, ...], main: str | None) -> Path:
    if len(files) == 1 and files[0].name == "model.xml":
        return files[0]
    if main is None:
        return find_main(into, files)
    chosen = into / main
    if chosen not in files:
        raise InputError(f"the upload holds no file {main[:80]!r}.")
    return chosen
