"""What a service depends on besides its data folder; read once when it starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from physretarget.sandbox.limits import Limits

LOOPBACK = ("127.0.0.1", "::1", "localhost")


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Times in seconds, sizes in bytes.

    ``hosts``: names under which the service may be asked; anything else in the Host header is
    refused, so that no page on the web can reach it by a name that it points here. Empty: any.
    ``rate`` requests per minute of one token or address, ``burst`` of them at once;
    ``stranger_rate`` those of an address without a valid token. 0: any number.
    ``tls_cert`` and ``tls_key`` are PEM files: with them it speaks https.
    ``root_path`` is the path below which a proxy offers the service, "/clips" say; ``proxies`` are
    the addresses and networks whose X-Forwarded-For and X-Forwarded-Proto are believed.
    ``reserve`` of free disk is kept: below it nothing is taken in and no job begins.
    """

    data: Path
    history: str | None = None
    workers: int = 2
    hosts: tuple[str, ...] = LOOPBACK
    require_tokens: bool = False
    limits: Limits = field(default_factory=Limits)
    lease: float = 20.0
    heartbeat: float = 4.0
    rate: float = 1200.0
    burst: int = 300
    stranger_rate: float = 60.0
    streams: int = 64
    stream_heartbeat: float = 10.0
    upload_idle: float = 30.0
    upload_rate: float = 4096.0
    check_seconds: float = 30.0
    reserve: int = 256 * 2**20
    tls_cert: Path | None = None
    tls_key: Path | None = None
    root_path: str = ""
    proxies: tuple[str, ...] = ()
