"""Why a rule still fires on a clip after the last stage, in sentences a viewer understands.

First what happens in this very clip where the rule fires worst: the phase of the motion, the body
that drives it, the actor at that moment; all computed from the clip. Then the general reason.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.capture.actor import SEGMENT
from physretarget.keyposes import actor_character_of_reference
from physretarget.mjcf import Character

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

GRAVITY = 9.81
JUST = 0.12
"""So near to a touch-down or a take-off counts as being at it, s."""

_WHY = {
    "CON001": "contact points are kept above the floor, the rounded body of a tilted or swinging "
    "foot between them is not",
    "CON002": "short legs lift the swinging foot so little that it passes within validation's "
    "contact tolerance, and its force fit leans on it; points that the contact stage has planted "
    "stand still",
    "CON003": "the actor stands on a part that the character has not, or a hop was shortened",
    "CON004": "the actor's foot shuffles: contacts begin and end in quick succession",
    "CON005": "a point that is planted for the actor hangs in the air or slides for the character",
    "CON006": "the character's feet are tied to the actor's at another angle than their soles have",
    "CON007": "the character was placed at another height than its soles stand at",
    "DYN001": "the horizontal force comes from the actor's momentum and from steps or hops "
    "between supports; the last stage leads the pose by 8 % of the height at most, which is "
    "not enough",
    "DYN002": "a moment about the centre of mass is left: the pose swings a heavy head or trunk "
    "beyond the small feet, farther than the last stage may lead the pose back",
    "DYN003": "the pose drops faster than gravity for an instant, more than the smooth "
    "displacement of the root can take back",
    "DYN004": "travelling at the actor's speed asks for more friction than the feet have",
    "DYN005": "the weight leaves the small support while a limb or the head swings out; the "
    "actor's own support is wider for its height",
    "DYN006": "in flight the mapped limbs still change the path of the centre of mass",
    "DYN007": "limbs that swing in flight turn the body, for the mapping knows no conservation",
    "DYN008": "the joint would need a stronger motor than the model declares",
    "DYN009": "landing on short legs stops the body within a few frames",
    "DYN010": "the pose leans beyond the base that only stands on its floor",
    "KIN001": "the mapped features ask for more than the joint allows",
    "KIN002": "the mapping hurries between two key poses that are far apart",
    "KIN003": "the mapping hurries between key poses, or a contact begins within a frame",
    "KIN004": "a hop between two supports takes only a few frames",
    "KIN005": "limbs pass through the body: the mapping knows no geometry, as in the paper",
    "DAT002": "the capture is recorded at 30 frames per second",
}


def explain(code: str) -> str:
    """The reason why a rule fires on clips of this kind."""
    return _WHY.get(code, f"see `physretarget rules {code}`")


@dataclass(frozen=True, eq=False)
class Performance:
    """A clip to be explained: the character's motion, its planted points, and the actor's."""

    character: Character
    time: Array
    qpos: Array
    planted: Bools
    actor_qpos: Array

    @cached_property
    def pose(self) -> kinematics.Pose:
        """Of the character."""
        return kinematics.forward(self.character.tree, self.qpos)

    @cached_property
    def push(self) -> Array:
        """(T, nb, 3): mass times acceleration of each body, in body weights."""
        model = self.character.model
        moved = _differentiated(_centres(self.character, self.pose), self.time)
        result: Array = moved * model.body_mass[:, None] / self.character.weight
        return result

    @cached_property
    def actor_push(self) -> Array:
        """(T, 3): the same of the whole actor, in its body weights."""
        actor = actor_character_of_reference()
        centres = _centres(actor, kinematics.forward(actor.tree, self.actor_qpos))
        share = actor.model.body_mass / actor.model.body_mass.sum()
        whole = np.einsum("tbc,b->tc", centres, share)
        return _differentiated(whole[:, None], self.time)[:, 0] / GRAVITY

    def name(self, body: int) -> str:
        """Of a body, as a reader calls it."""
        return str(self.character.model.body(body).name).replace("_", " ")


def circumstances(code: str, frame: int, body: str | None, clip: Performance) -> str:
    """What happens in the clip at ``frame``, where the rule ``code`` fires worst."""
    said = [phase_at(clip, frame)]
    if code in ("DYN001", "DYN003", "DYN004", "DYN009"):
        said.append(_force(clip, frame))
    if code in ("DYN002", "DYN005", "DYN007"):
        said.append(_moment(clip, frame))
    if code in ("DYN001", "DYN003", "DYN009"):
        said.append(_knees(clip, frame))
    if code in ("CON001", "CON002") and body is not None:
        said.append(_foot(clip, frame, body))
    return "; ".join(part for part in said if part) + "."


def phase_at(clip: Performance, frame: int) -> str:
    """Who stands, and how near the next change is."""
    stands = np.asarray(clip.planted.any(axis=1))
    first, last = _run(stands == stands[frame], frame)
    length = float(clip.time[last] - clip.time[first])
    before, after = clip.time[frame] - clip.time[first], clip.time[last] - clip.time[frame]
    now = clip.time[frame]
    if not stands[frame]:
        return f"{now:.2f} s: in a flight of {length:.2f} s, {_hop(clip, first, last):.0f} cm high"
    bodies = clip.character.contacts.body[clip.planted[frame]]
    who = " and ".join(dict.fromkeys(clip.name(int(b)) for b in bodies))
    if before < JUST and first > 0:
        return f"{now:.2f} s: {before:.2f} s after touch-down on {who}"
    if after < JUST and last < len(stands) - 1:
        return f"{now:.2f} s: {after:.2f} s before take-off from {who}"
    same = (clip.planted == clip.planted[frame]).all(axis=1)
    first, last = _run(same, frame)
    length = float(clip.time[last] - clip.time[first])
    return f"{now:.2f} s: standing on {who} for {length:.2f} s"


def _force(clip: Performance, frame: int) -> str:
    push = clip.push[frame]
    whole, actor = push.sum(axis=0), clip.actor_push[frame]
    body = int(np.argmax(push @ whole))
    share = float(push[body] @ whole / max(whole @ whole, 1e-12))
    side, actor_side = (float(np.linalg.norm(each[:2])) for each in (whole, actor))
    return (
        f"accelerating takes {side:.1f} BW sideways and {whole[2]:+.1f} BW upwards, "
        f"{100 * min(share, 1.0):.0f} % of it for the {clip.name(body)} "
        f"(the actor: {actor_side:.1f} and {actor[2]:+.1f} BW)"
    )


def _moment(clip: Performance, frame: int) -> str:
    model = clip.character.model
    centres = _centres(clip.character, clip.pose)[frame]
    middle = model.body_mass @ centres / model.body_mass.sum()
    share = model.body_mass / model.body_mass.sum()
    own = clip.push[frame] - share[:, None] * clip.push[frame].sum(axis=0)
    moment = np.cross(centres - middle, own)
    body = int(np.argmax(np.linalg.norm(moment, axis=1)))
    arm = float(np.linalg.norm(centres[body] - middle))
    size = float(np.linalg.norm(own[body]))
    return (
        f"the {clip.name(body)} ({model.body_mass[body]:.2f} kg) swings hardest: {size:.2f} BW at "
        f"{100 * arm:.0f} cm from the centre of mass"
    )


def _knees(clip: Performance, frame: int) -> str:
    actor = actor_character_of_reference()
    pose = kinematics.forward(actor.tree, clip.actor_qpos[frame][None])
    bent = []
    for side in ("left", "right"):
        thigh, shank = (pose.rotation[0, SEGMENT[f"{side}_{s}"] + 1] for s in ("thigh", "shank"))
        cosine = 0.5 * (np.trace(thigh.T @ shank) - 1.0)
        bent.append(float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))))
    has = any("shank" in clip.name(b) for b in clip.character.bodies)
    without = "" if has else ", which the character has not"
    return f"the actor's knees are bent by {bent[0]:.0f}° and {bent[1]:.0f}°{without}"


def _foot(clip: Performance, frame: int, body: str) -> str:
    index = int(clip.character.model.body(body).id)
    turn = clip.pose.rotation
    tilt = np.degrees(np.arccos(np.clip(turn[frame, index, 2, 2], -1.0, 1.0)))
    last, next_ = max(frame - 1, 0), min(frame + 1, len(clip.time) - 1)
    way = clip.pose.position[next_, index] - clip.pose.position[last, index]
    speed = float(np.linalg.norm(way[:2]) / max(clip.time[next_] - clip.time[last], 1e-9))
    mine = clip.character.contacts.body == index
    state = "planted" if mine.any() and clip.planted[frame, mine].any() else "swinging"
    name = body.replace("_", " ")
    return f"the {name} is {state}, tilted by {tilt:.0f}° and moves at {speed:.2f} m/s"


def _hop(clip: Performance, first: int, last: int) -> float:
    """How high the lowest contact point gets in these frames, cm."""
    contacts = clip.character.contacts
    if not contacts.names:
        return 0.0
    height = kinematics.points(clip.pose, contacts.body, contacts.local)[first : last + 1, :, 2]
    return 100 * float(height.min(axis=1).max() - clip.character.floor_height)


def _run(true: Bools, frame: int) -> tuple[int, int]:
    """First and last of the consecutive true frames around ``frame``."""
    ends = np.flatnonzero(~true)
    at = int(np.searchsorted(ends, frame))
    first = int(ends[at - 1]) + 1 if at else 0
    return first, (int(ends[at]) - 1 if at < len(ends) else len(true) - 1)


def _centres(character: Character, pose: kinematics.Pose) -> Array:
    """Centres of mass of all bodies (T, nb, 3)."""
    count = character.model.nbody
    return kinematics.points(pose, np.arange(count), np.asarray(character.model.body_ipos))


def _differentiated(track: Array, time: Array) -> Array:
    """Second derivative in time (T, ...)."""
    once = np.gradient(track, time, axis=0)
    return np.asarray(np.gradient(once, time, axis=0))
