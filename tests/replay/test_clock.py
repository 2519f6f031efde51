from __future__ import annotations

import json
import shutil
import subprocess

import numpy as np
import pytest

from physretarget.replay.clock import Clock
from physretarget.replay.web import asset

UNIFORM = np.arange(10) / 30.0
UNEVEN = np.array([0.5, 0.6, 1.0, 1.1, 3.0])


def test_a_frame_is_on_screen_from_its_time_to_the_next_one() -> None:
    clock = Clock(UNEVEN)
    assert [clock.frame_at(t) for t in (0.5, 0.59, 0.6, 0.99, 1.0, 2.9, 3.0)] == [
        0, 0, 1, 1, 2, 3, 4,
    ]  # fmt: skip
    assert clock.frame_at(-7.0) == 0
    assert clock.frame_at(99.0) == 4


def test_rounding_of_frame_times_never_shows_the_frame_before() -> None:
    clock = Clock(UNIFORM)
    assert [clock.frame_at(k / 30.0 - 1e-12) for k in range(10)] == list(range(10))


def test_between_gives_the_way_to_the_next_frame() -> None:
    frame, part = Clock(UNEVEN).between(0.8)
    assert frame == 1
    assert part == pytest.approx(0.5)
    assert Clock(UNEVEN).between(3.0) == (4, 0.0)
    assert Clock(UNEVEN).between(0.1) == (0, 0.0)


def test_advance_loops_or_stops() -> None:
    clock = Clock(UNEVEN)
    assert clock.advance(2.9, 0.3, speed=1.0, loop=False) == 3.0
    assert clock.advance(2.9, 0.3, speed=1.0, loop=True) == pytest.approx(0.7)
    assert clock.advance(0.6, 0.3, speed=-1.0, loop=True) == pytest.approx(2.8)
    assert clock.advance(0.6, 1.0, speed=0.25, loop=True) == pytest.approx(0.85)


def test_a_single_frame_stands_still() -> None:
    clock = Clock(np.array([0.0]))
    assert clock.advance(0.0, 1.0, speed=1.0, loop=True) == 0.0
    assert clock.between(0.0) == (0, 0.0)
    assert clock.ticks(30.0).tolist() == [0.0]


@pytest.mark.parametrize(
    ("fps", "speed", "count"), [(30.0, 1.0, 10), (60.0, 1.0, 19), (30, 0.5, 19)]
)
def test_ticks_cover_the_clip(fps: float, speed: float, count: int) -> None:
    ticks = Clock(UNIFORM).ticks(fps, speed=speed)
    assert len(ticks) == count
    assert ticks[0] == 0.0
    assert ticks[-1] == pytest.approx(0.3)


def test_the_browsers_clock_agrees(tmp_path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node to run the browser's clock in")
    rng = np.random.default_rng(4)
    questions = np.concatenate([rng.uniform(-1, 4, 200), UNEVEN, UNEVEN - 1e-12])
    script = tmp_path / "clock.js"
    script.write_text(
        asset("clock.js")
        + f"\nconst clock = new physretarget.Clock({UNEVEN.tolist()});"
        + f"\nconst asked = {questions.tolist()};"
        + "\nconst go = (t, loop) => clock.advance(t, 0.37, { speed: -1.5, loop });"
        + "\nconsole.log(JSON.stringify(asked.map((t) => "
        "[clock.frameAt(t), ...clock.between(t), go(t, true), go(t, false)])));"
    )
    answers = json.loads(subprocess.run([node, script], capture_output=True, check=True).stdout)
    clock = Clock(UNEVEN)
    ours = [
        [
            clock.frame_at(t),
            *clock.between(t),
            clock.advance(t, 0.37, speed=-1.5, loop=True),
            clock.advance(t, 0.37, speed=-1.5, loop=False),
        ]
        for t in questions
    ]
    np.testing.assert_allclose(answers, ours, atol=1e-12)
