"""Where a character's face is."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from physretarget.errors import InputError
from physretarget.mjcf import Character

Array = NDArray[np.float64]


def face_of(character: Character) -> tuple[int, Array, Array] | None:
    """Body, place (3,) and direction (3,) of the face in it: the x axis of the site that the
    model's custom text ``face`` names. None where there is no such text.

    Raises:
        InputError: the text names no site.
    """
    model = character.model
    text = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, "face")
    if text < 0:
        return None
    start, size = model.text_adr[text], model.text_size[text]
    name = bytes(model.text_data[start : start + size]).rstrip(b"\0").decode().strip()
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if site < 0:
        raise InputError(f"custom text 'face' names {name!r}, which is no site of the model")
    turn = Rotation.from_quat(model.site_quat[site], scalar_first=True)
    return int(model.site_bodyid[site]), np.array(model.site_pos[site]), turn.apply([1.0, 0, 0])
