"""Clips, models and tokens of the service in the history database."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import sqlalchemy as sa

from physretarget.suite.queue import new_id, now
from physretarget.suite.service_tables import changeable, clips, models, readable, tokens
from physretarget.suite.store import Store


@dataclass(frozen=True, kw_only=True)
class ClipRecord:
    """An uploaded clip or capture; its bytes are the blob of that SHA-256."""

    id: str
    name: str
    sha256: str
    bytes: int
    created: str
    belongs_to: str | None = None
    shared: bool = False


@dataclass(frozen=True, kw_only=True)
class ModelRecord:
    """A registered model; ``main`` is its MJCF file inside the model's folder."""

    id: str
    name: str
    sha256: str
    main: str
    facts: Mapping[str, Any]
    created: str
    belongs_to: str | None = None
    shared: bool = False


@dataclass(frozen=True, kw_only=True)
class TokenRecord:
    """A token without the token: only its SHA-256 is kept."""

    id: str
    name: str
    scope: str
    sha256: str
    created: str
    revoked: str | None


class Registry:
    """What was registered with one data folder (``home``)."""

    def __init__(self, store: Store, home: str) -> None:
        self._store = store
        self._home = home

    # ---- clips ---------------------------------------------------------------------------------

    def add_clip(self, name: str, sha256: str, size: int, owner: str | None = None) -> ClipRecord:
        """Register a clip."""
        made = ClipRecord(
            id=new_id(), name=name, sha256=sha256, bytes=size, created=now(), belongs_to=owner
        )
        self._add(clips, made)
        return made

    def clip(self, id: str, owner: str | None = None) -> ClipRecord | None:
        """A clip that ``owner`` (None: anybody) may read, None where there is none."""
        rows = self._rows(clips, clips.c.id == id, *readable(clips, owner))
        return ClipRecord(**rows[0]) if rows else None

    def clips(
        self, *, q: str | None, before: str | None, limit: int, owner: str | None = None
    ) -> list[ClipRecord]:
        """Clips that ``owner`` may read, newest first."""
        return [ClipRecord(**row) for row in self._page(clips, q, before, limit, owner)]

    def has_content(self, sha256: str) -> bool:
        """A clip of that content is registered."""
        return bool(self._rows(clips, clips.c.sha256 == sha256))

    def delete_clip(self, id: str, owner: str | None = None) -> bool:
        """Forget a clip that ``owner`` may change."""
        return self._delete(clips, id, owner)

    # ---- models --------------------------------------------------------------------------------

    def add_model(self, model: ModelRecord) -> None:
        """Register a model whose files are in place."""
        self._add(models, model)

    def model(self, id: str, owner: str | None = None) -> ModelRecord | None:
        """A model that ``owner`` (None: anybody) may read, None where there is none."""
        rows = self._rows(models, models.c.id == id, *readable(models, owner))
        return ModelRecord(**rows[0]) if rows else None

    def models(
        self, *, q: str | None, before: str | None, limit: int, owner: str | None = None
    ) -> list[ModelRecord]:
        """Models that ``owner`` may read, newest first."""
        return [ModelRecord(**row) for row in self._page(models, q, before, limit, owner)]

    def delete_model(self, id: str, owner: str | None = None) -> bool:
        """Forget a model that ``owner`` may change."""
        return self._delete(models, id, owner)

    def share(self, kind: Literal["clips", "models"], id: str, shared: bool,
              owner: str | None = None) -> bool:  # fmt: skip
        """Let every token read a clip or model, or no longer; False where there is none."""
        table = {"clips": clips, "models": models}[kind]
        statement = (
            table.update()
            .where(table.c.home == self._home, table.c.id == id, *changeable(table, owner))
            .values(shared=shared)
        )
        with self._store.begin() as connection:
            return bool(connection.execute(statement).rowcount)

    # ---- tokens --------------------------------------------------------------------------------

    def add_token(self, name: str, scope: str, sha256: str) -> TokenRecord:
        """Register a token by its hash."""
        made = TokenRecord(
            id=new_id(), name=name, scope=scope, sha256=sha256, created=now(), revoked=None
        )
        self._add(tokens, made)
        return made

    def tokens(self) -> list[TokenRecord]:
        """All tokens, the revoked ones too, oldest first."""
        return [TokenRecord(**row) for row in self._rows(tokens)]

    def revoke_token(self, id: str) -> bool:
        """End a token's validity; its row stays, so that tokens stay required."""
        statement = (
            tokens.update()
            .where(tokens.c.home == self._home, tokens.c.id == id, tokens.c.revoked.is_(None))
            .values(revoked=now())
        )
        with self._store.begin() as connection:
            return bool(connection.execute(statement).rowcount)

    # ---- shared --------------------------------------------------------------------------------

    def _add(self, table: sa.Table, record: Any) -> None:
        row = {name: getattr(record, name) for name in record.__dataclass_fields__}
        with self._store.begin() as connection:
            connection.execute(table.insert().values(home=self._home, **row))

    def _rows(self, table: sa.Table, *where: sa.ColumnElement[bool]) -> list[dict[str, Any]]:
        return self._read(
            sa.select(table).where(table.c.home == self._home, *where).order_by(table.c.id)
        )

    def _page(
        self, table: sa.Table, q: str | None, before: str | None, limit: int, owner: str | None
    ) -> list[dict[str, Any]]:
        query = sa.select(table).where(table.c.home == self._home, *readable(table, owner))
        if before is not None:
            query = query.where(table.c.id < before)
        if q:
            query = query.where(sa.func.lower(table.c.name).contains(q.lower(), autoescape=True))
        return self._read(query.order_by(table.c.id.desc()).limit(limit))

    def _read(self, query: sa.Select[Any]) -> list[dict[str, Any]]:
        with self._store.read() as connection:
            rows = [dict(row) for row in connection.execute(query).mappings()]
        for row in rows:
            row.pop("home")
        return rows

    def _delete(self, table: sa.Table, id: str, owner: str | None) -> bool:
        statement = table.delete().where(
            table.c.home == self._home, table.c.id == id, *changeable(table, owner)
        )
        with self._store.begin() as connection:
            return bool(connection.execute(statement).rowcount)
