"""From a suite file to jobs: globs become files, files become content addresses."""

from __future__ import annotations

import glob
import hashlib
import importlib.metadata
import json
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import physretarget
from physretarget._version import __version__
from physretarget.errors import InputError, PhysretargetError
from physretarget.options import JOBS
from physretarget.options.retargeting import MAPPERS
from physretarget.suite.file import Case, Suite
from physretarget.suite.job import Job

# What these rooms do changes no result, so a change there must not redo the night.
_SHOWS = {
    "cli", "report", "assets", "face", "groundtruth", "reproduce", "suite", "service", "demo.py",
}  # fmt: skip
_NAMES_A_FILE = re.compile(rb"\bfile\w*\s*=|<\s*include|<\s*model\b")
_NUMERIC = ("mujoco", "numpy", "scipy", "casadi")


@dataclass(frozen=True, kw_only=True)
class Plan:
    """All jobs in the suite's order; ``notes`` are things that a person should know."""

    jobs: tuple[Job, ...]
    notes: tuple[str, ...] = ()


def plan(suite: Suite) -> Plan:
    """Find every clip and capture and give each its address.

    Raises:
        InputError: a model, config or key pose file is missing or broken, a glob finds nothing
            anywhere, or two jobs would have the same name. (A broken clip raises nothing.)
    """
    jobs: list[Job] = []
    notes: list[str] = []
    seen: dict[str, str] = {}
    cache_: dict[Path, dict[str, str]] = {}
    for case in suite.cases:
        found = list(_jobs(suite, case, cache_, notes))
        for job in found:
            if job.clip_id in seen:
                raise InputError(
                    f"{job.clip_id!r} is there twice (case {seen[job.clip_id]!r} and "
                    f"{case.name!r}): give one of the cases a name of its own.",
                    path=suite.path,
                    line=case.line,
                )
            seen[job.clip_id] = case.name
        jobs += found
    if not jobs:
        raise InputError("no glob finds any file.", path=suite.path)
    return Plan(jobs=tuple(jobs), notes=tuple(notes))


def _jobs(
    suite: Suite, case: Case, known: dict[Path, dict[str, str]], notes: list[str]
) -> Iterable[Job]:
    roles: dict[str, Path] = {}
    options: dict[str, Any] = {}
    kinds = {each.name: each.kind for each in JOBS[case.kind].suite}
    for name, value in case.given.items():
        if kinds[name] == "path" and isinstance(value, tuple):
            roles |= {f"{name}{i:03d}": path for i, path in enumerate(value)}
        elif kinds[name] == "path":
            roles[name] = value
        elif name == "mapper" and value not in MAPPERS:
            roles[name] = Path(value)
        else:
            options[name] = value
    shared = _shared(suite, case, roles, known)
    for path in _files(suite.folder, case.sources):
        yield _job(suite, case, path, roles, shared, options)
    for pattern in case.sources:
        if not _files(suite.folder, (pattern,)):
            notes.append(f"{suite.path.name}:{case.line}: {pattern!r} finds no file.")


def _shared(
    suite: Suite,
    case: Case,
    roles: dict[str, Path],
    known: dict[Path, dict[str, str]],
) -> dict[str, str]:
    """Hashes of what all clips of a case need: model with its assets, config, key poses."""
    shared: dict[str, str] = {}
    try:
        for path in roles.values():
            if path not in known:
                own = path == case.model
                known[path] = _with_assets(path) if own else {str(path): _sha256(path)}
            shared |= known[path]
    except PhysretargetError as error:
        raise InputError(f"case {case.name!r}: {error}", path=suite.path, line=case.line) from error
    return shared


def _with_assets(model: Path) -> dict[str, str]:
    """The MJCF file, the files that it includes, and its assets."""
    content = _bytes(model)
    if not _NAMES_A_FILE.search(content):
        # It names no other file. Most nights no model need be parsed, nor MuJoCo loaded.
        return {str(model): hashlib.sha256(content).hexdigest()}
    from physretarget.mjcf.source import read_source

    source = read_source(model)
    included = {e.path for e in source.elements if e.path is not None}
    # The hash of the model itself stands for all of it: workers key their cache by it.
    files = {str(p): _sha256(p) for p in {*included, *source.assets} if p != model}
    return {**files, str(model): source.sha256}


def _job(
    suite: Suite,
    case: Case,
    clip: Path,
    roles: dict[str, Path],
    shared: dict[str, str],
    options: dict[str, Any],
) -> Job:
    files = {**shared, str(clip): _sha256(clip, missing_ok=True)}
    root = os.path.commonpath([suite.folder, *files])
    root = root if os.path.isdir(root) else os.path.dirname(root)

    def short(path: str | Path) -> str:
        return os.path.relpath(path, root)

    inputs = {"clip": short(clip), **{role: short(path) for role, path in roles.items()}}
    # The clip's file type matters (it picks the reader), where files lie does not.
    content = {
        "kind": case.kind, "code": code_version(), "options": options,
        "suffix": clip.suffix.lower(),
        "clip": files[str(clip)],
        "with": {role: shared[str(path)] for role, path in roles.items()},
    }  # fmt: skip
    address = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return Job(
        clip_id=f"{case.name}/{Path(os.path.relpath(clip, suite.folder)).as_posix()}",
        address=address, kind=case.kind, case=case.name, tags=case.tags, owner=case.owner,
        root=root,
        inputs=inputs, files={short(path): sha for path, sha in files.items()}, options=options,
    )  # fmt: skip


def _files(folder: Path, patterns: tuple[str, ...]) -> list[Path]:
    """Files that match, sorted, each once."""
    found = {
        os.path.normpath(folder / match)
        for pattern in patterns
        for match in glob.glob(pattern, root_dir=folder, recursive=True)
    }
    return [Path(path) for path in sorted(found) if os.path.isfile(path)]


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}.", path=path) from error


def _sha256(path: Path, *, missing_ok: bool = False) -> str:
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        if missing_ok:
            return f"unreadable: {error.strerror}"
        raise InputError(f"cannot be read: {error.strerror}.", path=path) from error


@cache
def code_version() -> str:
    """What computes: our version, the bytes of our code, the numeric packages' versions.

    The version alone would keep last night's results while somebody changes a stage.
    """
    digest = hashlib.sha256(__version__.encode())
    root = Path(physretarget.__file__).parent
    for path in sorted(root.rglob("*.py")):
        place = path.relative_to(root)
        if place.parts[0] not in _SHOWS or place.parts == ("suite", "work.py"):
            digest.update(place.as_posix().encode() + b"\0" + path.read_bytes())
    for name in _NUMERIC:
        digest.update(f"{name} {importlib.metadata.version(name)}".encode())
    return digest.hexdigest()
