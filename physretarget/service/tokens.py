"""Who may do what: tokens with a scope, of which only a hash is kept.

A token is 256 random bits, so a plain SHA-256 of it cannot be searched back; slow hashes are
for passwords that people choose. Tokens are needed as soon as one was ever made, or where the
service listens beyond this machine: revoking the last one does not open the door again.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from physretarget.suite.registry import Registry, TokenRecord

Scope = Literal["read", "submit", "admin"]
SCOPES: tuple[Scope, ...] = ("read", "submit", "admin")
_PREFIX = "prt_"
_FORM = re.compile(r"prt_[A-Za-z0-9_-]{43}")
_FRESH_S = 2.0  # how long a look at the table holds
_TICKET_S = 120


@dataclass(frozen=True)
class Caller:
    """Who asks: a token's id, or the address of one who needs none."""

    id: str
    scope: Scope

    @property
    def owner(self) -> str | None:
        """Whose things the caller sees; None sees all."""
        return None if self.scope == "admin" else self.id

    def may(self, scope: Scope) -> bool:
        """Whether the scope includes this one: read < submit < admin."""
        return SCOPES.index(self.scope) >= SCOPES.index(scope)


def make_token() -> str:
    """A new token."""
    return _PREFIX + secrets.token_urlsafe(32)


def hashed(token: str) -> str:
    """What is kept of a token."""
    return hashlib.sha256(token.encode()).hexdigest()


class Tokens:
    """The tokens of a service, looked up without asking the database each time."""

    def __init__(
        self, registry: Registry, *, required: bool, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._registry = registry
        self._required = required
        self._clock = clock
        self._lock = threading.Lock()
        self._known: dict[str, TokenRecord] = {}
        self._until = -1.0

    @property
    def needed(self) -> bool:
        """Whether a request must bring a token."""
        return self._required or bool(self._table())

    @property
    def usable(self) -> bool:
        """Whether any token is valid."""
        return any(token.revoked is None for token in self._table().values())

    def caller(self, token: str) -> Caller | None:
        """Who that token stands for; None if it is not valid."""
        if not _FORM.fullmatch(token):
            return None
        found = self._table().get(hashed(token))
        if found is None or found.revoked is not None or found.scope not in SCOPES:
            return None
        return Caller(found.id, found.scope)

    def holds(self, id: str) -> Scope | None:
        """The scope of a token that is still valid, by its id; "admin" where none is needed."""
        if not self.needed:
            return "admin"
        for token in self._table().values():
            if token.id == id and token.revoked is None and token.scope in SCOPES:
                return token.scope
        return None

    def _table(self) -> dict[str, TokenRecord]:
        with self._lock:
            if self._clock() >= self._until:
                self._known = {token.sha256: token for token in self._registry.tokens()}
                self._until = self._clock() + _FRESH_S
            return self._known


class Tickets:
    """URLs that open without a header for a short time: a frame or a download cannot send one.

    The ticket is a code over path and time with a key that lives as long as the server.
    """

    seconds = _TICKET_S

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self._key = secrets.token_bytes(32)
        self._clock = clock

    def make(self, path: str, caller: str) -> str:
        """A ticket for a path with its query, in the name of a caller."""
        until = str(int(self._clock()) + self.seconds)
        return f"{until}.{self._code(path, until, caller)}.{caller}"

    def holder(self, path: str, ticket: str) -> str | None:
        """In whose name the ticket opens that path; None if it does not, or no longer."""
        until, _, rest = ticket.partition(".")
        code, _, caller = rest.partition(".")
        if not (until.isascii() and until.isdigit() and len(until) < 12 and rest.isascii()):
            return None
        right = hmac.compare_digest(code, self._code(path, until, caller))
        return caller if right and int(until) >= self._clock() else None

    def _code(self, path: str, until: str, caller: str) -> str:
        return hmac.new(self._key, f"{until} {caller} {path}".encode(), "sha256").hexdigest()
