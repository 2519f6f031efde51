"""Around every request: its id, the Host header, security headers, the log line, metrics."""

from __future__ import annotations

import json
import logging
import re
import secrets
import time
from collections.abc import Mapping

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physretarget.service.errors import body
from physretarget.service.metrics import Metrics

log = logging.getLogger("physretarget.service.access")
_ID = re.compile(rb"[A-Za-z0-9._-]{1,64}")
_HOST = re.compile(r"\[?([^\]]*?)\]?(?::\d{1,5})?")
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}
_POLICY = "default-src 'none'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
_HARMLESS = frozenset({"GET", "HEAD", "OPTIONS"})
_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"})


class Envelope:
    """ASGI middleware, outermost."""

    def __init__(self, app: ASGIApp, *, hosts: tuple[str, ...], metrics: Metrics) -> None:
        self._app = app
        self._hosts = frozenset(host.lower() for host in hosts)
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        given = headers.get(b"x-request-id", b"")
        id = given.decode() if _ID.fullmatch(given) else secrets.token_hex(8)
        scope["request_id"] = id
        record = _Record(scope, id)
        if self._hosts and not self._known(headers.get(b"host", b"")):
            answer = _error(421, "misdirected", "This service is not known by that name.", id)
            await _reply(answer, record.wrap(send))
        elif scope["method"] not in _HARMLESS and _from_elsewhere(headers):
            message = "Pages of other sites may not change anything here."
            await _reply(_error(403, "forbidden", message, id), record.wrap(send))
        else:
            await self._guarded(scope, receive, record.wrap(send), record)
        record.close(self._metrics)

    async def _guarded(self, scope: Scope, receive: Receive, send: Send, record: _Record) -> None:
        try:
            await self._app(scope, receive, send)
        except Exception:
            log.exception("request failed", extra={"request_id": record.id})
            if record.status:
                raise
            message = "Something went wrong in the service; the log tells more."
            await _reply(_error(500, "internal", message, record.id), send)

    def _known(self, host: bytes) -> bool:
        found = _HOST.fullmatch(host.decode("latin-1"))
        return found is not None and found[1].lower() in self._hosts


def _from_elsewhere(headers: Mapping[bytes, bytes]) -> bool:
    """Whether a browser sends this for a page of another origin.

    A form needs nobody's permission to post, and where no token is needed it would be obeyed.
    """
    if headers.get(b"sec-fetch-site", b"none") not in (b"same-origin", b"none"):
        return True
    origin = headers.get(b"origin")
    return origin is not None and origin.partition(b"://")[2] != headers.get(b"host", b"")


class _Record:
    """What is known of one request when it ends."""

    def __init__(self, scope: Scope, id: str) -> None:
        self.id = id
        self.status = 0
        self._scope = scope
        self._began = time.perf_counter()
        self._first = 0.0

    def wrap(self, send: Send) -> Send:
        async def wrapped(message: Message) -> None:
            if message["type"] == "http.response.start":
                self.status = int(message["status"])
                self._first = time.perf_counter() - self._began
                headers = MutableHeaders(scope=message)
                headers["X-Request-ID"] = self.id
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
                headers.setdefault("Content-Security-Policy", _POLICY)
                headers.setdefault("Cache-Control", "no-store")
            await send(message)

        return wrapped

    def close(self, metrics: Metrics) -> None:
        route = getattr(self._scope.get("route"), "path", "other")
        method = self._scope["method"] if self._scope["method"] in _METHODS else "other"
        metrics.requests.labels(method, route, str(self.status)).inc()
        metrics.latency.labels(method, route).observe(self._first)
        client = self._scope.get("client")
        log.info(
            "%s %s %s", method, self._scope["path"][:200], self.status,
            extra={
                "request_id": self.id, "method": method, "route": route, "status": self.status,
                "client": client[0] if client else None,
                "seconds": round(time.perf_counter() - self._began, 4),
            },
        )  # fmt: skip


def _error(status: int, code: str, message: str, id: str) -> tuple[int, bytes]:
    return status, json.dumps(body(id, code, message)).encode()


async def _reply(answer: tuple[int, bytes], send: Send) -> None:
    status, content = answer
    headers = [(b"content-type", b"application/json"),
               (b"content-length", str(len(content)).encode())]  # fmt: skip
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": content})
