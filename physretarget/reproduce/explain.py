"""Why a rule still fires on a clip after the last stage, in a sentence a viewer understands."""

from __future__ import annotations

_WHY = {
    "CON001": "contact points are kept above the floor, the rounded body of a tilted or swinging "
    "foot between them is not",
    "CON002": "short legs lift the swinging foot so little that it passes within validation's "
    "contact tolerance, and its force fit leans on it; points that the contact stage has planted "
    "stand still",
    "CON003": "the actor stands on a part that the character has not, or a hop was shortened",
    "CON004": "the actor's foot shuffles: contacts begin and end in quick succession",
    "DYN001": "the horizontal force comes from the actor's momentum and from steps or hops "
    "between supports; the last stage moves the root up and down only and cannot mend it",
    "DYN002": "a moment about the centre of mass is left: the pose swings a heavy head or trunk "
    "beyond the small feet; the last stage changes the height of the root, not the moment",
    "DYN003": "the pose drops faster than gravity for an instant, more than the smooth "
    "displacement of the root can take back",
    "DYN004": "travelling at the actor's speed asks for more friction than the feet have",
    "DYN005": "the weight leaves the small support while a limb or the head swings out; the "
    "actor's own support is wider for its height",
    "DYN006": "in flight the mapped limbs still change the path of the centre of mass",
    "DYN007": "limbs that swing in flight turn the body, for the mapping knows no conservation",
    "DYN008": "the joint would need a stronger motor than the model declares",
    "DYN009": "landing on short legs stops the body within a few frames",
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
