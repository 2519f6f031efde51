"""Backups of a service: its rows and its files in one archive, whatever the database.

The rows are read in one transaction, then the files that they name are copied: what comes meanwhile
is not in the backup, and what is in it is whole. A restored folder is a service of its own, with an
id of its own, on SQLite or on PostgreSQL.
"""

from __future__ import annotations

import io
import json
import re
import tarfile
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import IO, Any

import sqlalchemy as sa

from physretarget._version import __version__
from physretarget.errors import InputError, UsageError
from physretarget.files import beside
from physretarget.service.home import Home
from physretarget.suite.service_tables import clips, jobs, models, tokens
from physretarget.suite.store import Store

__all__ = ["back_up", "restore"]

_TABLES = {"jobs": jobs, "clips": clips, "models": models, "tokens": tokens}
_FOLDERS = ("blobs", "models", "jobs")
_MANIFEST = "backup.json"
_SCHEMA = "physretarget/backup/1"
_LARGEST_ROWS = 1 << 30
_SAFE = re.compile(r"(blobs|models|jobs)/[^/\0][^\0]*")


def back_up(data: Path, history: str | None, out: Path) -> dict[str, int]:
    """Write a service's rows and files to an archive; the service may be running.

    Args:
        data: The data folder.
        history: The database's URL, where it is not in the folder.
        out: The archive, a tar; replaced only when it is whole.

    Returns:
        How many rows of each kind, and how many files, are in it.

    Raises:
        InputError: The folder or the database cannot be read, or the archive not written.
    """
    if not (data / "id").is_file():
        raise InputError("is no data folder of a service: it has no file 'id'.", path=data)
    home = Home(data)
    with Store(history or home.history) as store:
        rows = _rows(store, home.id)
    counts = {name: len(found) for name, found in rows.items()} | {"files": 0}
    with beside(out, suffix=".tar") as fresh, tarfile.open(fresh, "w") as archive:
        manifest = {"schema": _SCHEMA, "version": __version__, "rows": counts}
        _add(archive, _MANIFEST, json.dumps(manifest).encode())
        for name, found in rows.items():
            _add(archive, f"rows/{name}.json", json.dumps(found).encode())
        for file in _files(home, rows):
            archive.add(file, str(file.relative_to(home.folder)), recursive=False)
            counts["files"] += 1
    return counts


def _rows(store: Store, home: str) -> dict[str, list[dict[str, Any]]]:
    """All rows of a service, as they are at one moment."""
    with store.read() as connection:
        return {
            name: [
                {key: value for key, value in row.items() if key != "home"}
                for row in connection.execute(
                    sa.select(table).where(table.c.home == home).order_by(table.c.id)
                ).mappings()
            ]
            for name, table in _TABLES.items()
        }


def _files(home: Home, rows: Mapping[str, list[dict[str, Any]]]) -> Iterator[Path]:
    """The files that the rows need: contents, models, results."""
    wanted = {clip["sha256"] for clip in rows["clips"]}
    wanted |= {sha for job in rows["jobs"] for sha in job["inputs"].get("blobs", ())}
    folders = [home.models / model["id"] for model in rows["models"]]
    for job in rows["jobs"]:
        if job["result"]:
            folders.append(home.job(job["id"]) / job["result"])
        model = job["inputs"].get("model") or {}
        if model.get("folder") and job["status"] in ("queued", "running"):
            folders.append(home.models / model["folder"])
    yield from (home.blob(sha) for sha in sorted(wanted) if home.blob(sha).is_file())
    for folder in dict.fromkeys(folders):
        yield from sorted(p for p in folder.rglob("*") if p.is_file() and not p.is_symlink())


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mode = len(content), 0o600
    archive.addfile(entry, io.BytesIO(content))


def restore(archive: Path, data: Path, history: str | None) -> dict[str, int]:
    """Make a service's data folder of a backup.

    Args:
        archive: What :func:`back_up` wrote.
        data: A folder that is not there yet, or empty.
        history: The database's URL, where it is not to be in the folder.

    Returns:
        As :func:`back_up`.

    Raises:
        InputError: The archive is none, or damaged; nothing is restored.
        UsageError: The folder is in use, or the database holds these jobs already.
    """
    if data.exists() and any(data.iterdir()):
        raise UsageError(f"{data} is not empty: restore into a folder of its own.")
    try:
        with tarfile.open(archive, "r:") as source:
            return _restored(source, archive, data, history)
    except (tarfile.TarError, EOFError, OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"is no readable backup: {error!s:.100}", path=archive) from error


def _restored(
    source: tarfile.TarFile, path: Path, data: Path, history: str | None
) -> dict[str, int]:
    manifest = json.loads(_content(source, _MANIFEST, path))
    if manifest.get("schema") != _SCHEMA:
        raise InputError(f"has the schema {manifest.get('schema')!r}, not {_SCHEMA}.", path=path)
    rows = {name: json.loads(_content(source, f"rows/{name}.json", path)) for name in _TABLES}
    home = Home(data)
    files = 0
    for entry in source:
        if entry.name == _MANIFEST or entry.name.startswith("rows/"):
            continue
        parts = PurePosixPath(entry.name).parts
        if not entry.isreg() or not _SAFE.fullmatch(entry.name) or ".." in parts:
            raise InputError(f"holds {entry.name[:80]!r}, which no backup has.", path=path)
        opened = source.extractfile(entry)
        assert opened is not None
        place = home.folder / Path(*parts)
        place.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with beside(place) as fresh, fresh.open("wb") as target:
            _copy(opened, target)
        files += 1
    with Store(history or home.history) as store, store.begin() as connection:
        for name, table in _TABLES.items():
            known = {column.name for column in table.c}
            for row in rows[name]:
                taken = sa.select(table.c.id).where(table.c.id == row["id"])
                if connection.execute(taken).first() is not None:
                    raise UsageError(
                        f"the history holds {name} of this backup already: give the restored "
                        "service a database of its own."
                    )
                kept = {key: value for key, value in row.items() if key in known}
                connection.execute(table.insert().values(home=home.id, **kept))
    return {name: len(found) for name, found in rows.items()} | {"files": files}


def _content(source: tarfile.TarFile, name: str, path: Path) -> bytes:
    entry = source.getmember(name)
    opened = source.extractfile(entry)
    if opened is None or entry.size > _LARGEST_ROWS:
        raise InputError(f"{name} is no file of a backup.", path=path)
    return opened.read()


def _copy(source: IO[bytes], target: IO[bytes]) -> None:
    while part := source.read(1 << 20):
        target.write(part)
