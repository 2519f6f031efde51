"""Jobs of the service in the history database: queued, claimed under a lease, finished once.

Every step is one conditional statement, so that it holds whoever dies in between:

* a job is claimed by an UPDATE that finds it still free, and its ``attempts`` counts up;
* its lease is prolonged, its progress told and its end written only by that claim (owner and
  attempt in the WHERE), so that a claim that was lost cannot write over the one that followed;
* a lease that ran out makes the job free again.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from typing import Any, Literal

import sqlalchemy as sa

from physretarget.suite.service_tables import changeable, jobs, readable
from physretarget.suite.store import Store

Status = Literal["queued", "running", "done", "failed", "cancelled"]
STATUSES: tuple[Status, ...] = ("queued", "running", "done", "failed", "cancelled")
ENDED: tuple[Status, ...] = ("done", "failed", "cancelled")
ATTEMPTS = 8
"""Claims after which a job that never ends is given up: it would take the service with it."""
_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"


@dataclass(frozen=True, kw_only=True)
class JobRecord:
    """A job as the database has it; ``inputs`` is what the worker needs and nobody is shown."""

    id: str
    kind: str
    status: Status
    progress: float
    stage: str
    created: str
    started: str | None
    finished: str | None
    clip_name: str
    clip_sha256: str
    model_id: str | None
    model_name: str
    options: Mapping[str, Any]
    inputs: Mapping[str, Any]
    summary: Mapping[str, Any] | None
    error: Mapping[str, Any] | None
    attempts: int
    revision: int
    cancelling: bool
    owner: str | None
    result: str | None
    fingerprint: str
    belongs_to: str | None
    shared: bool

    @property
    def ended(self) -> bool:
        """Nothing will change any more."""
        return self.status in ENDED


@dataclass(frozen=True, kw_only=True)
class NewJob:
    """What a client asks for."""

    kind: str
    clip_name: str
    clip_sha256: str
    model_id: str | None
    model_name: str
    options: Mapping[str, Any]
    inputs: Mapping[str, Any]
    fingerprint: str
    idempotency: str | None = None
    belongs_to: str | None = None


_COLUMNS = tuple(jobs.c[field.name] for field in fields(JobRecord))


def new_id() -> str:
    """26 characters that sort by time of making, to the microsecond, and cannot be guessed."""
    number = (time.time_ns() * 1024 // 1_000_000) << 70 | secrets.randbits(70)
    return "".join(_ALPHABET[number >> shift & 31] for shift in range(125, -1, -5))


def now() -> str:
    """This moment as ISO 8601 in UTC."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class Queue:
    """The jobs of one data folder (``home``)."""

    def __init__(self, store: Store, home: str) -> None:
        self._store = store
        self._home = home

    # ---- what clients do -----------------------------------------------------------------------

    def submit(self, job: NewJob) -> tuple[JobRecord, bool]:
        """Queue a job; the flag is False where its idempotency key had already made one.

        The unique index decides between duplicates that come at the same moment. Whether the
        older job is the same is for the caller to see (``fingerprint``).
        """
        row = {
            **{name: getattr(job, name) for name in NewJob.__dataclass_fields__},
            "id": new_id(), "home": self._home, "status": "queued", "progress": 0.0,
            "stage": "queued", "created": now(), "attempts": 0, "revision": 1,
            "cancelling": False, "shared": False,
        }  # fmt: skip
        with self._store.begin() as connection:
            connection.execute(self._store.insert(jobs, row))
            same = (
                jobs.c.id == row["id"]
                if job.idempotency is None
                else jobs.c.idempotency == job.idempotency
            )
            query = sa.select(*_COLUMNS).where(jobs.c.home == self._home, same)
            found = JobRecord(**connection.execute(query).mappings().one())
        return found, found.id == row["id"]

    def find(self, idempotency: str) -> JobRecord | None:
        """The job that an idempotency key has made."""
        return self._one(jobs.c.idempotency == idempotency)

    def get(self, id: str, owner: str | None = None) -> JobRecord | None:
        """A job that ``owner`` (None: anybody) may read, None where there is none."""
        return self._one(jobs.c.id == id, *readable(jobs, owner))

    def _one(self, *conditions: sa.ColumnElement[bool]) -> JobRecord | None:
        query = sa.select(*_COLUMNS).where(jobs.c.home == self._home, *conditions)
        with self._store.read() as connection:
            row = connection.execute(query).mappings().first()
        return JobRecord(**row) if row else None

    def page(
        self,
        *,
        status: str | None = None,
        kind: str | None = None,
        q: str | None = None,
        model: str | None = None,
        before: str | None = None,
        limit: int = 50,
        owner: str | None = None,
    ) -> list[JobRecord]:
        """Jobs that ``owner`` may read, newest first.

        ``before`` is an id, ``q`` is looked for in names and ids.
        """
        where = [jobs.c.home == self._home, *readable(jobs, owner)]
        if status is not None:
            where.append(jobs.c.status == status)
        if kind is not None:
            where.append(jobs.c.kind == kind)
        if model is not None:
            where.append(sa.or_(jobs.c.model_id == model, jobs.c.model_name == model))
        if before is not None:
            where.append(jobs.c.id < before)
        if q:
            where.append(
                sa.or_(
                    *(
                        sa.func.lower(c).contains(q.lower(), autoescape=True)
                        for c in (jobs.c.clip_name, jobs.c.model_name, jobs.c.id)
                    )
                )
            )
        query = sa.select(*_COLUMNS).where(*where).order_by(jobs.c.id.desc()).limit(limit)
        with self._store.read() as connection:
            return [JobRecord(**row) for row in connection.execute(query).mappings()]

    def counts(self) -> dict[str, int]:
        """Jobs by status."""
        query = (
            sa.select(jobs.c.status, sa.func.count())
            .where(jobs.c.home == self._home)
            .group_by(jobs.c.status)
        )
        with self._store.read() as connection:
            found = {str(status): int(count) for status, count in connection.execute(query)}
        return {status: found.get(status, 0) for status in STATUSES}

    def oldest(self) -> str | None:
        """When the oldest queued job was made (UTC), None where none is queued."""
        query = sa.select(sa.func.min(jobs.c.created)).where(
            jobs.c.home == self._home, jobs.c.status == "queued"
        )
        with self._store.read() as connection:
            found = connection.execute(query).scalar()
        return None if found is None else str(found)

    def cancel(self, id: str, owner: str | None = None) -> JobRecord | None:
        """Cancel a queued job at once; ask the worker of a running one to stop.

        None where ``owner`` may not change such a job.
        """
        with self._store.begin() as connection:
            mine = (jobs.c.home == self._home, jobs.c.id == id, *changeable(jobs, owner))
            connection.execute(
                jobs.update()
                .where(*mine, jobs.c.status == "queued")
                .values(
                    status="cancelled", stage="cancelled", finished=now(),
                    revision=jobs.c.revision + 1,
                )
            )  # fmt: skip
            connection.execute(
                jobs.update()
                .where(*mine, jobs.c.status == "running", jobs.c.cancelling.is_(False))
                .values(cancelling=True, stage="cancelling", revision=jobs.c.revision + 1)
            )
        return self._one(jobs.c.id == id, *changeable(jobs, owner))

    def share(self, id: str, shared: bool, owner: str | None = None) -> JobRecord | None:
        """Let every token read a job, or no longer; None where there is none to change."""
        mine = (jobs.c.home == self._home, jobs.c.id == id, *changeable(jobs, owner))
        with self._store.begin() as connection:
            connection.execute(jobs.update().where(*mine).values(shared=shared))
        return self._one(jobs.c.id == id, *changeable(jobs, owner))

    def delete(self, id: str, owner: str | None = None) -> bool:
        """Forget a job that has ended."""
        statement = jobs.delete().where(
            jobs.c.home == self._home,
            jobs.c.id == id,
            jobs.c.status.in_(ENDED),
            *changeable(jobs, owner),
        )
        with self._store.begin() as connection:
            return bool(connection.execute(statement).rowcount)

    # ---- what workers do -----------------------------------------------------------------------

    def claim(self, owner: str, lease: float) -> JobRecord | None:
        """Take the oldest free job for ``lease`` seconds; None where there is none."""
        clock = time.time()
        free = sa.and_(
            jobs.c.home == self._home,
            sa.or_(
                jobs.c.status == "queued",
                sa.and_(jobs.c.status == "running", jobs.c.lease_until < clock),
            ),
        )
        oldest = (
            sa.select(jobs.c.id).where(free).order_by(jobs.c.id).limit(1)
            .with_for_update(skip_locked=True).scalar_subquery()
        )  # fmt: skip
        statement = (
            jobs.update()
            .where(jobs.c.id == oldest, free)
            .values(
                status="running", owner=owner, lease_until=clock + lease, progress=0.0,
                stage="starting", attempts=jobs.c.attempts + 1, revision=jobs.c.revision + 1,
                started=sa.func.coalesce(jobs.c.started, now()),
            )
            .returning(*_COLUMNS)
        )  # fmt: skip
        with self._store.begin() as connection:
            row = connection.execute(statement).mappings().first()
        return JobRecord(**row) if row else None

    def beat(
        self, job: JobRecord, lease: float, *, progress: float | None = None, stage: str = ""
    ) -> Literal["go on", "cancel", "lost"]:
        """Prolong the lease and tell progress; says whether to go on."""
        values: dict[str, Any] = {"lease_until": time.time() + lease}
        if progress is not None:
            values |= {
                "progress": progress, "revision": jobs.c.revision + 1,
                "stage": sa.case((jobs.c.cancelling, jobs.c.stage), else_=stage),
            }  # fmt: skip
        statement = jobs.update().where(*_claimed(job)).values(values).returning(jobs.c.cancelling)
        with self._store.begin() as connection:
            row = connection.execute(statement).first()
        if row is None:
            return "lost"
        return "cancel" if row[0] else "go on"

    def finish(
        self,
        job: JobRecord,
        status: Literal["done", "failed", "cancelled"],
        *,
        result: str | None = None,
        summary: Mapping[str, Any] | None = None,
        error: Mapping[str, Any] | None = None,
    ) -> bool:
        """Write a job's end; False where the claim was lost, and then nothing is written."""
        values: dict[str, Any] = {
            "status": status, "stage": status, "finished": now(), "result": result,
            "summary": summary, "error": error, "owner": None, "lease_until": None,
            "revision": jobs.c.revision + 1,
        }  # fmt: skip
        if status == "done":
            values["progress"] = 1.0
        with self._store.begin() as connection:
            done = connection.execute(jobs.update().where(*_claimed(job)).values(values))
        return bool(done.rowcount)

    def give_back(self, job: JobRecord, *, counted: bool = False) -> bool:
        """Return a claimed job to the queue, as if it had never been claimed unless ``counted``."""
        attempts = job.attempts if counted else job.attempts - 1
        with self._store.begin() as connection:
            done = connection.execute(
                jobs.update().where(*_claimed(job)).values(**_queued(), attempts=attempts)
            )
        return bool(done.rowcount)

    def recover(self) -> int:
        """Return all running jobs to the queue: for who alone holds the data folder.

        That a server died is no fault of its jobs, so that it costs them no attempt.
        """
        with self._store.begin() as connection:
            done = connection.execute(
                jobs.update()
                .where(jobs.c.home == self._home, jobs.c.status == "running")
                .values(**_queued(), attempts=jobs.c.attempts - 1)
            )
        return int(done.rowcount)

    def needed_blobs(self, among: Collection[str]) -> set[str]:
        """Those contents that a job which has not ended still needs."""
        # A validation needs its clip only; there may be many, so these are found by column.
        found = self._open_inputs(
            sa.or_(jobs.c.clip_sha256.in_(sorted(among)), jobs.c.kind != "validate")
        )
        return {sha256 for inputs in found for sha256 in inputs.get("blobs", ())} & set(among)

    def needed_models(self) -> set[str]:
        """Folders of models that a job which has not ended still needs."""
        folders = {inputs.get("model", {}).get("folder") for inputs in self._open_inputs()}
        return folders - {None}

    def _open_inputs(self, *where: sa.ColumnElement[bool]) -> list[dict[str, Any]]:
        query = sa.select(jobs.c.inputs).where(
            jobs.c.home == self._home, jobs.c.status.in_(("queued", "running")), *where
        )
        with self._store.read() as connection:
            return list(connection.execute(query).scalars())


def _claimed(job: JobRecord) -> tuple[sa.ColumnElement[bool], ...]:
    return (
        jobs.c.id == job.id,
        jobs.c.status == "running",
        jobs.c.owner == job.owner,
        jobs.c.attempts == job.attempts,
    )


def _queued() -> dict[str, Any]:
    return {
        "status": "queued", "stage": "queued", "progress": 0.0, "owner": None,
        "lease_until": None, "revision": jobs.c.revision + 1,
    }  # fmt: skip
