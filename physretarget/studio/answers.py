"""What the studio's page is told: the key poses, the character, a pose under the hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field

from physretarget.capture.actor import CONTACT_POINTS
from physretarget.errors import UsageError
from physretarget.keyposes import KeyPose, KeyPoseSet, check
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
from physretarget.studio.live import live
from physretarget.studio.session import Session

__all__ = ["Gesture", "Name", "Planted", "Point", "Qpos", "posed", "stage_of", "state_of"]

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


def state_of(session: Session) -> dict[str, Any]:
    """The key poses as they are, with what is wrong with them.

    Args:
        session: what is worked on.

    Returns:
        A JSON document.
    """
    keyposes = session.keyposes
    remarks = check(keyposes, session.character)
    return {
        "revision": session.revision,
        "undo": session.undoable,
        "redo": session.redoable,
        "limbs": _limbs(session.character, keyposes),
        "model": session.character.sha256,
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


def stage_of(session: Session) -> dict[str, Any]:
    """The character as it can be posed, its points, and the captures.

    Args:
        session: what is worked on.

    Returns:
        A JSON document.
    """
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
        {"name": name, "body": int(body), "local": local.tolist(), "tie": tie, "contact": True}
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
                "contact": False,
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
        "ties": list(CONTACT_POINTS), "model": character.sha256,
        "markers": [
            {"name": name, "body": model.body(int(body)).name}
            for name, body in zip(character.markers.names, character.markers.body, strict=True)
        ],
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


def posed(session: Session, gesture: Gesture) -> dict[str, Any]:
    """The pose that a gesture makes, as the page draws it, with what is wrong with it.

    Args:
        session: what is worked on.
        gesture: what the hand does.

    Returns:
        A JSON document.
    """
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
