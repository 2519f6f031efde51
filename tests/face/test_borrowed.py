"""Claims laid end to end: keys in order of time, the capture met on every shared frame."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from physretarget.face.borrowed import draft_of_claims
from physretarget.face.curve import Curve, Key
from physretarget.face.job import prepare
from physretarget.face.library import Library
from physretarget.face.match import MatchSettings, match
from physretarget.face.rig import Rig, RigChannel
from physretarget.face.segments import Claim, Entry, dictionary
from physretarget.face.shot import Shot, Take

FPS = 30.0


def shot(name: str, late: float, values: list[float]) -> Shot:
    """A shot whose keys lie ``late`` frames behind whole ones, every second frame."""
    times = (np.arange(len(values)) * 2 + late) / FPS
    handle = 2 / FPS / 3
    keys = tuple(
        Key(float(t), v, (-handle, 0.0), (handle, 0.0)) for t, v in zip(times, values, strict=True)
    )
    return Shot(name, {"Brow": Curve(keys)})


def claim(entry: Entry, first: int, last: int, keys: list[tuple[float, float]]) -> Claim:
    """A claim that is the capture itself, and so is not warped."""
    table = np.zeros((len(keys), 6))
    table[:, :2] = keys
    return Claim(entry, first, last, table, 0.0, 1.0)


def test_claims_that_share_a_frame_meet_on_it() -> None:
    """A segment whose keys lie between frames has one beyond its last frame, or before its first,
    where the neighbour's keys are; what it is worth there the capture never showed."""
    library = Library.of([shot("s", 0.5, [0.0, 1.0, 0.3, 0.8, 0.0])])
    value = np.sin(np.arange(41) / 6)
    take = Take("take", np.arange(41) / FPS, ("Brow",), value[:, None])
    rig = Rig("r", (RigChannel("Brow", "brow", -2.0, 2.0, {"Brow": 1.0}),))
    job = prepare(rig.drive(take), rig.channels, {})
    entry = dictionary(library, FPS, lambda _: True)[0]
    left = claim(entry, 10, 20, [(10.0, 0.0), (18.999, 0.4), (20.2, 0.1), (20.999, 9.0)])
    right = claim(entry, 20, 30, [(19.001, 22.0), (22.0, 0.2), (29.5, 0.3), (30.0, 0.5)])
    draft = draft_of_claims(job, 0, [left, right], library)
    times = draft.table[:, 0]
    assert (np.diff(times) > 0).all()
    assert 20.0 in times
    assert np.abs(draft.table[:, 1]).max() < 3.0
    assert draft.table[times == 20.0, 1] == pytest.approx(job.smooth[0][20])
    assert len(draft.broken) == len(draft.held) == len(times)


@given(
    late=st.lists(st.floats(0.001, 0.999), min_size=2, max_size=4),
    seed=st.integers(0, 2**16),
    method=st.sampled_from(["distance", "sax", "hmm"]),
)
def test_keys_between_frames_never_go_back_in_time(
    late: list[float], seed: int, method: str
) -> None:
    rng = np.random.default_rng(seed)
    shots = [
        shot(f"s{k}", each, [0.0, *rng.uniform(-1, 1, 4), 0.0]) for k, each in enumerate(late)
    ]  # fmt: skip
    library = Library.of(shots)
    frames = np.arange(12) / FPS
    value = np.concatenate([each.curves["Brow"].evaluate(frames) for each in (shots * 5)[:5]])
    take = Take("take", np.arange(len(value)) / FPS, ("Brow",), value[:, None])
    rig = Rig("r", (RigChannel("Brow", "brow", -2.0, 2.0, {"Brow": 1.0}),))
    settings = MatchSettings(preset="ruhland2017", method=method, tau=0.3)
    found = match(take, library, rig, settings).channels["Brow"]
    assert (np.diff([key.time for key in found.curve.keys]) > 0).all()
    for left, right in pairwise(found.pieces):
        assert left.end == pytest.approx(right.start, abs=1.01 / FPS)
