from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from physretarget.errors import InputError, UsageError
from physretarget.keyposes.suggest import MOST_FRAMES, suggest

NOTHING = np.zeros((0, 6))


def clusters(rng: np.random.Generator, sizes: tuple[int, ...]) -> NDArray[np.float64]:
    """Poses of two points around centres a metre and more apart."""
    centres = 2.0 * np.arange(len(sizes))[:, None] * np.ones(6)
    return np.concatenate(
        [c + 0.01 * rng.normal(size=(n, 6)) for c, n in zip(centres, sizes, strict=True)]
    )


def test_every_kind_of_pose_is_suggested_once_before_any_twice() -> None:
    frames = clusters(np.random.default_rng(0), (50, 5, 20, 1))
    found = suggest(frames, NOTHING, count=4)
    kinds = np.searchsorted([50, 55, 75], [s.index for s in found], side="right")
    assert sorted(kinds) == [0, 1, 2, 3]


def test_what_is_posed_is_not_suggested() -> None:
    frames = clusters(np.random.default_rng(1), (20, 20, 20))
    found = suggest(frames, frames[[0, 45]], count=1)
    assert 20 <= found[0].index < 40
    assert found[0].nearest in (0, 1)
    assert found[0].distance == pytest.approx(2.0 * np.sqrt(3.0), rel=0.02)
    assert found[0].stands_for == pytest.approx(1 / 3, abs=0.01)


def test_the_nearest_may_be_an_earlier_suggestion() -> None:
    frames = clusters(np.random.default_rng(2), (3, 3))
    first, second = suggest(frames, NOTHING, count=2)
    assert first.nearest is None
    assert second.nearest == 0
    assert first.score == 1.0
    assert second.score < 1.0


def test_conditional_variance_against_its_definition() -> None:
    rng = np.random.default_rng(3)
    frames, posed = rng.normal(size=(30, 6)), rng.normal(size=(4, 6))
    squared = np.sum((frames[:, None] - frames[None]) ** 2, axis=2)
    sharpness = 1 / (4 * np.median(squared[np.triu_indices(30, 1)]))

    def kernel(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        distance = np.sum((a[:, None] - b[None]) ** 2, axis=2)
        result: NDArray[np.float64] = np.exp(-0.5 * sharpness * distance)
        return result

    known = posed
    for each in suggest(frames, posed, count=5):
        gram = kernel(known, known) + 1e-3 * np.eye(len(known))
        cross = kernel(known, frames)
        variance = 1.0 - np.sum(cross * np.linalg.solve(gram, cross), axis=0)
        assert variance[each.index] == pytest.approx(variance.max(), rel=1e-9)
        known = np.concatenate([known, frames[each.index][None]])


def test_nothing_is_left_once_all_is_posed() -> None:
    frames = np.repeat(clusters(np.random.default_rng(4), (1, 1)), 10, axis=0)
    assert len(suggest(frames, NOTHING, count=10)) == 2


def test_same_input_same_suggestions() -> None:
    frames = clusters(np.random.default_rng(5), (30, 30))
    assert suggest(frames, NOTHING, count=5) == suggest(frames, NOTHING, count=5)


def test_refusals() -> None:
    with pytest.raises(UsageError, match="at least 1"):
        suggest(np.zeros((3, 6)), NOTHING, count=0)
    with pytest.raises(UsageError, match="most"):
        suggest(np.zeros((MOST_FRAMES + 1, 6)), NOTHING)
    with pytest.raises(InputError, match="no frames"):
        suggest(NOTHING, NOTHING)
    with pytest.raises(InputError, match="features"):
        suggest(np.zeros((3, 6)), np.zeros((1, 9)))
