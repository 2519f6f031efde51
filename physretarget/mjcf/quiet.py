"""MuJoCo's warnings go to Python's logging.

Left alone MuJoCo appends them to a file MUJOCO_LOG.TXT in the current folder, whoever's it is.
"""

from __future__ import annotations

import logging

import mujoco

_log = logging.getLogger("physretarget.mujoco")
_log.addHandler(logging.NullHandler())


def _warned(message: bytes | str) -> None:
    text = message.decode("utf-8", "replace") if isinstance(message, bytes) else message
    _log.warning(text.strip())


def log_warnings() -> None:
    """Send MuJoCo's warnings to the logger ``physretarget.mujoco`` from now on."""
    mujoco.set_mju_user_warning(_warned)
