"""The service's tables in the history database: jobs, clips, models, tokens.

``home`` in each is the data folder that a row belongs to: files lie there, so a service only
ever sees its own rows, whoever else shares the database.
"""

from __future__ import annotations

import sqlalchemy as sa

_tables = sa.MetaData()

jobs = sa.Table(
    "service_jobs", _tables,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("home", sa.String(32), nullable=False),
    sa.Column("kind", sa.String(16), nullable=False),
    sa.Column("status", sa.String(16), nullable=False),
    sa.Column("progress", sa.Float, nullable=False),
    sa.Column("stage", sa.Text, nullable=False),
    sa.Column("created", sa.Text, nullable=False),
    sa.Column("started", sa.Text),
    sa.Column("finished", sa.Text),
    sa.Column("clip_name", sa.Text, nullable=False),
    sa.Column("clip_sha256", sa.String(64), nullable=False),
    sa.Column("model_id", sa.String(32)),
    sa.Column("model_name", sa.Text, nullable=False),
    sa.Column("options", sa.JSON, nullable=False),
    sa.Column("inputs", sa.JSON, nullable=False),  # what the worker needs; never shown
    sa.Column("summary", sa.JSON),
    sa.Column("error", sa.JSON),
    sa.Column("attempts", sa.Integer, nullable=False),
    sa.Column("revision", sa.Integer, nullable=False),
    sa.Column("cancelling", sa.Boolean, nullable=False),
    sa.Column("owner", sa.Text),  # who holds the lease, and until when (seconds since 1970)
    sa.Column("lease_until", sa.Float),
    sa.Column("result", sa.Text),  # folder of the results inside the job's
    sa.Column("idempotency", sa.Text),
    sa.Column("fingerprint", sa.String(64), nullable=False),
    sa.Index("service_jobs_by_status", "home", "status", "id"),
    sa.Index("service_jobs_once", "home", "idempotency", unique=True),
)  # fmt: skip
clips = sa.Table(
    "service_clips", _tables,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("home", sa.String(32), nullable=False),
    sa.Column("name", sa.Text, nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("bytes", sa.BigInteger, nullable=False),
    sa.Column("created", sa.Text, nullable=False),
    sa.Index("service_clips_by_home", "home", "id"),
)  # fmt: skip
models = sa.Table(
    "service_models", _tables,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("home", sa.String(32), nullable=False),
    sa.Column("name", sa.Text, nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("main", sa.Text, nullable=False),  # the MJCF file inside the model's folder
    sa.Column("facts", sa.JSON, nullable=False),
    sa.Column("created", sa.Text, nullable=False),
    sa.Index("service_models_by_home", "home", "id"),
)  # fmt: skip
tokens = sa.Table(
    "service_tokens", _tables,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("home", sa.String(32), nullable=False),
    sa.Column("name", sa.Text, nullable=False),
    sa.Column("scope", sa.String(16), nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False, unique=True),
    sa.Column("created", sa.Text, nullable=False),
    sa.Column("revoked", sa.Text),
)  # fmt: skip


def create_service_tables(connection: sa.Connection) -> None:
    """The migration that adds them; never edited, only followed by others."""
    _tables.create_all(connection, checkfirst=False)


_OWNED = ("service_jobs", "service_clips", "service_models")


def add_owners(connection: sa.Connection) -> None:
    """The migration that says whose a job, clip or model is; never edited.

    ``belongs_to`` is the id of the token that made it, none for what was there before (an admin's);
    ``shared`` lets every token read it.
    """
    for table in _OWNED:
        for column in ("belongs_to VARCHAR(64)", "shared BOOLEAN NOT NULL DEFAULT FALSE"):
            connection.execute(sa.text(f"ALTER TABLE {table} ADD COLUMN {column}"))


owners = sa.MetaData()


def _with_owner(table: sa.Table) -> sa.Table:
    """A table as it is after :func:`add_owners`: the first migration must not make its columns."""
    later = table.to_metadata(owners)
    later.append_column(sa.Column("belongs_to", sa.String(64)))
    later.append_column(sa.Column("shared", sa.Boolean, nullable=False, server_default=sa.false()))
    return later


jobs, clips, models = _with_owner(jobs), _with_owner(clips), _with_owner(models)


def readable(table: sa.Table, owner: str | None) -> list[sa.ColumnElement[bool]]:
    """Conditions for what an owner may read: what is theirs or shared; None may read all."""
    if owner is None:
        return []
    return [sa.or_(table.c.belongs_to == owner, table.c.shared.is_(True))]


def changeable(table: sa.Table, owner: str | None) -> list[sa.ColumnElement[bool]]:
    """Conditions for what an owner may change; None may change all."""
    return [] if owner is None else [table.c.belongs_to == owner]
