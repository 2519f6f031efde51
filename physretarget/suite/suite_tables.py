"""The suite's tables in the history database: runs, results, what each run found, baselines."""

from __future__ import annotations

import sqlalchemy as sa

_tables = sa.MetaData()
schema_version = sa.Table(
    "schema_version", _tables, sa.Column("version", sa.Integer, nullable=False)
)
runs = sa.Table(
    "runs", _tables,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("suite", sa.Text, nullable=False, index=True),
    sa.Column("started", sa.Text, nullable=False),
    sa.Column("finished", sa.Text),
    sa.Column("seconds", sa.Float),
    sa.Column("version", sa.Text, nullable=False),
    sa.Column("done", sa.Integer),
    sa.Column("counts", sa.JSON),
)  # fmt: skip
results = sa.Table(
    "results", _tables,
    sa.Column("address", sa.String(64), primary_key=True),
    sa.Column("status", sa.String(16), nullable=False),
    sa.Column("message", sa.Text, nullable=False),
    sa.Column("transient", sa.Boolean, nullable=False),
    sa.Column("seconds", sa.Float, nullable=False),
    sa.Column("created", sa.Text, nullable=False),
    sa.Column("measures", sa.JSON, nullable=False),
    sa.Column("findings", sa.JSON, nullable=False),
    sa.Column("document", sa.JSON),
)  # fmt: skip
artifacts = sa.Table(
    "artifacts", _tables,
    sa.Column("address", sa.String(64), primary_key=True),
    sa.Column("kind", sa.String(16), primary_key=True),
    sa.Column("content", sa.LargeBinary, nullable=False),
)  # fmt: skip
entries = sa.Table(
    "entries", _tables,
    sa.Column("run", sa.Integer, sa.ForeignKey("runs.id"), primary_key=True),
    sa.Column("clip", sa.Text, primary_key=True),
    sa.Column("address", sa.String(64)),
    sa.Column("baseline", sa.String(64)),
    sa.Column("case_name", sa.Text, nullable=False),
    sa.Column("kind", sa.String(16), nullable=False),
    sa.Column("tags", sa.JSON, nullable=False),
    sa.Column("owner", sa.Text, nullable=False),
    sa.Column("verdict", sa.String(16), nullable=False),
    sa.Column("reason", sa.Text, nullable=False),
    sa.Column("blocking", sa.Boolean, nullable=False),
    sa.Column("changes", sa.JSON, nullable=False),
)  # fmt: skip
baselines = sa.Table(
    "baselines", _tables,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("suite", sa.Text, nullable=False, index=True),
    sa.Column("clip", sa.Text, nullable=False),
    sa.Column("address", sa.String(64)),  # NULL: accepted as gone
    sa.Column("run", sa.Integer, nullable=False),
    sa.Column("note", sa.Text, nullable=False),
    sa.Column("accepted", sa.Text, nullable=False),
)  # fmt: skip


def create_suite_tables(connection: sa.Connection) -> None:
    """The first migration."""
    _tables.create_all(
        connection, tables=[runs, results, artifacts, entries, baselines], checkfirst=False
    )
