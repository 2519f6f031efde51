"""A clip: a character's motion as qpos over time, ours or another tool's.

``load_clip`` reads our own npz and the formats of LocoMuJoCo, mjlab and BeyondMimic, Isaac Lab,
holosoma, ProtoMotions, GMR, PHC and ASAP, LAFAN1-style, BONES-SEED and LeRobot tables, and plain
qpos arrays; every guess it makes is a sentence in ``Clip.notes``.
``open_clip`` reads the same some frames at a time.
"""

from __future__ import annotations

from physretarget.archives.arrays import Members
from physretarget.clip.core import Clip, LongClip, Motion
from physretarget.clip.load import CLIP_SUFFIXES, load_clip, open_clip
from physretarget.files import npz_bytes, write_file

__all__ = [
    "CLIP_SUFFIXES",
    "Clip",
    "LongClip",
    "Members",
    "Motion",
    "load_clip",
    "npz_bytes",
    "open_clip",
    "write_file",
]
