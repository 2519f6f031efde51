"""Left and right: one frame where they move alike, their own where they do not."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.face.curve import Curve, Key
from physretarget.face.library import Library
from physretarget.face.match import MatchSettings, match
from physretarget.face.rig import Rig
from physretarget.face.shot import Shot, Take
from physretarget.face.sides import partners

FPS = 60.0
ALONE = MatchSettings(learned=False)
LIBRARY = Library.of([Shot("s", {"a": Curve.through([0, 1, 2], [0, 1, 0], "flat")})])


def two_lids(seed: int, wink: bool = False) -> Take:
    """A blink every second, of both lids at once, read with noise; then one of the left alone."""
    rng = np.random.default_rng(seed)
    times, values = [0.0], [0.0]
    for k in range(6):
        begin = 0.5 + k + rng.uniform(-0.2, 0.2)
        times += [begin, begin + 0.1, begin + 0.15, begin + 0.33]
        values += [0.0, 1.0, 1.0, 0.0]
    curve = Curve.through([*times, 7.5], [*values, 0.0], "flat")
    grid = np.arange(int(7.5 * FPS)) / FPS
    clean = curve.evaluate(grid)
    left, right = clean.copy(), 0.8 * clean
    if wink:
        right[(grid > 3.1) & (grid < 4.2)] = 0.0
    noise = rng.normal(0.0, 0.01, (2, len(grid)))
    values_of = np.stack([left, right]) + noise
    return Take("blinks", grid, ("eyeBlinkLeft", "eyeBlinkRight"), np.clip(values_of, 0, 1).T)


def frames(take: Take, **more: object) -> list[set[int]]:
    result = match(take, LIBRARY, Rig.of(take), ALONE, **more)  # type: ignore[arg-type]
    return [set(np.round(c.curve.time * FPS).astype(int)) for c in result.channels.values()]


@pytest.mark.parametrize("seed", range(3))
def test_lids_that_move_alike_share_their_frames(seed):
    left, right = frames(two_lids(seed))
    assert len(left & right) >= 0.9 * max(len(left), len(right))
    assert len(left) >= 20


def test_a_wink_is_of_one_side():
    left, right = frames(two_lids(0, wink=True))
    alone = {f for f in left - right if 3.0 * FPS < f < 4.3 * FPS}
    assert len(alone) >= 2
    assert len({f for f in right if 3.2 * FPS < f < 4.1 * FPS}) == 0


def test_a_locked_key_stays_and_its_partner_comes_to_it():
    take = two_lids(1)
    left, _ = frames(take)
    peak = sorted(left)[2]
    lock = Key((peak + 1) / FPS, 1.0)
    now, partner = frames(take, locked={"eyeBlinkLeft": [lock]})
    assert peak + 1 in now
    assert peak + 1 in partner


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("eyeBlinkLeft", "eyeBlinkRight"),
        ("eyeLookInLeft", "eyeLookOutRight"),
        ("ParamEyeLOpen", "ParamEyeROpen"),
        ("brow_l", "brow_r"),
        ("L_brow.ty", "R_brow.ty"),
        ("left eye.rotation", "right eye.rotation"),
    ],
)
def test_sides_are_told_by_their_names(left, right):
    names = ["jawOpen", right, "browInnerUp", left]
    assert list(partners(names)) == [(3, [1])]
