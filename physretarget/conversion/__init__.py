"""Clips from one file format to another."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from physretarget.clip import Clip, load_clip
from physretarget.conversion.bvh import bvh_text
from physretarget.conversion.plain import csv_text, npy_bytes
from physretarget.errors import UsageError
from physretarget.files import write_file
from physretarget.mjcf import Character
from physretarget.options.motion import JointOrder

__all__ = ["FORMATS", "convert", "encode"]

FORMATS = {
    ".npz": "our clip file",
    ".csv": "root xyz, quaternion, joints; one row per frame",
    ".npy": "the qpos array alone",
    ".bvh": "bodies as joints, centimetres, y up",
    ".glb": "bodies and their shapes, animated (glTF 2.0)",
}
NEED_A_MODEL = (".bvh", ".glb")


def convert(
    source: str | PathLike[str],
    target: str | PathLike[str],
    *,
    character: Character | None = None,
    fps: float | None = None,
    quat: str | None = None,
    joint_order: JointOrder | None = None,
    unit: str | None = None,
    to_quat: str = "xyzw",
    header: bool = False,
) -> Clip:
    """Read a clip in any format that is read, write it in the format that ``target`` ends in.

    Args:
        source: a clip in any format that :func:`physretarget.clip.load_clip` reads.
        target: ends in one of :data:`FORMATS`.
        character: the clip's model; bvh and glb cannot do without.
        fps: frames per second of a source that does not say.
        quat: order of the root's quaternion, likewise.
        joint_order: order of joints without names, likewise.
        unit: length unit of the source.
        to_quat: quaternion order of a csv (LAFAN1 files have xyzw).
        header: whether a csv begins with a line of names and has a column of time.

    Returns:
        The clip that was written.

    Raises:
        InputError: the clip cannot be used, or the target not be written.
        UsageError: an unknown ending, a missing model, or a format that cannot hold the clip.
    """
    ending = _ending(target)
    if ending in NEED_A_MODEL and character is None:
        raise UsageError(f"A {ending} file shows the model: give it (--model).")
    clip = load_clip(
        source, character=character, fps=fps, quat=quat, joint_order=joint_order, unit=unit
    )
    write_file(target, encode(clip, ending, character, to_quat=to_quat, header=header))
    return clip


def encode(
    clip: Clip,
    ending: str,
    character: Character | None,
    *,
    to_quat: str = "xyzw",
    header: bool = False,
) -> bytes:
    """The bytes of a clip in a format of :data:`FORMATS`; same clip, same bytes."""
    if ending == ".npz":
        return clip.to_bytes()
    if ending == ".npy":
        return npy_bytes(clip)
    if ending == ".csv":
        return csv_text(clip, character, to_quat=to_quat, header=header).encode()
    assert character is not None
    if ending == ".bvh":
        return bvh_text(clip, character).encode()
    from physretarget.conversion.gltf import glb_bytes  # its library is an extra

    return glb_bytes(clip, character)


def _ending(target: str | PathLike[str]) -> str:
    ending = Path(target).suffix.lower()
    if ending not in FORMATS:
        given = ending or Path(target).name
        raise UsageError(f"{given!r} is no format to write: {', '.join(FORMATS)} are.")
    return ending
