"""One picture of every pair, to be judged by eye."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from physretarget.errors import InputError
from physretarget.keyposes.pairs import actor_character_of_reference
from physretarget.keyposes.picture import Camera, painter
from physretarget.keyposes.pose import KeyPose, KeyPoseSet
from physretarget.kinematics import forward
from physretarget.mjcf import Character

__all__ = ["SheetSettings", "sheet"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

PAPER, INK, FAINT = (250, 247, 241), (40, 34, 30), (128, 118, 108)


@dataclass(frozen=True, kw_only=True)
class SheetSettings:
    """How a sheet looks: pixels of one picture, pairs in a row, azimuth of the camera (deg)."""

    size: int = 240
    columns: int = 4
    azimuth: float = 145.0
    elevation: float = -10.0


def sheet(
    keyposes: KeyPoseSet,
    character: Character,
    path: str | PathLike[str],
    *,
    settings: SheetSettings | None = None,
) -> None:
    """Write a PNG of all pairs: the actor left, the character right, name and source below.

    Both are drawn in their heading frame from the same side, and on one scale each throughout,
    so that crouch, stretch and height above the floor can be compared.

    Args:
        keyposes: The key poses.
        character: The character that was posed.
        path: The PNG file.
        settings: Size and view, the defaults if None.

    Raises:
        InputError: there are no key poses.
        NoRenderingError: nothing to draw with is installed.
    """
    settings = settings or SheetSettings()
    if not keyposes.poses:
        raise InputError("there are no key poses to draw")
    actor = actor_character_of_reference()
    left = _pictures(actor, [pose.actor_qpos for pose in keyposes.poses], settings)
    right = _pictures(character, [pose.qpos for pose in keyposes.poses], settings)
    cells = [
        _cell(pose, a, b, settings) for pose, a, b in zip(keyposes.poses, left, right, strict=True)
    ]
    columns = min(settings.columns, len(cells))
    rows = -(-len(cells) // columns)
    width, height = cells[0].size
    picture = Image.new("RGB", (columns * width, rows * height + 36), PAPER)
    title = f"{keyposes.character_name}: {len(cells)} key poses"
    if keyposes.license:
        title += f"   ({keyposes.license})"
    ImageDraw.Draw(picture).text((12, 9), title, fill=INK, font=ImageFont.load_default(16))
    for index, cell in enumerate(cells):
        picture.paste(cell, (index % columns * width, index // columns * height + 36))
    picture.save(Path(path), format="PNG", optimize=True)


def _pictures(character: Character, poses: list[Array], settings: SheetSettings) -> list[Pixels]:
    """Pictures of all poses by one camera that sees the reference pose and the highest pose."""
    model = copy.copy(character.model)  # a picture may be larger than the model's own buffer
    centre, span = _view(character, poses)
    half_angle = np.radians(model.vis.global_.fovy) / 2
    camera = Camera(centre, 0.5 * span / np.tan(half_angle), settings.azimuth, settings.elevation)
    with painter(model, settings.size, settings.size) as paint:
        return [paint(qpos, camera) for qpos in poses]


def _view(character: Character, poses: list[Array]) -> tuple[Array, float]:
    """Centre of sight and height of the picture (m), from body origins and the model's size."""
    at = forward(character.tree, np.array(poses)).position[:, character.bodies]
    margin = 0.22 * character.height
    top = max(float(at[..., 2].max()) + margin, character.floor_height + character.height)
    wide = 2 * (float(np.abs(at[..., :2]).max()) + 0.7 * margin)
    span = max(top - character.floor_height, wide) * 1.12
    return np.array([0.0, 0.0, character.floor_height + 0.5 * (top - character.floor_height)]), span


def _cell(pose: KeyPose, left: Pixels, right: Pixels, settings: SheetSettings) -> Image.Image:
    size, gap = settings.size, 6
    cell = Image.new("RGB", (2 * size + 3 * gap, size + 52), PAPER)
    cell.paste(Image.fromarray(left), (gap, 0))
    cell.paste(Image.fromarray(right), (size + gap + 2, 0))
    draw = ImageDraw.Draw(cell)
    draw.text((gap + 2, size + 3), pose.name, fill=INK, font=ImageFont.load_default(15))
    planted = " ".join(_short(point) for point in pose.planted) or "in the air"
    small = ImageFont.load_default(11)
    text = f"{pose.source}  {pose.time:.2f} s"
    draw.text((gap + 2, size + 21), text, fill=FAINT, font=small)
    draw.text((gap + 2, size + 34), planted, fill=FAINT, font=small)
    return cell


def _short(point: str) -> str:
    return point.replace("left_", "L ").replace("right_", "R ")
