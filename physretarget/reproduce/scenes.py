"""Scenes of the report: one performance on all characters, and poses for film strips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget.keyposes import actor_character_of_reference
from physretarget.mjcf import Character
from physretarget.pipeline import STAGES
from physretarget.replay.figures import figure
from physretarget.replay.scene import Scene
from physretarget.reproduce.store import Piece

Array = NDArray[np.float64]
ACTOR_TINT = (0.42, 0.52, 0.70)


def together(title: str, pieces: Mapping[str, Piece], characters: Mapping[str, Character]) -> Scene:
    """The actor and every character in the same performance, side by side."""
    first = next(iter(pieces.values()))
    figures = [
        figure(
            actor_character_of_reference(),
            first.arrays["actor"],
            name="actor",
            offset=(0.0, 1.2, 0.0),
            tint=ACTOR_TINT,
        )
    ]
    figures += [
        figure(characters[name], piece.arrays["qpos"], name=name, offset=(0.0, -0.9 * k, 0.0))
        for k, (name, piece) in enumerate(pieces.items())
    ]
    return Scene(title=title, time=first.arrays["time"], figures=tuple(figures), layout="split")


def strip(
    title: str, rows: Sequence[tuple[str, Character | None, Array]], times: Array | None
) -> Scene:
    """One figure per row of a film strip; frame k of each is its k-th picture.

    ``rows``: label, character (None for the actor), poses (K, nq). ``times`` (K,) s of the
    pictures, None to number them.
    """
    figures = [
        figure(
            character or actor_character_of_reference(),
            poses,
            name=label,
            tint=ACTOR_TINT if character is None else None,
        )
        for label, character, poses in rows
    ]
    # The camera goes by a figure's height: one for all rows of a body, or a crouch looks large.
    bodies = [character is None for _, character, _ in rows]
    tallest = {
        body: max(f.height for f, b in zip(figures, bodies, strict=True) if b == body)
        for body in set(bodies)
    }
    figures = [replace(f, height=tallest[b]) for f, b in zip(figures, bodies, strict=True)]
    if times is None:
        times = np.arange(float(len(rows[0][2])))
    return Scene(title=title, time=times, figures=tuple(figures))


def stages_of(folder: Path, count: int) -> tuple[list[tuple[str, Array]], Array]:
    """Poses of the actor and after each stage at ``count`` instants, from a take's folder."""
    with np.load(folder / "stages.npz", allow_pickle=False) as content:
        time = content["time"]
        picked = np.rint((np.arange(count) + 0.5) / count * (len(time) - 1)).astype(int)
        rows = [("actor", content["actor_qpos"][picked])]
        for name in STAGES:
            rows.append((name, content[f"qpos_{name}"][picked]))
    return rows, time[picked]
