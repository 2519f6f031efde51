"""face: what a person may well feed it, and the sentence that answers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from physretarget.face.curve import Curve, Key
from physretarget.face.formats import read_shots, write_csv, write_json
from physretarget.face.library import Library
from physretarget.face.shot import Shot, Take

TIME = np.arange(90) / 30.0
HEAD = "time,BrowInnerUp\n"


@pytest.fixture
def place(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    shots = []
    for n in range(4):
        times = np.cumsum(rng.uniform(0.2, 0.5, 7))
        shots.append(Shot(f"shot{n}", {"brow": Curve.through(times, rng.uniform(0, 1, 7))}))
    Library.of(shots).save(tmp_path / "lib.npz")
    take = Take("take", TIME, ("BrowInnerUp",), 0.5 + 0.4 * np.sin(4 * TIME)[:, None])
    write_csv(tmp_path / "take.csv", take)
    return tmp_path


@pytest.fixture
def matched(run, place):
    def call(capture: Path | None = None, *more: object, out: str = "out.curves.json"):
        take = capture or place / "take.csv"
        options = ("--library", place / "lib.npz", "--out", place / out)
        return run("face", "match", take, *options, *more)

    return call


def test_a_sound_match_with_a_report(matched, place) -> None:
    done = matched(None, "--report", place / "report", "--max-error", 0.03)
    assert done.code == 0, done.err
    assert "keys" in done.err
    (shot,) = read_shots(place / "out.curves.json")
    assert 2 <= len(shot.curves["BrowInnerUp"].keys) < 20
    told = json.loads((place / "report" / "report.json").read_text())
    assert told["channels"]["BrowInnerUp"]["pieces"][0]["kind"] in ("ease", "decelerate")
    assert told["settings"]["max_error"] == 0.03
    assert "<html" in (place / "report" / "index.html").read_text()


@pytest.mark.parametrize("method", ["distance", "sax", "hmm"])
def test_the_paper_as_written(matched, place, method) -> None:
    done = matched(None, "--preset", "ruhland2017", "--method", method, "--tau", 0.1)
    assert done.code == 0, done.err
    (shot,) = read_shots(place / "out.curves.json")
    assert 2 <= len(shot.curves["BrowInnerUp"].keys) < 40


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD, "two frames"),
        ("", "empty"),
        (HEAD + "0,1\n", "two frames"),
        (HEAD + "0,1\n0,2\n0.1,3\n", "increase"),
        (HEAD + "0,1\n0.2,2\n0.1,3\n", "increase"),
        (HEAD + "0,1\n0.1,nan\n0.2,3\n", "finite"),
        (HEAD + "0,1\n0.1,x\n0.2,3\n", "x"),
        (HEAD + "0,1\n0.1\n0.2,3\n", ":3: 1 columns"),
    ],
)
def test_unusable_captures(matched, place, text: str, says: str) -> None:
    (place / "bad.csv").write_text(text)
    done = matched(place / "bad.csv")
    assert done.code == 2, done.err
    assert says in done.err
    assert "bad" in done.err
    assert "Traceback" not in done.err
    assert not (place / "out.curves.json").exists()


def test_constant_and_short_captures_are_matched(matched, place) -> None:
    write_csv(place / "still.csv", Take("s", TIME, ("BrowInnerUp",), np.full((90, 1), 0.3)))
    assert matched(place / "still.csv").code == 0
    (shot,) = read_shots(place / "out.curves.json")
    assert len(shot.curves["BrowInnerUp"].keys) == 2
    # Every segment of the library is longer than these three frames.
    write_csv(place / "short.csv", Take("s", TIME[:3], ("BrowInnerUp",), np.eye(3)[:, :1]))
    assert matched(place / "short.csv").code == 0


def test_channels_the_rig_lacks_or_the_capture_lacks(matched, place) -> None:
    (place / "rig.toml").write_text("[channels.a]\nfrom = { EyeWideLeft = 1.0 }\n")
    done = matched(None, "--rig", place / "rig.toml")
    assert done.code != 0
    assert "EyeWideLeft" in done.err
    assert "BrowInnerUp" in done.err
    (place / "rig.toml").write_text("[channels.BrowInnerUp]\n")
    two = Take("t", TIME, ("BrowInnerUp", "JawOpen"), np.stack([np.sin(TIME), TIME], 1))
    write_csv(place / "two.csv", two)
    assert matched(place / "two.csv", "--rig", place / "rig.toml").code == 0
    (shot,) = read_shots(place / "out.curves.json")
    assert list(shot.curves) == ["BrowInnerUp"]


@pytest.mark.parametrize("cut", [1, 40, 200, -3])
def test_truncated_json(run, place, cut: int) -> None:
    write_json(place / "shot.curves.json", Shot("s", {"a": Curve.through([0, 1], [0, 1])}))
    whole = (place / "shot.curves.json").read_text()
    (place / "cut.curves.json").write_text(whole[:cut])
    done = run("face", "library", place / "cut.curves.json", "--out", place / "new.npz")
    assert done.code != 0
    assert "cut.curves.json" in done.err
    assert "Traceback" not in done.err
    assert not (place / "new.npz").exists()


def test_libraries_of_nothing(run, place) -> None:
    one = Curve((Key(0.0, 1.0),))
    still = Curve.through([0, 1], [2, 2])
    write_json(place / "one.curves.json", Shot("s", {"a": one, "b": still}))
    done = run("face", "library", place / "one.curves.json", "--out", place / "new.npz")
    assert done.code != 0
    assert "no file with animated curves" in done.err
    (place / "empty").mkdir()
    done = run("face", "library", place / "empty", "--out", place / "new.npz")
    assert done.code != 0
    (place / "torn.npz").write_bytes((place / "lib.npz").read_bytes()[:200])
    done = run("face", "match", place / "take.csv", "--library", place / "torn.npz",
               "--out", place / "o.anim")  # fmt: skip
    assert done.code != 0
    assert "torn.npz" in done.err


def test_locked_keys_and_a_range(matched, place) -> None:
    lock = Key(1.0, 0.6, (-0.1, 0.0), (0.1, 0.0))
    shot = Shot("locks", {"BrowInnerUp": Curve((lock, Key(2.0, 0.4, (-0.1, 0), (0.1, 0))))})
    write_json(place / "locks.curves.json", shot)
    done = matched(None, "--locked", place / "locks.curves.json", "--start", 0.5, "--end", 2.5)
    assert done.code == 0, done.err
    (made,) = read_shots(place / "out.curves.json")
    keys = made.curves["BrowInnerUp"].keys
    assert (keys[0].time, keys[-1].time) == pytest.approx((0.5, 2.5))
    assert any(k.time == 1.0 and k.value == 0.6 for k in keys)
    done = matched(None, "--start", 50)
    assert done.code != 0
    assert "two frames" in done.err
    for option in (("--fidelity", 0), ("--key-cost", "nan"), ("--method", "dtw")):
        assert matched(None, *option).code == 2


def test_events_are_listed_and_one_is_moved(run, place) -> None:
    times = [0.0, 0.9, 1.0, 1.05, 1.25, 3.0]
    lids = {n: Curve.through(times, [0, 0, 1, 1, 0, 0], "flat")
            for n in ("eyeBlinkLeft", "eyeBlinkRight")}  # fmt: skip
    write_json(place / "take.curves.json", Shot("take", lids))
    told = run("face", "events", place / "take.curves.json")
    assert told.code == 0, told.err
    lines = told.out.splitlines()
    assert [line.split()[1] for line in lines] == ["hold", "blink", "hold"]
    out = place / "later.anim"
    done = run("face", "events", place / "take.curves.json", "--move", 2, "--by", 0.5, "--out", out)
    assert done.code == 0, done.err
    (shot,) = read_shots(out)
    for curve in shot.curves.values():
        assert curve.time == pytest.approx([0.0, 1.4, 1.5, 1.55, 1.75, 3.0])
    far = run("face", "events", place / "take.curves.json", "--move", 2, "--by", 9, "--out", out)
    assert far.code == 2
    assert "before it runs into other keys" in far.err
    alone = run("face", "events", place / "take.curves.json", "--move", 2)
    assert alone.code != 0
    assert "belong together" in alone.err
