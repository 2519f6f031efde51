"""Listening: one uvicorn server around one service, until a signal ends it."""

from __future__ import annotations

import signal
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import uvicorn
from fastapi import FastAPI
from uvicorn.server import HANDLED_SIGNALS

from physretarget.errors import InputError
from physretarget.service.app import create_app
from physretarget.service.protocol import Protocol
from physretarget.service.service import Service
from physretarget.service.settings import Settings

_HEADER_BYTES = 32 * 1024
_GRACE_S = 5


def serve(settings: Settings, listening: socket.socket, ready: Callable[[], None]) -> None:
    """Serve until SIGINT or SIGTERM; ``ready`` is called when requests are answered.

    Raises:
        UsageError: the data folder is in use, tokens are missing.
        InputError: the data folder or the history cannot be used.
    """
    service = Service(settings)
    try:
        Server(configuration(create_app(service), settings), ready, service).run(
            sockets=[listening]
        )
    except ssl.SSLError as error:
        service.stop()
        raise InputError(
            f"is no certificate with its key in PEM: {error}", path=settings.tls_cert
        ) from error


def configuration(app: FastAPI, settings: Settings | None = None) -> uvicorn.Config:
    """How uvicorn is to serve the application."""
    cert = settings.tls_cert if settings else None
    key = settings.tls_key if settings else None
    proxies = list(settings.proxies) if settings else []
    return uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=bool(proxies),
        forwarded_allow_ips=proxies,
        timeout_keep_alive=15,
        timeout_graceful_shutdown=_GRACE_S,
        h11_max_incomplete_event_size=_HEADER_BYTES,
        http=Protocol,
        ws="none",
        ssl_certfile=cert,
        ssl_keyfile=key,
    )


class Server(uvicorn.Server):
    """Tells when it listens, and lets streams end when it is to stop."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None], service: Service) -> None:
        super().__init__(config)
        self._ready = ready
        self._service = service

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """As uvicorn's, but a signal that was obeyed is not raised once more at the end."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {sig: signal.signal(sig, self.handle_exit) for sig in HANDLED_SIGNALS}
        try:
            yield
        finally:
            for sig, handler in before.items():
                signal.signal(sig, handler)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """As uvicorn's, then tell."""
        await super().startup(sockets=sockets)
        if self.started:
            self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """As uvicorn's, which waits for open answers; those of events end by themselves."""
        self._service.stopping = True
        await super().shutdown(sockets=sockets)
