"""What past shots teach: planted habits are found, and a library without files teaches nothing."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from physretarget.face.curve import Curve
from physretarget.face.library import Library
from physretarget.face.measure import key_f1, pseudo_take
from physretarget.face.programme import ProgrammeSettings, programme
from physretarget.face.shot import Shot
from physretarget.face.style import Clues, Style, choose, keyed_by, learn
from physretarget.face.style_file import StyleFile


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


def test_a_style_is_learned_once_and_kept(tmp_path):
    """Another library, rate or price is another style; torn files and closed folders do no harm."""
    library, prices = Library.of(shots(3, 0)), ProgrammeSettings()
    file = StyleFile.beside(tmp_path / "lib.npz")
    rng = np.random.default_rng(0)
    made = Style(rng.normal(size=5), rng.normal(size=5), rng.normal(size=6), 0.25)
    calls: list[int] = []

    def teacher():
        calls.append(1)
        return made

    assert file.get(library, 30.0, prices, teacher) is made
    kept = file.get(library, 30.0, prices, teacher)
    assert len(calls) == 1
    for name in ("mean", "scale", "weight", "gain"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(made, name))
    file.get(library, 60.0, prices, teacher)
    file.get(library, 30.0, ProgrammeSettings(key_price=9.0), teacher)
    file.get(Library.of(shots(3, 1)), 30.0, prices, teacher)
    assert len(calls) == 4
    assert file.get(library, 24.0, prices, lambda: None) is None
    assert file.get(library, 24.0, prices, teacher) is None  # that it teaches nothing is kept, too
    file.get(library, 30.0, prices, teacher)
    assert len(calls) == 4
    file.path.write_bytes(file.path.read_bytes()[:40])
    file.get(library, 30.0, prices, teacher)
    assert len(calls) == 5
    nowhere = StyleFile(Path("/dev/null/styles.npz"))
    assert nowhere.get(library, 30.0, prices, teacher) is made
