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
