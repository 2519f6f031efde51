"""One error body for everything that goes wrong, and how the API's description tells of it."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from starlette.exceptions import HTTPException
from starlette.routing import compile_path

from physretarget.errors import PhysretargetError
from physretarget.service.below import route_path

log = logging.getLogger("physretarget.service")

CODES = {
    400: "bad_request", 401: "unauthorized", 403: "forbidden", 404: "not_found",
    405: "method_not_allowed", 406: "not_acceptable", 408: "timeout", 409: "conflict",
    411: "length_required", 413: "too_large", 415: "unsupported_media_type",
    421: "misdirected", 422: "invalid", 429: "too_many_requests", 500: "internal",
    503: "unavailable", 507: "insufficient_storage",
}  # fmt: skip
_TOLD = {
    400: "The request cannot be understood.", 401: "A valid token is missing.",
    403: "The token's scope does not suffice.", 404: "There is no such thing.",
    408: "The upload came too slowly.", 409: "The state does not allow it.",
    413: "More was sent than is accepted.", 415: "Another media type is expected.",
    421: "The Host header names another service.",
    422: "Something in the request is not valid.", 429: "Too many requests; see Retry-After.",
    503: "Too much at once; try again.",
    507: "The disk is full up to the reserve; delete jobs, or make room.",
}  # fmt: skip


class ErrorDetail(BaseModel):
    """What went wrong."""

    model_config = ConfigDict(extra="forbid")
    code: str = Field(description="Stable name of the kind of error.", examples=["not_found"])
    message: str = Field(description="One sentence for a person.")
    field: str | None = Field(default=None, description="The part of the request it is about.")
    request_id: str = Field(description="Also in the header X-Request-ID and in the log.")


class ErrorBody(BaseModel):
    """The body of every answer with a status of 400 or more."""

    model_config = ConfigDict(extra="forbid")
    error: ErrorDetail


class ApiError(Exception):
    """An answer that is an error."""

    def __init__(
        self,
        status: int,
        message: str,
        *,
        code: str | None = None,
        field: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.message = message
        self.code = code or CODES[status]
        self.field = field
        self.headers = dict(headers or {})


def responses(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The error answers of a route, for the API's description."""
    return {
        status: {"model": ErrorBody, "description": _TOLD[status]}
        for status in sorted(set(statuses))
    }


def body(request_id: str, code: str, message: str, field: str | None = None) -> dict[str, Any]:
    """The error body as plain data."""
    detail = {"code": code, "message": message, "request_id": request_id}
    return {"error": {**detail, "field": field} if field else detail}


def install(app: FastAPI) -> None:
    """Answer every error with the one body."""
    app.add_exception_handler(ApiError, _api_error)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(PhysretargetError, _failed)


def _answer(request: Request, error: ApiError) -> JSONResponse:
    id = str(request.scope.get("request_id", ""))
    content = body(id, error.code, error.message, error.field)
    return JSONResponse(content, status_code=error.status, headers=error.headers)


async def _api_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, ApiError)
    return _answer(request, error)


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    code = CODES.get(error.status_code, "error")
    message = {
        404: f"There is nothing at {request.url.path}.",
        405: f"{request.method} is not possible at {request.url.path}.",
    }.get(error.status_code, str(error.detail))
    headers = dict(error.headers or {})
    if error.status_code == 405 and "allow" in {name.lower() for name in headers}:
        headers = {"Allow": ", ".join(_methods(request)) or next(iter(headers.values()))}
    told = ApiError(error.status_code, message, code=code, headers=headers)
    return _answer(request, told)


def _methods(request: Request) -> list[str]:
    """All methods of a path: the router names only those of the first route that matches."""
    found: set[str] = set()
    for path, operations in request.app.openapi()["paths"].items():
        if compile_path(path)[0].match(route_path(request)):
            found |= {name.upper() for name in operations}
    return sorted(found)


async def _invalid(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    place = [str(part) for part in first.get("loc", ())]
    field = ".".join(place[1:]) or (place[0] if place else None)
    return _answer(request, ApiError(422, f"{first['msg']}.", field=field))


async def _failed(request: Request, error: Exception) -> JSONResponse:
    # Raised on purpose by a room below, yet not foreseen here: the database is away, say.
    log.error("request failed: %s", error, extra={"request_id": request.scope.get("request_id")})
    return _answer(request, ApiError(503, "The service cannot do this at the moment."))
