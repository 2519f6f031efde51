"""History: runs, results by content address, accepted baselines. SQLite or PostgreSQL.

SQLAlchemy's Core (not its ORM) because the same few statements must run on both databases.
Migrations are a list of functions here rather than Alembic: six tables need no folder of
scripts and templates, and a store that upgrades itself when opened needs no second command.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from types import TracebackType
from typing import Any

from physretarget.errors import InputError, MissingExtraError
from physretarget.suite.compare import State
from physretarget.suite.database import READING, engine_at, shown
from physretarget.suite.job import Outcome
from physretarget.suite.records import Accepted, Entry, Run

try:
    import sqlalchemy as sa
    from sqlalchemy.dialects import postgresql, sqlite
except ImportError as error:
    raise MissingExtraError("SQLAlchemy", extra="suite", purpose="a suite's history") from error

from physretarget.suite import suite_tables as tables
from physretarget.suite.service_tables import add_owners, create_service_tables

_CHUNK = 500  # addresses per IN (...): below every driver's limit of parameters
_LOCK = 7246213  # any number, the same in every version: who migrates waits for the other

# Each takes the schema from its index to the next; only ever append, never edit.
MIGRATIONS: tuple[Callable[[sa.Connection], None], ...] = (
    tables.create_suite_tables,
    create_service_tables,
    add_owners,
)


class Store:
    """An open history. Use as a context manager.

    Raises:
        UsageError: the URL is not understood.
        InputError: the database cannot be opened, or was written by a newer version.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._engine = engine_at(url)
        with self._errors():
            self._migrate()

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._engine.dispose()

    # ---- schema --------------------------------------------------------------------------------

    def _migrate(self) -> None:
        with self._engine.begin() as connection:
            if self._engine.dialect.name == "postgresql":
                connection.execute(sa.text(f"SELECT pg_advisory_xact_lock({_LOCK})"))
            tables.schema_version.create(connection, checkfirst=True)
            at = (
                connection.execute(sa.select(sa.func.max(tables.schema_version.c.version))).scalar()
                or 0
            )
            if at > len(MIGRATIONS):
                raise InputError(
                    f"was written by a newer version (schema {at}, this one knows "
                    f"{len(MIGRATIONS)}).",
                    path=shown(self.url),
                )
            for number, migration in enumerate(MIGRATIONS[at:], at + 1):
                migration(connection)
                connection.execute(tables.schema_version.insert().values(version=number))

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except sa.exc.SQLAlchemyError as error:
            cause = str(getattr(error, "orig", None) or error).strip().splitlines()[0]
            raise InputError(f"the history fails: {cause}.", path=shown(self.url)) from error

    @contextmanager
    def begin(self) -> Iterator[sa.Connection]:
        """A transaction; the database's errors leave it as :class:`InputError`."""
        with self._errors(), self._engine.begin() as connection:
            yield connection

    @contextmanager
    def read(self) -> Iterator[sa.Connection]:
        """A transaction that only reads, beside one that writes."""
        with (
            self._errors(),
            self._engine.connect().execution_options(**{READING: True}) as connection,
            connection.begin(),
        ):
            yield connection

    def insert(self, table: sa.Table, values: Any, *, keys: Sequence[str] = ()) -> Any:
        """An insert that leaves an existing row alone, or with ``keys`` replaces it."""
        make: Any = sqlite if self._engine.dialect.name == "sqlite" else postgresql
        statement = make.insert(table).values(values)
        if not keys:
            return statement.on_conflict_do_nothing()
        changed = {c.name: statement.excluded[c.name] for c in table.c if c.name not in keys}
        return statement.on_conflict_do_update(index_elements=list(keys), set_=changed)

    # ---- results -------------------------------------------------------------------------------

    def known(self, addresses: Iterable[str]) -> set[str]:
        """Those addresses whose result is there for good."""
        found: set[str] = set()
        with self.begin() as connection:
            for part in _parts(addresses):
                query = sa.select(tables.results.c.address).where(
                    tables.results.c.address.in_(part), tables.results.c.transient.is_(False)
                )
                found.update(connection.execute(query).scalars())
        return found

    def save(self, outcome: Outcome) -> None:
        """Keep a result with its artifacts, all or nothing; saving twice changes nothing."""
        document = outcome.document or {}
        findings: dict[str, dict[str, int]] = {}
        for finding in document.get("findings", ()):
            count = findings.setdefault(finding["code"], {"errors": 0, "warnings": 0})
            count["errors" if finding["severity"] == "error" else "warnings"] += 1
        measures = {
            name: {"value": m["value"], "unit": m["unit"]}
            for name, m in document.get("measures", {}).items()
        }
        row = {
            "address": outcome.address, "status": outcome.status, "message": outcome.message,
            "transient": outcome.transient, "seconds": outcome.seconds, "created": _now(),
            "measures": measures, "findings": findings, "document": outcome.document,
        }  # fmt: skip
        with self.begin() as connection:
            for kind, content in sorted(outcome.artifacts.items()):
                name, _, own = kind.partition("/")
                connection.execute(
                    self.insert(
                        tables.artifacts,
                        {"address": own or outcome.address, "kind": name, "content": content},
                    )
                )
            connection.execute(self.insert(tables.results, row, keys=("address",)))

    def states(self, addresses: Iterable[str]) -> dict[str, State]:
        """What is needed to compare, by address."""
        columns = (
            tables.results.c.address, tables.results.c.status, tables.results.c.message,
            tables.results.c.measures, tables.results.c.findings,
        )  # fmt: skip
        found: dict[str, State] = {}
        with self.begin() as connection:
            for part in _parts(addresses):
                query = sa.select(*columns).where(tables.results.c.address.in_(part))
                for row in connection.execute(query).mappings():
                    found[row["address"]] = State(**row)
        return found

    def documents(self, addresses: Iterable[str]) -> dict[str, dict[str, Any]]:
        """Whole reports by address; errored results have none."""
        found: dict[str, dict[str, Any]] = {}
        with self.begin() as connection:
            for part in _parts(addresses):
                query = sa.select(tables.results.c.address, tables.results.c.document).where(
                    tables.results.c.address.in_(part), tables.results.c.status == "ok"
                )
                found.update((row[0], row[1]) for row in connection.execute(query))
        return found

    def artifact(self, address: str, kind: str) -> bytes | None:
        """The bytes of an artifact, None where there is none."""
        query = sa.select(tables.artifacts.c.content).where(
            tables.artifacts.c.address == address, tables.artifacts.c.kind == kind
        )
        with self.begin() as connection:
            content = connection.execute(query).scalar()
        return None if content is None else bytes(content)

    # ---- runs ----------------------------------------------------------------------------------

    def begin_run(self, suite: str, version: str) -> int:
        """Note that a run has begun; one that never finishes is in no report."""
        row = {"suite": suite, "started": _now(), "version": version}
        with self.begin() as connection:
            made = connection.execute(tables.runs.insert().values(row).returning(tables.runs.c.id))
            return int(made.scalar_one())

    def finish_run(self, run: int, entries: Sequence[Entry], *, seconds: float, done: int) -> None:
        """Keep a run's verdicts."""
        counts: dict[str, int] = {}
        for entry in entries:
            counts[entry.verdict] = counts.get(entry.verdict, 0) + 1
        rows = [
            {
                **{name: getattr(entry, name) for name in Entry.__dataclass_fields__},
                "run": run, "tags": list(entry.tags), "changes": [dict(c) for c in entry.changes],
            }
            for entry in entries
        ]  # fmt: skip
        with self.begin() as connection:
            if rows:
                connection.execute(tables.entries.insert(), rows)
            connection.execute(
                tables.runs.update()
                .where(tables.runs.c.id == run)
                .values(finished=_now(), seconds=seconds, done=done, counts=counts)
            )

    def runs(self, suite: str, limit: int = 60) -> list[Run]:
        """The last finished runs, oldest first."""
        query = (
            sa.select(tables.runs)
            .where(tables.runs.c.suite == suite, tables.runs.c.finished.is_not(None))
            .order_by(tables.runs.c.id.desc())
            .limit(limit)
        )
        with self.begin() as connection:
            found = [Run(**row) for row in connection.execute(query).mappings()]
        return found[::-1]

    def entries(self, run: int) -> list[Entry]:
        """A run's verdicts by clip."""
        query = (
            sa.select(tables.entries)
            .where(tables.entries.c.run == run)
            .order_by(tables.entries.c.clip)
        )
        with self.begin() as connection:
            rows = [dict(row) for row in connection.execute(query).mappings()]
        for row in rows:
            row.pop("run")
            row["tags"], row["changes"] = tuple(row["tags"]), tuple(row["changes"])
        return [Entry(**row) for row in rows]

    def tracks(self, runs: Sequence[int]) -> dict[str, list[tuple[int, str | None]]]:
        """For every clip the address of its result in each of these runs."""
        query = (
            sa.select(tables.entries.c.clip, tables.entries.c.run, tables.entries.c.address)
            .where(tables.entries.c.run.in_(list(runs)))
            .order_by(tables.entries.c.run)
        )
        found: dict[str, list[tuple[int, str | None]]] = {}
        with self.begin() as connection:
            for clip, run, address in connection.execute(query):
                found.setdefault(clip, []).append((run, address))
        return found

    # ---- baselines -----------------------------------------------------------------------------

    def baseline(self, suite: str) -> dict[str, Accepted]:
        """What is accepted now, by clip; the latest acceptance of a clip is in force."""
        query = (
            sa.select(tables.baselines)
            .where(tables.baselines.c.suite == suite)
            .order_by(tables.baselines.c.id)
        )
        found: dict[str, Accepted] = {}
        with self.begin() as connection:
            for row in connection.execute(query).mappings():
                found[row["clip"]] = Accepted(
                    address=row["address"], note=row["note"], accepted=row["accepted"],
                    run=row["run"],
                )  # fmt: skip
        return found

    def accept(
        self, suite: str, accepted: Mapping[str, str | None], *, run: int, note: str
    ) -> None:
        """Make these results the baseline of their clips; None accepts that a clip is gone."""
        moment = _now()
        rows = [
            {"suite": suite, "clip": clip, "address": address, "run": run, "note": note,
             "accepted": moment}
            for clip, address in sorted(accepted.items())
        ]  # fmt: skip
        if rows:
            with self.begin() as connection:
                connection.execute(tables.baselines.insert(), rows)


def _parts(values: Iterable[str]) -> Iterator[list[str]]:
    every = sorted(set(values))
    for start in range(0, len(every), _CHUNK):
        yield every[start : start + _CHUNK]


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
