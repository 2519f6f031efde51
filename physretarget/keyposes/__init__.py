"""Key poses: what an animator says the character does when the actor does this.

Each pairs a pose of the reference actor with a pose of the character, both with the heading
and the horizontal position taken out. They live in TOML files that can be read, written and
mended by hand; see docs/characters.md for the format.
"""

from __future__ import annotations

from physretarget.keyposes.check import Remark, check
from physretarget.keyposes.file import load, load_keyposes, save
from physretarget.keyposes.pairs import actor_character_of_reference, training_pairs
from physretarget.keyposes.pose import KeyPose, KeyPoseSet, merged, without_heading
from physretarget.keyposes.propose import gaze_of_actor, propose
from physretarget.keyposes.settle import plant, settled
from physretarget.keyposes.sheet import sheet

__all__ = [
    "KeyPose",
    "KeyPoseSet",
    "Remark",
    "actor_character_of_reference",
    "check",
    "gaze_of_actor",
    "load",
    "load_keyposes",
    "merged",
    "plant",
    "propose",
    "save",
    "settled",
    "sheet",
    "training_pairs",
    "without_heading",
]
