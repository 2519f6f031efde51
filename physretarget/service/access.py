"""Guards of the routes: token, scope, rate."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Annotated

from fastapi import Depends, Query, Request, Security
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from physretarget.service.below import route_path
from physretarget.service.errors import ApiError
from physretarget.service.service import Service
from physretarget.service.tokens import Caller, Scope

_bearer = HTTPBearer(
    auto_error=False, description="A token of 'physretarget token create'; none on loopback."
)
_KEPT = 10_000  # callers whose rate is remembered


def service_of(request: Request) -> Service:
    """The service behind this application."""
    found = request.app.state.service
    assert isinstance(found, Service)
    return found


ServiceOf = Annotated[Service, Depends(service_of)]
_Credentials = Annotated[HTTPAuthorizationCredentials | None, Security(_bearer)]


class Rates:
    """A bucket of requests for each caller, filled at a constant rate."""

    def __init__(
        self, rate: float, burst: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._rate, self._burst, self._clock = rate / 60.0, float(burst), clock
        self._lock = threading.Lock()
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str) -> float:
        """Take one request; the seconds to wait where there is none left, else 0."""
        if self._rate <= 0:
            return 0.0
        now = self._clock()
        with self._lock:
            left, at = self._buckets.pop(caller, (self._burst, now))
            left = min(self._burst, left + (now - at) * self._rate)
            wait = 0.0 if left >= 1 else (1 - left) / self._rate
            self._buckets[caller] = (left - 1 if left >= 1 else left, now)
            if len(self._buckets) > _KEPT:
                self._buckets.popitem(last=False)
        return wait


def _identify(request: Request, service: Service, token: str | None) -> Caller:
    address = request.client.host if request.client else "?"
    if not service.tokens.needed:
        return Caller(address, "admin")
    found = service.tokens.caller(token) if token else None
    if found is None:
        _slow_down(request.app.state.strangers, address)
        raise ApiError(401, "A valid token is needed.", headers={"WWW-Authenticate": "Bearer"})
    return found


def _slow_down(rates: Rates, caller: str) -> None:
    wait = rates.take(caller)
    if wait > 0:
        raise ApiError(
            429, "Too many requests.", headers={"Retry-After": str(max(1, round(wait + 0.5)))}
        )


def _guard(scope: Scope) -> Callable[..., Caller]:
    def check(request: Request, service: ServiceOf, given: _Credentials) -> Caller:
        caller = _identify(request, service, given.credentials if given else None)
        _slow_down(request.app.state.rates, caller.id)
        if not caller.may(scope):
            raise ApiError(403, f"The token's scope is {caller.scope}, {scope} is needed.")
        return caller

    return check


def _open(
    request: Request,
    service: ServiceOf,
    given: _Credentials,
    ticket: Annotated[
        str | None, Query(max_length=200, description="Of POST /api/v1/tickets, for frames.")
    ] = None,
) -> Caller:
    """As read, or with a ticket for exactly this path."""
    holder = service.tickets.holder(ticketed(request), ticket) if ticket is not None else None
    scope = service.tokens.holds(holder) if holder is not None else None
    if holder is not None and scope is not None:
        # As its maker sees things, who may have lost the token since.
        return Caller(holder, scope)
    return _guard("read")(request, service, given)


def ticketed(request: Request) -> str:
    """The path and query that a ticket is for: all but the ticket itself."""
    kept = [part for part in request.url.query.split("&") if part and part[:7] != "ticket="]
    return route_path(request) + ("?" + "&".join(kept) if kept else "")


Reader = Annotated[Caller, Depends(_guard("read"))]
Submitter = Annotated[Caller, Depends(_guard("submit"))]
Viewer = Annotated[Caller, Depends(_open)]
GUARDED: tuple[int, ...] = (400, 401, 403, 421, 429, 503)
"""Statuses that every guarded route may answer."""
