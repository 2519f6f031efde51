"""The service below a path of a proxy's, "/clips" say: where requests and links lead.

A proxy may take that path away before it passes a request on, or leave it: both are understood.
"""

from __future__ import annotations

from fastapi import Request
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

__all__ = ["Below", "route_path"]


class Below:
    """ASGI middleware: tells the application its path as ASGI says, in ``root_path``."""

    def __init__(self, app: ASGIApp, *, root: str) -> None:
        self._app, self._root = app, root

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one connection."""
        root = self._root
        if scope["type"] == "http" and root:
            path = scope["path"]
            if path == root:
                await RedirectResponse(f"{root}/")(scope, receive, send)
                return
            inside = path if path.startswith(f"{root}/") else root + path
            scope = {**scope, "root_path": root, "path": inside}
        await self._app(scope, receive, send)


def route_path(request: Request) -> str:
    """The path that routes know, without what a proxy put before it.

    Args:
        request: the request.

    Returns:
        The path, beginning with "/".
    """
    return str(request.url.path).removeprefix(request.scope.get("root_path", ""))
