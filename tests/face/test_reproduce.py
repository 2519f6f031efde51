"""reproduce ruhland2017, small: counts add up, quotes are the paper's, files are written."""

from __future__ import annotations

import json

import numpy as np
import pytest

from physretarget.errors import InputError
from physretarget.face.curve import Curve
from physretarget.face.formats import write_csv, write_json
from physretarget.face.recover import Recovery, difference
from physretarget.face.reproduce import WAYS, ReproduceSettings, cuts, reproduce
from physretarget.face.reproduce_page import PAPER_KEYS, page, write_all
from physretarget.face.shot import Shot, Take


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("data")
    (root / "face").mkdir()
    (root / "keys").mkdir()
    rng = np.random.default_rng(0)
    for n in range(6):
        times = np.cumsum(rng.uniform(0.2, 0.6, 8))
        shot = Shot(f"shot{n}", {"brow": Curve.through(times, rng.uniform(0, 1, 8))})
        write_json(root / "keys" / f"shot{n}.curves.json", shot)
    time = np.arange(200) / 30.0
    values = 0.5 + 0.4 * np.sin(time[:, None] * np.array([2.0, 3.5, 5.0]))
    take = Take("take", time, ("BrowInnerUp", "EyeBlinkLeft", "JawOpen"), values)
    write_csv(root / "face" / "take.csv", take)
    return root


SMALL = ReproduceSettings(takes=1, curves=6, variants=2)


@pytest.fixture(scope="module")
def found(folder):
    return reproduce(folder, SMALL)


def test_cuts_are_four_seconds_from_zero():
    take = Take("t", np.arange(400) / 30.0, ("a",), np.arange(400.0)[:, None])
    pieces = list(cuts(take, ReproduceSettings(takes=3)))
    assert [len(p.time) for p in pieces] == [121] * 3
    assert [p.time[0] for p in pieces] == [0, 0, 0]
    assert [p.values[0, 0] for p in pieces] == [0, 140, 279]
    assert not list(cuts(take, ReproduceSettings(seconds=60)))


def test_counts_and_equal_key_count(found):
    assert (found.takes, found.channels, found.frames) == (1, 2, 121)
    rows = {r.name: r for r in found.rows}
    assert len(rows) == 4 * 4
    for way in WAYS:
        assert 2 <= rows[way].keys < 60
        assert rows[f"decimate at {way}'s count"].keys == rows[way].keys
    assert found.tested == ("shot2", "shot5")
    assert [(a.fps, a.variant) for a in found.recovery] == [
        (fps, way) for fps in (60.0, 30.0, 24.0) for way in WAYS
    ]
    for asked in (*found.recovery, *found.variants):
        own, plain, fitted, _ = asked.rows
        if own.curves:
            assert own.keys == pytest.approx(plain.keys)
            assert 0 <= own.f1 <= 1
            assert fitted.doubtful is None


def test_a_run_goes_on_where_it_was_cut_short(folder, found, tmp_path):
    class Stop(Exception):
        pass

    steps = []

    def cut_short(stage):
        steps.append(stage)
        if len(steps) == 4:
            raise Stop

    with pytest.raises(Stop):
        reproduce(folder, SMALL, parts=tmp_path, progress=cut_short)
    kept = {p: p.stat().st_mtime_ns for p in tmp_path.iterdir()}
    assert len(kept) == 2  # the library and the step that was interrupted keep nothing
    (tmp_path / "torn.json").write_text("{")
    again = reproduce(folder, SMALL, parts=tmp_path)
    assert {p: p.stat().st_mtime_ns for p in kept} == kept
    assert [r.keys for r in again.rows] == [r.keys for r in found.rows]
    assert again.recovery == found.recovery


def test_files(found, tmp_path):
    written = write_all(found, tmp_path / "out")
    assert [p.name for p in written] == ["index.html", "ruhland2017.json", "take.html"]
    content = json.loads(written[1].read_text())
    assert content["frames_per_take"] == 121
    assert all(len(one["sha256"]) == 64 for one in content["inputs"])
    text = written[0].read_text()
    for number in PAPER_KEYS.values():
        assert str(number) in text
    assert "F(4, 64) = 36.633" in text
    assert "quoted, not repeated" in text
    assert page(found) == text
    assert "http" not in text.replace("http-equiv", "")


def test_missing_folders_are_named(tmp_path):
    with pytest.raises(InputError, match="keys"):
        reproduce(tmp_path)


def test_the_library_is_measured_against_its_absence(found):
    """Too few files to learn from: both ways are the same, and the page says by how much."""
    assert [(c.fps, c.variant) for c in found.controls] == [
        (fps, "programme alone") for fps in (60.0, 30.0, 24.0)
    ]
    for (_, _, gain, low, high), control in zip(found.library_gain(), found.controls, strict=True):
        assert low <= gain <= high
        own = next(
            a for a in found.recovery if (a.fps, a.variant) == (control.fps, "default")
        ).rows[0]
        assert gain == pytest.approx(own.f1 - control.rows[0].f1)
        assert sum(n for _, n in own.by_file) == own.curves
    told = found.to_json()["library_over_programme"]
    assert [row["fps"] for row in told] == [60.0, 30.0, 24.0]
    assert "What does the library add?" in page(found)


def test_the_interval_is_over_files():
    """Two files that disagree are wide apart however many curves they have."""

    def recovery(*per_file: tuple[float, int]) -> Recovery:
        numbers = [0.0] * 10
        return Recovery("match", sum(n for _, n in per_file), *numbers, by_file=per_file)

    one = recovery((60.0, 100), (20.0, 100))
    other = recovery((50.0, 100), (20.0, 100))
    gain, low, high = difference(one, other)
    assert gain == pytest.approx(0.05)
    assert (low, high) == pytest.approx((0.0, 0.1))
