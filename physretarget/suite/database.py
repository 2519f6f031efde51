"""A history's database: its URL, and SQLite brought to behave as PostgreSQL does."""

from __future__ import annotations

import sqlite3
import time
from pathlib import Path
from typing import Any

from physretarget.errors import MissingExtraError, UsageError

try:
    import sqlalchemy as sa
except ImportError as error:
    raise MissingExtraError("SQLAlchemy", extra="suite", purpose="a suite's history") from error

READING = "physretarget_reading"  # the option of a connection that only reads

_PATIENCE = 30.0  # seconds to wait for another connection
_BUSY_MS = 30_000  # the same, as SQLite takes it
# Of PostgreSQL: a server that was restarted has closed the connections of the pool, and one that
# cannot be reached or does not answer must become an error that is tried again later.
_CONNECT_S = 10
_STATEMENT_MS = 60_000


def engine_at(url: str) -> sa.Engine:
    """The engine of a URL; the folder of an SQLite file is made.

    Raises UsageError for what is no URL of SQLite or PostgreSQL, MissingExtraError where the
    driver is not installed.
    """
    try:
        parsed = sa.make_url(url)
        if parsed.get_backend_name() == "sqlite" and parsed.database:
            Path(parsed.database).parent.mkdir(parents=True, exist_ok=True)
        more: dict[str, Any] = {}
        if parsed.get_backend_name() == "postgresql":
            more["pool_pre_ping"] = True
            more["connect_args"] = {
                "connect_timeout": _CONNECT_S, "options": f"-c statement_timeout={_STATEMENT_MS}",
            }  # fmt: skip
        engine = sa.create_engine(parsed, **more)
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            str(error.name), extra="postgresql", purpose=f"a history at {shown(url)}"
        ) from error
    except (sa.exc.ArgumentError, sa.exc.NoSuchModuleError) as error:
        raise UsageError(
            f"the history {shown(url)!r} is no URL of SQLite or PostgreSQL."
        ) from error
    if engine.dialect.name not in ("sqlite", "postgresql"):
        raise UsageError(f"the history {shown(url)!r} is neither SQLite nor PostgreSQL.")
    if engine.dialect.name == "sqlite":
        sa.event.listen(engine, "connect", _sqlite_settings)
        sa.event.listen(engine, "begin", _sqlite_begin)
    return engine


def _sqlite_begin(connection: sa.Connection) -> None:
    # A transaction that only later turns out to write could find itself locked out.
    reading = connection.get_execution_options().get(READING, False)
    connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")


def _sqlite_settings(connection: Any, _: object) -> None:
    """Readers beside a writer, a wait instead of 'locked', foreign keys as PostgreSQL has them."""
    # FULL: what was promised to a caller is on the disk, whatever happens to the machine.
    # Transactions are begun by us: the driver's own way leaves DDL outside of them.
    connection.isolation_level = None
    for pragma in (f"busy_timeout={_BUSY_MS}", "foreign_keys=ON", "synchronous=FULL"):
        connection.execute(f"PRAGMA {pragma}")
    _write_ahead(connection, time.monotonic() + _PATIENCE)


def _write_ahead(connection: Any, until: float) -> None:
    """Switch to the write-ahead journal, which outlives the connection.

    Going from one journal to the other takes the whole database; where two connections want it
    at the same moment SQLite answers 'locked' at once, whatever ``busy_timeout`` says.
    """
    while True:
        try:
            connection.execute("PRAGMA journal_mode=WAL")
            return
        except sqlite3.OperationalError:
            if time.monotonic() > until:
                raise
            time.sleep(0.02)


def shown(url: str) -> str:
    """A URL without its password."""
    try:
        return sa.make_url(url).render_as_string(hide_password=True)
    except sa.exc.ArgumentError:
        return url
