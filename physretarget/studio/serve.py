"""The studio's server: one process, one file, until it is interrupted."""

from __future__ import annotations

import secrets
from collections.abc import Callable

import uvicorn

from physretarget.listen import address, listen
from physretarget.studio.app import build
from physretarget.studio.session import Session

LOCAL = ("127.0.0.1", "localhost", "::1")


def serve(session: Session, *, host: str, port: int, ready: Callable[[str], None]) -> None:
    """Serve a session until interrupted.

    Args:
        session: the file that is worked on.
        host, port: where to listen; port 0 takes a free one.
        ready: is told the address, with the token that it needs, before the first request.

    Raises:
        UsageError: the port is taken or not allowed.
    """
    with listen(host, port) as listening:
        token = secrets.token_urlsafe(18)
        ready(f"{address(listening, host)}/?token={token}")
        config = uvicorn.Config(
            build(session, token=token, hosts=[*LOCAL, host]), log_level="warning",
            access_log=False, server_header=False, timeout_graceful_shutdown=2,
        )  # fmt: skip
        uvicorn.Server(config).run(sockets=[listening])
