"""What past shots teach: planted habits are found, and a library without files teaches nothing."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from physretarget.face.curve import Curve
from physretarget.face.library import Library
from physretarget.face.measure import key_f1, pseudo_take
from physretarget.face.programme import programme
from physretarget.face.shot import Shot
from physretarget.face.style import Clues, choose, keyed_by, learn


def shots(count, seed):
    """An animator who keys all channels on the same frames, whether they turn there or not."""
    rng = np.random.default_rng(seed)
    made = []
    for number in range(count):
        times = np.cumsum(rng.integers(4, 16, 9)) / 30.0
        curves = {}
        for channel in range(4):
            values = rng.uniform(0, 1, 9)
            values[2::3] = 0.5 * (values[1::3][: len(values[2::3])] + values[2::3])
            curves[f"c{channel}"] = Curve.through(times, values)
        made.append(Shot(f"shot{number}", curves, sha256=f"{seed}-{number}"))
    return made


def test_what_is_shared_between_channels_is_learned():
    style = learn(Library.of(shots(9, 0)), 30.0)
    assert style is not None
    assert style.gain > 0
    gains = []
    for number, shot in enumerate(shots(6, 1)):
        curves = list(shot.curves.values())
        _, noisy, start = pseudo_take(curves, 30.0, np.random.default_rng(number))
        values = (noisy - noisy.min(axis=1, keepdims=True)) / np.ptp(noisy, axis=1, keepdims=True)
        scores = programme(values, 30.0)
        keyed = keyed_by(style, Clues(scores, values, 30.0), [()] * len(curves))
        for before, after, curve in zip(scores, keyed, curves, strict=True):
            true = (curve.time - start) * 30.0
            found = [key_f1(s.chain.frames * 1.0, true, 1.0)[0] for s in (after, before)]
            gains.append(found[0] - found[1])
    assert np.mean(gains) > 0.02


@pytest.mark.parametrize("count", [1, 2])
def test_a_library_of_few_files_teaches_nothing(count):
    assert learn(Library.of(shots(count, 0)), 30.0) is None


def test_keys_promise_the_highest_f1():
    """Against every subset, where windows do not touch."""
    chance = np.zeros(40)
    chance[[0, 39]] = 1.0
    places, sure = [6, 12, 18, 25, 31], [0.9, 0.5, 0.35, 0.2, 0.1]
    chance[places] = sure
    total = 0.9 * chance.sum()

    def promise(chosen):
        return 2 * (2 + sum(sure[k] for k in chosen)) / (2 + len(chosen) + total)

    every = [c for n in range(6) for c in combinations(range(5), n)]
    best = max(every, key=promise)
    assert choose(chance).tolist() == [0, *(places[k] for k in best), 39]
    assert 18 in choose(np.where(np.arange(40) == 18, 0.01, chance), pinned=[18])


def test_clues_in_stretches_are_those_of_the_whole():
    (shot,) = shots(1, 3)
    _, noisy, _ = pseudo_take(list(shot.curves.values()), 30.0, np.random.default_rng(0))
    clues = Clues(programme(noisy, 30.0), noisy, 30.0)
    whole = clues.table(0, clues.frames)
    parts = [clues.table(a, min(clues.frames, a + 17)) for a in range(0, clues.frames, 17)]
    assert np.concatenate(parts, axis=1) == pytest.approx(whole, abs=1e-12)
