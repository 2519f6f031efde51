"""The matchers against other people's implementations (extra ``twins``; skipped without them)."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.face import hmm, sax
from physretarget.face.distance import distance_profile


def test_distance_against_stumpy():
    stumpy = pytest.importorskip("stumpy")
    rng = np.random.default_rng(0)
    for n in (5, 20, 63):
        p, q = rng.normal(size=300).cumsum(), rng.normal(size=n).cumsum()
        # stumpy's mass has no centring on the first sample: subtract it window by window.
        expected = [
            stumpy.mass(q - q[0], p[r : r + n] - p[r], normalize=False)[0] ** 2
            for r in range(300 - n + 1)
        ]
        assert distance_profile(p, q) == pytest.approx(np.array(expected, float), rel=1e-6)


def test_sax_against_tslearn():
    piecewise = pytest.importorskip("tslearn.piecewise")
    rng = np.random.default_rng(1)
    for n, word, alphabet in ((24, 6, 4), (60, 10, 8), (33, 11, 10)):
        rows = sax.z_normalise(rng.normal(size=(12, n)).cumsum(axis=1))
        twin = piecewise.SymbolicAggregateApproximation(
            n_segments=word, alphabet_size_avg=alphabet, scale=False
        )
        theirs = twin.fit_transform(rows[:, :, None])[:, :, 0]
        ours = sax.words(rows, word, alphabet)
        assert np.array_equal(ours, theirs)
        bound = sax.mindist(ours, ours, n, alphabet)
        for a in range(4):
            for b in range(4):
                expected = twin.distance_sax(theirs[a][:, None], theirs[b][:, None])
                assert bound[a, b] == pytest.approx(expected, rel=1e-5, abs=1e-6)


def test_viterbi_against_subsequence_alignment():
    """With no price on pace, monotone alignment is DTW whose chain points each sit once."""
    dtw = pytest.importorskip("dtaidistance.subsequence.dtw")
    rng = np.random.default_rng(2)
    for _ in range(10):
        capture = rng.normal(size=80).cumsum()
        start = int(rng.integers(0, 50))
        example = capture[start : start + 20] + rng.normal(0, 0.01, 20)
        best = dtw.subsequence_alignment(example, capture).best_match()
        assert abs(best.segment[0] - start) <= 1
        first, last = best.segment
        window = capture[first : last + 1]
        cost = np.abs(example[:, None] - window[None])
        total, path = hmm.viterbi(cost[None], 0.0, free_end=False)
        theirs = dict(best.path)
        frames = np.array([theirs[i] for i in range(20)]) - first
        assert np.abs(path[0] - frames).max() <= 2
        assert total[0] <= cost[np.arange(20), frames].sum() + 1e-9
