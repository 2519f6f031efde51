"""The tolerances that docs/measured/stream.md states, on captures of several sources."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.stream import compared, learned, streamed
from physretarget import capture
from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.trained import TrainedMapper

SHAPE = {"lamp": 10.0, "penguin": 8.0, "squirrel": 8.0}
WALK = {"lamp": 6.0, "penguin": 5.0, "squirrel": 5.0}
DRIFT = {"lamp": 25.0, "penguin": 13.0, "squirrel": 13.0}
"""Percent of the height, median over a capture's frames; docs/measured/stream.md."""
WALKS = ("walk", "bandai_walk")
WHEEL = ("walk", "run", "dance_b")
DATA = {
    "bandai_walk": "bvh/bandai/dataset-1_walk_normal_001.bvh",
    "bow": "bvh/bandai/dataset-1_bow_happy_001.bvh",
    "cmu": "c3d/135_02.c3d",
}
FRAMES = 180


@pytest.fixture(scope="module", params=["lamp", "penguin", "squirrel"])
def mapper(request: pytest.FixtureRequest) -> TrainedMapper:
    return learned(request.param)


def prepared(path: Path) -> ActorMotion:
    motion = capture.load(path).resampled(60.0).on(ActorShape.reference())
    return motion.cut(0, min(FRAMES, len(motion.time)) - 1)


def contacted(motion: ActorMotion, mapper: TrainedMapper) -> Retargeted:
    return retarget(motion, mapper, settings=RetargetSettings(until="contacted"))


def check(name: str, motion: ActorMotion, mapper: TrainedMapper) -> None:
    batch = contacted(motion, mapper)
    posed, _ = streamed(mapper, batch, 0.0)
    apart = compared(posed, batch)
    character = mapper.character.name
    assert np.median(apart.mapped) < 3.5
    assert np.median(apart.placed) < 3.5
    assert np.median(apart.shape) < (WALK if name in WALKS else SHAPE)[character]
    assert np.median(apart.drift) < DRIFT[character]
    assert apart.step[0] < 3.0 * apart.step[1]
    assert apart.slid < 4.0  # each within 2 mm of its place


@pytest.mark.parametrize("name", WHEEL)
def test_stream_agrees_with_batch(name: str, mapper: TrainedMapper, motions: Path) -> None:
    check(name, prepared(motions / f"humanoid3d_{name}.txt"), mapper)


@pytest.mark.parametrize("name", DATA)
def test_stream_agrees_with_batch_on_other_captures(
    name: str, mapper: TrainedMapper, data: Path
) -> None:
    check(name, prepared(data / DATA[name]), mapper)


def test_a_delay_brings_the_stream_nearer(mapper: TrainedMapper, data: Path) -> None:
    batch = contacted(prepared(data / DATA["bandai_walk"]), mapper)
    apart = {delay: compared(streamed(mapper, batch, delay)[0], batch) for delay in (0.0, 0.5)}
    total = {delay: np.median(np.hypot(a.shape, a.drift)) for delay, a in apart.items()}
    assert total[0.5] < total[0.0] + 0.5
    assert len(apart[0.5].shape) == len(batch.motion.time)
