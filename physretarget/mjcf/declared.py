"""What a model says of itself in its custom texts."""

from __future__ import annotations

from fnmatch import fnmatchcase

import mujoco

from physretarget.errors import InputError
from physretarget.mjcf.character import Character


def passive_joints(character: Character) -> tuple[str, ...]:
    """Joints that the custom text ``passive`` names, in the model's order; ``*`` for any ending.

    Raises:
        InputError: a name fits no joint.
    """
    model = character.model
    text = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, "passive")
    if text < 0:
        return ()
    start, size = model.text_adr[text], model.text_size[text]
    patterns = bytes(model.text_data[start : start + size]).rstrip(b"\0").decode().split()
    found: set[str] = set()
    for pattern in patterns:
        fitting = {n for n in character.joint_names if fnmatchcase(n, pattern)}
        if not fitting:
            raise InputError(
                f"custom text 'passive' names {pattern!r}, which is no joint of the model.",
                path=character.path,
            )
        found |= fitting
    return tuple(name for name in character.joint_names if name in found)
