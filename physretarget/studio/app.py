"""The studio over HTTP: JSON in, JSON out, one page. On this machine only, behind a token.

Every change names the revision that it was made on; on an older one it is refused with 409 and the
new state, so that two tabs never write over each other.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import FastAPI, Request
from fastapi.responses import FileResponse, HTMLResponse, JSONResponse, Response
from fastapi.staticfiles import StaticFiles
from pydantic import BaseModel, Field
from starlette.middleware.trustedhost import TrustedHostMiddleware

from physretarget.errors import PhysretargetError, UsageError
from physretarget.keyposes import (
    actor_character_of_reference,
    settled,
)
from physretarget.keyposes.candidates import next_frames
from physretarget.replay.figures import figure
from physretarget.replay.payload import payload
from physretarget.replay.scene import Scene
from physretarget.replay.web import asset
from physretarget.report.text import one_line
from physretarget.studio.answers import (
    Gesture,
    Name,
    Planted,
    Point,
    Qpos,
    posed,
    stage_of,
    state_of,
)
from physretarget.studio.rehearsal import Rehearsal
from physretarget.studio.session import Conflict, Session, free_name
from physretarget.studio.surface import surface_point

WEB = Path(__file__).with_name("web")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
MOST_BYTES = 256 * 1024
_TOKEN = "x-studio-token"
_SHARED = ("three.min.js", "clock.js", "stage.js")


class Change(BaseModel):
    """A change of the file; which fields it needs depends on what it does."""

    revision: int
    name: Name = ""
    other: Name = ""
    limb: Name | None = None
    share: float = 1.0
    qpos: Qpos = []
    planted: Planted | None = None
    take: int = 0
    time: float = 0.0
    eye: Point | None = None
    way: Point | None = None


def build(session: Session, *, token: str, hosts: list[str]) -> FastAPI:
    """The application.

    Args:
        session: the file that is worked on.
        token: what requests must show; the page has it from its address.
        hosts: names by which the studio may be asked for.
    """
    app = FastAPI(title="physretarget studio", docs_url=None, redoc_url=None, openapi_url=None)
    rehearsal = Rehearsal(session)
    _guard(app, token)
    app.add_middleware(TrustedHostMiddleware, allowed_hosts=hosts)
    _pages(app)
    _looks(app, session, rehearsal)
    _changes(app, session, rehearsal)
    return app


def _guard(app: FastAPI, token: str) -> None:
    @app.middleware("http")
    async def guard(request: Request, call: Callable[[Request], Awaitable[Response]]) -> Response:
        if request.url.path.startswith("/api/"):
            shown = request.headers.get(_TOKEN, "")
            if not hmac.compare_digest(shown.encode(), token.encode()):
                return _refusal(403, "open the studio by the address that it printed.")
            length = request.headers.get("content-length", "0")
            if request.method == "POST" and not (length.isdecimal() and int(length) < MOST_BYTES):
                return _refusal(413, f"a request has at most {MOST_BYTES} bytes.")
        answer = await call(request)
        answer.headers.setdefault("Content-Security-Policy", POLICY)
        answer.headers.setdefault("X-Content-Type-Options", "nosniff")
        answer.headers.setdefault("Referrer-Policy", "no-referrer")
        answer.headers.setdefault("Cache-Control", "no-store")
        return answer

    @app.exception_handler(PhysretargetError)
    def unusable(request: Request, error: PhysretargetError) -> Response:
        return _refusal(409 if isinstance(error, Conflict) else 422, str(error))


def _refusal(status: int, message: str) -> JSONResponse:
    return JSONResponse({"error": message}, status_code=status)


def _pages(app: FastAPI) -> None:
    @app.get("/")
    def page() -> Response:
        return FileResponse(WEB / "index.html", media_type="text/html")

    @app.get("/shared/{name}")
    def shared(name: str) -> Response:
        if name not in _SHARED:
            return HTMLResponse("not found", status_code=404)
        return Response(asset(name), media_type="text/javascript")

    app.mount("/web", StaticFiles(directory=WEB, follow_symlink=False), name="web")


def _looks(app: FastAPI, session: Session, rehearsal: Rehearsal) -> None:
    """What changes nothing."""

    @app.get("/api/state")
    def state() -> dict[str, Any]:
        return state_of(session)

    @app.get("/api/stage")
    def stage() -> dict[str, Any]:
        """The character as it can be posed, and the captures."""
        return stage_of(session)

    @app.get("/api/takes/{take}")
    def actor(take: int) -> dict[str, Any]:
        """The actor's motion of a capture, as a scene."""
        own = session.take(take)
        shown = figure(
            actor_character_of_reference(), own.qpos, name="actor", tint=(0.55, 0.62, 0.75)
        )
        return payload(Scene(title=own.name, time=own.motion.time, figures=(shown,)))

    @app.post("/api/drag")
    def drag(gesture: Gesture) -> dict[str, Any]:
        """The pose after a small move of the hand; nothing is kept."""
        return posed(session, gesture)

    @app.get("/api/coverage")
    def coverage() -> dict[str, Any]:
        """How well each moment of the captures is known."""
        found = rehearsal.coverage(session.keyposes)
        candidates = found.candidates
        return {
            "expected": found.expected,
            "takes": [
                {
                    "time": [
                        candidates.time(int(k)) for k in np.flatnonzero(candidates.motion == n)
                    ],
                    "unknown": found.unknown[candidates.motion == n].tolist(),
                }
                for n in range(len(session.takes))
            ],
        }

    @app.get("/api/suggest")
    def queue(count: Annotated[int, Field(ge=1, le=50)] = 8) -> list[dict[str, Any]]:
        """Which frames to pose next, best first, and why."""
        candidates = rehearsal.candidates()
        return [
            {
                "take": int(candidates.motion[each.suggestion.index]),
                "time": candidates.time(each.suggestion.index),
                "score": each.suggestion.score, "reason": each.reason,
            }
            for each in next_frames(candidates, session.keyposes, count=count)
        ]  # fmt: skip

    @app.get("/api/play/{take}")
    def play(
        take: int,
        until: Literal["mapped", "placed", "contacted", "physical", "balanced"] = "mapped",
    ) -> dict[str, Any]:
        """The take played by the character with the key poses as they are."""
        session.take(take)
        played = rehearsal.play(session.keyposes, take, until)
        clip, report = played.made.clip, played.report
        shown = figure(session.character, clip.qpos, name=session.character.name)
        return {
            "scene": payload(Scene(title=clip.name, time=clip.time, figures=(shown,))),
            "verdict": None if report is None else report.verdict,
            "words": None if report is None else one_line(report),
        }


def _changes(app: FastAPI, session: Session, rehearsal: Rehearsal) -> None:
    """What changes the file."""

    @app.post("/api/add")
    def add(change: Change) -> dict[str, Any]:
        name = session.add(change.take, change.time, change.revision)
        return {**state_of(session), "selected": name}

    @app.post("/api/put")
    def put(change: Change) -> dict[str, Any]:
        qpos = np.array(change.qpos)
        session.put(change.name, qpos, change.revision, planted=change.planted)
        return state_of(session)

    @app.post("/api/plant")
    def plant(change: Change) -> dict[str, Any]:
        pose = session.find(change.name)
        down = settled(session.character, pose.qpos, planted=pose.planted)
        session.put(change.name, down, change.revision, what="put down")
        return state_of(session)

    @app.post("/api/reset")
    def reset(change: Change) -> dict[str, Any]:
        qpos = rehearsal.mapped_pose(session.keyposes, session.find(change.name))
        session.put(change.name, qpos, change.revision, what="reset")
        return state_of(session)

    @app.post("/api/rename")
    def rename(change: Change) -> dict[str, Any]:
        session.rename(change.name, change.other, change.revision)
        return state_of(session)

    @app.post("/api/delete")
    def delete(change: Change) -> dict[str, Any]:
        session.delete(change.name, change.revision)
        return state_of(session)

    @app.post("/api/mirror")
    def mirror(change: Change) -> dict[str, Any]:
        name = session.mirror(change.name, change.revision)
        return {**state_of(session), "selected": name}

    @app.post("/api/blend")
    def blend(change: Change) -> dict[str, Any]:
        session.blend(change.name, change.other, change.share, change.revision)
        return state_of(session)

    @app.post("/api/limb")
    def limb(change: Change) -> dict[str, Any]:
        session.choose_limb(change.name, change.limb, change.revision)
        return state_of(session)

    @app.post("/api/point")
    def point(change: Change) -> dict[str, Any]:
        """Put the named point, or a new one, where the ray of a click meets the character."""
        body, place = _clicked(session, change)
        name, tie = change.name, change.other or None
        if not name:
            name = free_name(f"contact_{tie or 'point'}", set(session.character.contacts.names))
        session.put_point(name, body, place, change.revision, tie=tie)
        return state_of(session)

    @app.post("/api/point/tie")
    def tie(change: Change) -> dict[str, Any]:
        """Which of the actor's points a contact point follows."""
        contacts = session.character.contacts
        if change.name not in contacts.names:
            raise UsageError(f"there is no contact point {change.name!r}.")
        at = contacts.names.index(change.name)
        session.put_point(
            change.name, int(contacts.body[at]), contacts.local[at], change.revision,
            tie=change.other or None,
        )  # fmt: skip
        return state_of(session)

    @app.post("/api/point/drop")
    def drop(change: Change) -> dict[str, Any]:
        session.drop_point(change.name, change.revision)
        return state_of(session)

    @app.post("/api/undo")
    def undo(change: Change) -> dict[str, Any]:
        session.undo(change.revision)
        return state_of(session)

    @app.post("/api/redo")
    def redo(change: Change) -> dict[str, Any]:
        session.redo(change.revision)
        return state_of(session)


def _clicked(session: Session, change: Change) -> tuple[int, np.ndarray[Any, np.dtype[np.float64]]]:
    qpos, tree = np.array(change.qpos), session.character.tree
    if change.eye is None or change.way is None:
        raise UsageError("a point is placed by a ray: eye and way are needed.")
    if qpos.shape != (tree.nq,) or not np.isfinite(qpos).all():
        raise UsageError(f"a pose has {tree.nq} finite numbers.")
    found = surface_point(session.character, qpos, np.array(change.eye), np.array(change.way))
    if found is None:
        raise UsageError("there is nothing of the character: click on it.")
    return found
