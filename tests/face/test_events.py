"""Events: drawn by hand, found across channels, moved as one."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.errors import InputError
from physretarget.face.curve import Curve
from physretarget.face.events import HOLD, RULES, find_events, moved, room
from physretarget.face.rig import guess_group
from physretarget.face.shot import Shot


def face() -> Shot:
    """A blink at 1 s, a dart at 2.5 s, a brow hit at 4 s, a nod at 6 s, a jaw drop at 8 s."""
    shut = ([0, 0.9, 1.0, 1.05, 1.25, 10], [0, 0, 1, 1, 0, 0])
    curves = {
        "eyeBlinkLeft": Curve.through(*shut, "flat"),
        "eyeBlinkRight": Curve.through(*shut, "flat"),
        "eyeLookInLeft": Curve.through([0, 2.5, 2.58, 10], [0, 0, 0.5, 0.5], "flat"),
        "browInnerUp": Curve.through([0, 3.8, 4.0, 4.4, 10], [0.1, 0.1, 0.9, 0.1, 0.1], "flat"),
        "headPitch": Curve.through([0, 5.8, 6.0, 6.4, 10], [0, 0, -0.3, 0, 0], "flat"),
    }
    grid = np.arange(601) / 60
    jaw = np.exp(-(((grid - 8.0) / 0.15) ** 2))
    curves["jawOpen"] = Curve.through(grid, jaw, "linear")
    return Shot("face", curves)


def events(shot: Shot):
    return find_events(shot.curves, {name: guess_group(name) for name in shot.curves})


def test_what_was_drawn_is_found_once_and_nothing_else():
    found = [(e.kind, round(e.peak, 1)) for e in events(face()) if e.kind != "hold"]
    assert found == [
        ("blink", 1.0), ("eye dart", 2.6), ("brow hit", 4.0), ("nod", 6.0), ("jaw drop", 8.0),
    ]  # fmt: skip
    blink = next(e for e in events(face()) if e.kind == "blink")
    assert blink.channels == ("eyeBlinkLeft", "eyeBlinkRight")
    assert (blink.start, blink.end) == pytest.approx((0.9, 1.25))
    assert blink.keys["eyeBlinkLeft"] == (1, 4)


def test_holds_are_where_nothing_keyed_moves():
    held = [(round(e.start, 2), round(e.end, 2)) for e in events(face()) if e.kind == "hold"]
    assert held == [(0, 0.9), (1.25, 2.5), (2.58, 3.8), (4.4, 5.8), (6.4, 10)]
    assert all(end - start >= HOLD for start, end in held)


@pytest.mark.parametrize("kind", RULES)
def test_what_is_too_slow_or_too_small_is_no_event(kind):
    rule = RULES[kind]
    name = {"lids": "eyeBlinkLeft", "gaze": "eyeLookInLeft", "brows": "browInnerUp"}.get(
        rule.group, {"head": "headPitch", "lips": "jawOpen"}.get(rule.group, "")
    )

    def count(seconds: float, height: float) -> int:
        """Something as high as the channel moves at 1 s; the thing itself at 10 s."""
        big = [0, 1, 4, 7, 9.9] if rule.returns else [0, 1, 4, 5, 9.9]
        values = [0, 0, 1, 0, 0] if rule.returns else [0, 0, 1, 1, 1]
        rest = values[-1]
        there = rest - height if rest else height
        after = [10, 10 + seconds / 2, 10 + seconds, 12] if rule.returns else [10, 10 + seconds, 12]
        then = [rest, there, rest, rest] if rule.returns else [rest, there, there]
        curve = Curve.through([*big, *after], [*values, *then], "flat")
        found = find_events({name: curve}, {name: rule.group})
        return sum(e.kind == kind and e.start > 9 for e in found)

    assert count(0.9 * rule.longest, 1.1 * rule.height) == 1
    assert count(1.2 * rule.longest, 1.1 * rule.height) == 0
    assert count(0.9 * rule.longest, 0.8 * rule.height) == 0


def test_an_event_moves_as_one_and_its_neighbours_stay():
    shot = face()
    blink = next(e for e in events(shot) if e.kind == "blink")
    later = moved(shot, blink, 0.4)
    for name in ("eyeBlinkLeft", "eyeBlinkRight"):
        before, after = shot.curves[name], later.curves[name]
        inside = np.linspace(0.9, 1.25, 30)
        np.testing.assert_allclose(after.evaluate(inside + 0.4), before.evaluate(inside), atol=1e-9)
        assert (after.time[0], after.time[-1]) == (before.time[0], before.time[-1])
    assert later.curves["browInnerUp"] == shot.curves["browInnerUp"]
    again = next(e for e in events(later) if e.kind == "blink")
    back = moved(later, again, -0.4)
    grid = np.linspace(0, 10, 500)
    for name, curve in shot.curves.items():
        np.testing.assert_allclose(
            back.curves[name].evaluate(grid), curve.evaluate(grid), atol=1e-9
        )


def test_an_event_that_would_run_into_a_key_is_refused():
    shot = face()
    dart = next(e for e in events(shot) if e.kind == "eye dart")
    low, high = room(shot, dart)
    assert low == pytest.approx(-2.5 + 1 / 120)
    with pytest.raises(InputError, match=r"eye dart at 2\.50 s can be moved by"):
        moved(shot, dart, high + 0.1)
