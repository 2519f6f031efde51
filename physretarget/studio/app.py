"""The studio over HTTP: JSON in, JSON out, one page. On this machine only, behind a token.

Every change names the revision that it was made on; on an older one it is refused with 409 and the
new state, so that two tabs never write over each other.
"""

from __future__ import annotations

import hmac
from collections.abc import Awaitable, Callable
from dataclasses import replace
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
    KeyPose,
    KeyPoseSet,
    actor_character_of_reference,
    check,
    settled,
)
from physretarget.keyposes.candidates import next_frames
from physretarget.keyposes.face import face_of
from physretarget.keyposes.layout import layout_of
from physretarget.keyposes.limbs import ACTOR_LIMBS, limb_names, limbs_of
from physretarget.keyposes.propose import SIGHT, gazes
from physretarget.keyposes.settle import Pull, pulled
from physretarget.kinematics import forward, points
from physretarget.mjcf import Character
from physretarget.replay.figures import body_poses, figure
from physretarget.replay.payload import payload
from physretarget.replay.scene import Scene
from physretarget.replay.web import asset
from physretarget.report.text import one_line
from physretarget.studio.live import live
from physretarget.studio.rehearsal import Rehearsal
from physretarget.studio.session import Conflict, Session

WEB = Path(__file__).with_name("web")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
MOST_BYTES = 256 * 1024
_TOKEN = "x-studio-token"
_SHARED = ("three.min.js", "clock.js", "stage.js")

Name = Annotated[str, Field(max_length=300)]
Qpos = Annotated[list[float], Field(max_length=2000)]
Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Planted = Annotated[list[Annotated[str, Field(max_length=60)]], Field(max_length=20)]


class Hand(BaseModel):
    """A point of a body that is dragged, and where to."""

    body: int = Field(ge=1)
    local: Point
    target: Point


class Gesture(BaseModel):
    """What the hand does to a pose: drags points, or sets a joint; with ``gaze`` the face keeps
    looking where it looks in the file."""

    name: Name
    qpos: Qpos
    planted: Planted = []
    gaze: bool = False
    hands: Annotated[list[Hand], Field(max_length=8)] = []
    joint: Name | None = None
    value: float = 0.0


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


def build(session: Session, *, token: str, hosts: list[str]) -> FastAPI:
    """The application.

    Args:
        session: the file that is worked on.
        token: what requests must show; the page has it from its address.
        hosts: names by which the studio may be asked for.
    """
    app = FastAPI(title="physretarget studio", docs_url=None, redoc_url=None, openapi_url=None)
    rehearsal = Rehearsal(session.character, session.takes)
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
        return _state(session)

    @app.get("/api/stage")
    def stage() -> dict[str, Any]:
        """The character as it can be posed, and the captures."""
        return _stage(session)

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
        return _posed(session, gesture)

    @app.get("/api/coverage")
    def coverage() -> dict[str, Any]:
        """How well each moment of the captures is known."""
        found = rehearsal.coverage(session.keyposes)
        candidates = found.candidates
        return {
            "mean": found.mean,
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
        return {**_state(session), "selected": name}

    @app.post("/api/put")
    def put(change: Change) -> dict[str, Any]:
        qpos = np.array(change.qpos)
        session.put(change.name, qpos, change.revision, planted=change.planted)
        return _state(session)

    @app.post("/api/plant")
    def plant(change: Change) -> dict[str, Any]:
        pose = session.find(change.name)
        down = settled(session.character, pose.qpos, planted=pose.planted)
        session.put(change.name, down, change.revision, what="put down")
        return _state(session)

    @app.post("/api/reset")
    def reset(change: Change) -> dict[str, Any]:
        qpos = rehearsal.mapped_pose(session.keyposes, session.find(change.name))
        session.put(change.name, qpos, change.revision, what="reset")
        return _state(session)

    @app.post("/api/rename")
    def rename(change: Change) -> dict[str, Any]:
        session.rename(change.name, change.other, change.revision)
        return _state(session)

    @app.post("/api/delete")
    def delete(change: Change) -> dict[str, Any]:
        session.delete(change.name, change.revision)
        return _state(session)

    @app.post("/api/mirror")
    def mirror(change: Change) -> dict[str, Any]:
        name = session.mirror(change.name, change.revision)
        return {**_state(session), "selected": name}

    @app.post("/api/blend")
    def blend(change: Change) -> dict[str, Any]:
        session.blend(change.name, change.other, change.share, change.revision)
        return _state(session)

    @app.post("/api/limb")
    def limb(change: Change) -> dict[str, Any]:
        session.choose_limb(change.name, change.limb, change.revision)
        return _state(session)

    @app.post("/api/undo")
    def undo(change: Change) -> dict[str, Any]:
        session.undo(change.revision)
        return _state(session)

    @app.post("/api/redo")
    def redo(change: Change) -> dict[str, Any]:
        session.redo(change.revision)
        return _state(session)


def _state(session: Session) -> dict[str, Any]:
    keyposes = session.keyposes
    remarks = check(keyposes, session.character)
    return {
        "revision": session.revision,
        "undo": session.undoable,
        "redo": session.redoable,
        "limbs": _limbs(session.character, keyposes),
        "remarks": [
            {"pose": r.pose, "severity": r.severity, "message": r.message} for r in remarks
        ],
        "poses": [
            {
                "name": pose.name, "source": pose.source, "time": pose.time, "note": pose.note,
                "planted": list(pose.planted), "take": _take_of(session, pose),
                "qpos": pose.qpos.tolist(),
            }
            for pose in keyposes.poses
        ],
    }  # fmt: skip


def _limbs(character: Character, keyposes: KeyPoseSet) -> dict[str, Any]:
    """Which limb acts for each of the actor's: as chosen (None: by the shape), and in effect."""
    chosen = dict(keyposes.limbs)
    names = {limb.name: limb.first for limb in limbs_of(character, keyposes.limbs)}
    return {
        actor: {
            "chosen": chosen.get(actor),
            "acts": character.model.body(names[actor]).name if actor in names else "",
        }
        for actor in ACTOR_LIMBS
    }


def _take_of(session: Session, pose: KeyPose) -> int | None:
    for number, take in enumerate(session.takes):
        if take.motion.source.sha256 == pose.sha256:
            return number
    return None


def _stage(session: Session) -> dict[str, Any]:
    character = session.character
    rest = session.canonical(character.reference_qpos)
    shown = figure(character, rest[None], name=character.name)
    layout, joints = layout_of(character), []
    for name, joint in zip(layout.names, character.tree.joints, strict=True):
        if joint.kind not in ("hinge", "slide"):
            continue
        low, high = float(character.lower[joint.qpos]), float(character.upper[joint.qpos])
        joints.append(
            {
                "name": name, "kind": joint.kind, "qpos": joint.qpos, "body": joint.body,
                "low": low if np.isfinite(low) else None,
                "high": high if np.isfinite(high) else None,
                "axis": joint.axis.tolist(), "anchor": joint.anchor.tolist(),
            }
        )  # fmt: skip
    contacts = character.contacts
    handles = [
        {"name": name, "body": int(body), "local": local.tolist(), "tie": tie}
        for name, body, local, tie in zip(
            contacts.names, contacts.body, contacts.local, character.tied, strict=True
        )
    ]
    model = character.model
    for body in character.bodies.tolist():
        handles.append(
            {
                "name": model.body(body).name or f"body {body}", "body": body,
                "local": np.array(model.body_ipos[body]).tolist(), "tie": None,
            }
        )  # fmt: skip
    return {
        "file": str(session.path), "character": character.name, "height": character.height,
        "scene": payload(Scene(title=character.name, time=np.zeros(1), figures=(shown,))),
        "joints": joints, "handles": handles, "rest": rest.tolist(),
        "takes": [
            {"name": take.name, "seconds": float(take.motion.time[-1])} for take in session.takes
        ],
        "limbs": limb_names(character), "face": face_of(character) is not None,
        "points": sorted({tie for tie in character.tied if tie is not None}),
    }  # fmt: skip


def _moved(session: Session, gesture: Gesture) -> np.ndarray[Any, np.dtype[np.float64]]:
    character = session.character
    qpos = np.array(gesture.qpos)
    if qpos.shape != (character.tree.nq,) or not np.isfinite(qpos).all():
        raise UsageError(f"a pose has {character.tree.nq} finite numbers.")
    held = []
    if gesture.joint is not None:
        for name, joint in zip(character.joint_names, character.tree.joints, strict=True):
            if name == gesture.joint and joint.kind in ("hinge", "slide"):
                low, high = character.lower[joint.qpos], character.upper[joint.qpos]
                qpos[joint.qpos] = np.clip(gesture.value, low, high)
                held.append(joint.dof)
    bodies = set(character.bodies.tolist())
    pulls = [
        Pull(hand.body, np.array(hand.local), np.array(hand.target))
        for hand in gesture.hands
        if hand.body in bodies and np.isfinite([*hand.local, *hand.target]).all()
    ]
    if gesture.gaze and (face := face_of(character)) is not None:
        body, place, ahead = face
        gaze = gazes(character, session.find(gesture.name).qpos[None])[0]
        pose = forward(character.tree, qpos[None])
        origin = points(pose, np.array([body]), place[None])[0, 0]
        pulls.append(Pull(body, place + SIGHT * ahead, origin + SIGHT * gaze))
    return pulled(character, qpos, pulls, planted=gesture.planted, held=held)


def _posed(session: Session, gesture: Gesture) -> dict[str, Any]:
    """The pose that a gesture makes, as the page draws it, with what is wrong with it."""
    character, qpos = session.character, _moved(session, gesture)
    pose = replace(
        session.find(gesture.name), qpos=session.canonical(qpos), planted=tuple(gesture.planted)
    )
    told = live(character, pose)
    position, rotation, _ = body_poses(character.model, qpos[None])
    return {
        "qpos": qpos.tolist(), "position": position[0].ravel().tolist(),
        "rotation": rotation[0].ravel().tolist(), "errors": list(told.errors),
        "touching": list(told.touching), "margin": told.margin_m,
    }  # fmt: skip
