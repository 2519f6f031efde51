from __future__ import annotations

import json
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physretarget.errors import InputError, PhysretargetError, UsageError
from physretarget.face.curve import Curve, Key
from physretarget.face.formats import (
    read_csv,
    read_json,
    read_livelink,
    read_lottie,
    read_shots,
    read_spine,
    read_take,
    write_csv,
    write_json,
    write_lottie,
    write_shot,
)
from physretarget.face.shot import Shot, Take

HEADER = "Timecode,BlendShapeCount,BrowInnerUp,JawOpen\n"


def livelink(path, codes, values=None):
    rows = [f"{c},61,{v},0.5" for c, v in zip(codes, values or range(len(codes)), strict=True)]
    path.write_text(HEADER + "\n".join(rows) + "\n")
    return path


def test_livelink_30_hz_rows_on_a_60_clock_with_a_drop(tmp_path):
    # Frames count 60ths but come at 30 Hz; row 3 of the second second is missing.
    ticks = [n for n in range(0, 240, 2) if n != 66]
    codes = [f"01:00:{t // 60:02d}:{t % 60:02d}.453" for t in ticks]
    take = read_livelink(livelink(tmp_path / "a.csv", codes, [t / 60 for t in ticks]))
    assert take.fps == pytest.approx(30)
    assert len(take.time) == 120
    assert take.channel("BrowInnerUp") == pytest.approx(take.time, abs=1e-9)
    assert "1 dropped" in " ".join(take.notes)


def test_livelink_past_midnight_and_resampling(tmp_path):
    codes = [f"23:59:59:{n}.0" for n in range(58, 60)] + [f"00:00:00:{n}.0" for n in range(40)]
    take = read_livelink(livelink(tmp_path / "a.csv", codes), fps=30, clock=60)
    assert take.time[-1] == pytest.approx(41 / 60, abs=1 / 30)
    assert take.fps == pytest.approx(30)


def drop_frame(count, clock, start, mark=":"):
    """Live Link rows of a clock that leaves out the first numbers of a minute but each tenth."""
    skip = clock // 15
    rows = ["Timecode,BlendShapeCount,BrowInnerUp"]
    for k in range(start, start + count):
        tens, rest = divmod(k, 600 * clock - 9 * skip)
        number = k + 9 * skip * tens
        if rest >= skip:
            number += skip * ((rest - skip) // (60 * clock - skip))
        s, frame = divmod(number, clock)
        stamp = f"{s // 3600:02d}:{s // 60 % 60:02d}:{s % 60:02d}{mark}{frame:02d}.000"
        rows.append(f"{stamp},1,{(k - start) / 1000:.3f}")
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("clock", [30, 60])
def test_livelink_clocks_that_drop_numbers(tmp_path, clock):
    path = tmp_path / "t.csv"
    path.write_text(drop_frame(clock * 150, clock, clock * 595))  # over a tenth minute as well
    take = read_livelink(path)
    assert take.fps == pytest.approx(clock / 1.001)
    assert take.values[:, 0] == pytest.approx(np.arange(clock * 150) / 1000, abs=1e-9)
    assert take.notes == (
        f"Timecode counts {clock / 1.001:.4g} per second (drop-frame), "
        f"rows come at {clock / 1.001:.4g} Hz.",
    )
    path.write_text(drop_frame(90, clock, 0, ";"))
    assert read_livelink(path).fps == pytest.approx(clock / 1.001)


@pytest.mark.parametrize(
    "lines",
    [
        ["Timecode, BlendshapeCount, EyeBlinkLeft, JawOpen", "{}, 2, 0.1, 0.2"],
        ["Timecode,BlendShapeCount,EyeBlinkLeft,JawOpen,", "{},2,0.1,0.2,"],
        ['"Timecode","BlendShapeCount","EyeBlinkLeft","JawOpen"', '"{}",2,0.1,0.2'],
        ["Timecode;BlendShapeCount;EyeBlinkLeft;JawOpen", "{};2;0.1;0.2"],
        ["\ufeffTimecode,EyeBlinkLeft,JawOpen", "{},0.1,0.2"],
    ],
)
def test_livelink_tables_of_other_tools(tmp_path, lines):
    path = tmp_path / "t.csv"
    rows = [lines[0], *(lines[1].format(f"01:02:03:{k:02d}.125") for k in range(40))]
    path.write_bytes("\r\n".join(rows).encode())
    take = read_take(path)
    assert take.channels == ("EyeBlinkLeft", "JawOpen")
    assert take.values == pytest.approx(np.tile([0.1, 0.2], (40, 1)))
    assert take.fps == 60


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (HEADER + "01:00:00:01,61,0,0\n01:00:00:02,61,0\n", 3),
        (HEADER + "01:00:00:01,61,0,0\nnow,61,0,0\n", 3),
        (HEADER + "01:00:00:01,61,0,nan\n01:00:00:02,61,0,0\n", 2),
        (HEADER + "01:00:00:01,61,0,x\n01:00:00:02,61,0,0\n", 2),
        ("Timecode,BlendShapeCount,A,A\n", 1),
    ],
)
def test_livelink_errors_name_the_line(tmp_path, text, line):
    path = tmp_path / "a.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_livelink(path)
    assert caught.value.line == line


def test_real_takes(data):
    rom = read_take(data / "face" / "livelink_rom_4.csv")
    assert rom.fps == pytest.approx(30)
    assert rom.time[-1] == pytest.approx(126.98, abs=0.05)
    assert any("2 dropped" in note for note in rom.notes)
    slate = read_take(data / "face" / "neurosync_slate164.csv")
    assert slate.fps == pytest.approx(60)
    assert slate.values.shape[1] == 61


curves = st.builds(
    lambda gaps, rows: Curve(
        tuple(
            Key(float(t), v, (-abs(a), b), (abs(c), d), broken=True)
            for t, (v, a, b, c, d) in zip(np.cumsum(gaps[: len(rows)]), rows, strict=False)
        )
    ),
    st.lists(st.floats(0.01, 2), min_size=6, max_size=6),
    st.lists(st.tuples(*[st.floats(-10, 10)] * 5), min_size=1, max_size=6),
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(curves, curves)
def test_json_round_trip_is_exact(tmp_path, one, two):
    shot = Shot("s", {"brow": one, "lid": two}, 24.0)
    assert write_json(tmp_path / "s.json", shot) == ()
    back = read_json(tmp_path / "s.json")
    assert dict(back.curves) == dict(shot.curves)
    assert (back.name, back.fps) == ("s", 24.0)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(curves)
def test_lottie_round_trip_keeps_the_shape(tmp_path, curve):
    shot = Shot("s", {"brow.rotation": curve, "brow.position.x": curve, "BrowUp": curve}, 30.0)
    assert write_lottie(tmp_path / "s.json", shot) == ()
    back = read_lottie(tmp_path / "s.json")
    if len(curve.keys) == 1:
        return
    time = np.linspace(curve.start - 0.1, curve.end + 0.1, 100)
    assert set(back.curves) == {"brow.rotation", "brow.position.x", "BrowUp.value"}
    for got in back.curves.values():
        # Near-vertical stretches move the value much for the time's last digit.
        near = [curve.evaluate(time + e) for e in (-1e-7, 0, 1e-7)]
        low, high = np.min(near, axis=0) - 1e-5, np.max(near, axis=0) + 1e-5
        value = got.evaluate(time)
        assert ((value >= low) & (value <= high)).all()


def test_lottie_forms(tmp_path):
    keys = [
        {"t": 0, "s": [0], "e": [10], "o": {"x": 0.5, "y": 0}, "i": {"x": [0.5], "y": [1]}},
        {"t": 30, "s": [10], "h": 1},
        {"t": 60, "s": [20]},
        {"t": 60, "s": [30]},
    ]
    layer = {"ty": 3, "nm": "brow", "ks": {"r": {"a": 1, "k": keys}}}
    (tmp_path / "a.json").write_text(json.dumps({"fr": 60, "layers": [layer]}))
    shot = read_shots(tmp_path / "a.json")[0]
    curve = shot.curves["brow.rotation"]
    assert curve.evaluate([0.25, 0.6, 0.99, 1.0]) == pytest.approx([5, 10, 10, 30])
    assert any("shares its time" in note for note in shot.notes)


def test_real_lottie(data):
    shot = read_shots(data / "keys" / "noto" / "1f620.json")[0]
    assert shot.fps == 60
    assert shot.curves
    assert all(np.isfinite(c.sample(60)).all() for c in shot.curves.values())


def test_spine(tmp_path, data):
    bones = {
        "head": {
            "rotate": [
                {"value": 1, "curve": [0.1, 1, 0.2, 5]},
                {"time": 0.3, "value": 5, "curve": "stepped"},
                {"time": 0.6},
            ]
        }
    }
    content = {"skeleton": {"spine": "4.2"}, "bones": [], "animations": {"nod": {"bones": bones}}}
    path = tmp_path / "a.json"
    path.write_text(json.dumps(content))
    (shot,) = read_shots(path)
    curve = shot.curves["head.rotate"]
    assert curve.keys[0].out_tangent == pytest.approx((0.1, 0.0))
    assert curve.keys[1].in_tangent == pytest.approx((-0.1, 0.0))
    assert curve.evaluate([0.4, 0.6]).tolist() == [5, 0]
    shots = read_spine(data / "keys" / "spine" / "spineboy-pro.json")
    assert {s.name.split(":")[1] for s in shots} >= {"walk", "run", "idle"}


def test_csv_round_trip_is_exact(tmp_path):
    rng = np.random.default_rng(0)
    take = Take("x.csv", np.arange(9) / 7.0, ("a", "b"), rng.normal(size=(9, 2)))
    write_csv(tmp_path / "x.csv", take)
    back = read_csv(tmp_path / "x.csv")
    assert np.array_equal(back.values, take.values)
    assert back.channels == take.channels


def test_unknown_suffixes_list_the_known(tmp_path):
    (tmp_path / "a.fbx").write_text("")
    with pytest.raises(InputError, match=r"\.json"):
        read_shots(tmp_path / "a.fbx")
    with pytest.raises(UsageError, match=r"\.json"):
        write_shot(tmp_path / "a.fbx", Shot("s", {}))


@pytest.mark.parametrize("reader", [read_shots, read_lottie, read_spine, read_json])
def test_truncated_json_names_the_line(tmp_path, reader):
    path = tmp_path / "a.json"
    path.write_text('{"layers": [\n{"nm": "x",')
    with pytest.raises(InputError) as caught:
        reader(path)
    assert caught.value.line == 2


def damaged(text, places):
    content = bytearray(text.encode())
    for where, what in places:
        content[int(where * (len(content) - 1))] = what
    return bytes(content)


places = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=6)
WORDS = (
    "fr",
    "ks",
    "p",
    "r",
    "s",
    "o",
    "a",
    "k",
    "t",
    "i",
    "x",
    "y",
    "to",
    "ti",
    "nm",
    "ty",
    "shapes",
    "it",
    "ef",
    "v",
    "h",
    "e",
    "keys",
    "time",
    "value",
    "in",
    "out",
    "curves",
    "bones",
    "rotate",
    "translate",
    "curve",
)
junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=4),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(WORDS),
            inner,
            max_size=5,
        )
    ),
    max_leaves=25,
)
fuzz = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@fuzz
@given(junk)
def test_any_json_is_read_or_refused(tmp_path, content):
    path = tmp_path / "a.json"
    if isinstance(content, dict):
        whole = {"fr": 30, "layers": [{"ks": dict(content)}], "bones": []}
        content = whole | {"animations": {"a": {"bones": {"b": dict(content)}}}} | content
    path.write_text(json.dumps(content))
    for reader in (read_shots, read_lottie, read_spine, read_json):
        with suppress(PhysretargetError):
            reader(path)


LOTTIE = json.dumps(
    {
        "fr": 60,
        "layers": [
            {
                "ty": 3,
                "nm": "brow",
                "ks": {
                    "p": {
                        "a": 1,
                        "k": [
                            {
                                "t": 0,
                                "s": [0, 1],
                                "o": {"x": 0.5, "y": 0},
                                "i": {"x": [0.5], "y": [1]},
                                "to": [1, 2],
                                "ti": [0, 3],
                            },
                            {"t": 30, "s": [10, 2], "h": 1},
                            {"t": 60, "s": [20, 1]},
                        ],
                    },
                    "r": {"a": 1, "k": [{"t": 0, "s": [1]}, {"t": 9, "s": [4]}]},
                },
            }
        ],
    }
)


@fuzz
@given(places)
def test_damaged_lottie_is_read_or_refused(tmp_path, places):
    path = tmp_path / "a.json"
    path.write_bytes(damaged(LOTTIE, places))
    with suppress(PhysretargetError):
        read_lottie(path)


@fuzz
@given(places)
def test_damaged_csv_is_read_or_refused(tmp_path, places):
    path = tmp_path / "a.csv"
    rows = "".join(f"01:00:00:{n}.5,61,0.{n},0.5\n" for n in range(20))
    path.write_bytes(damaged(HEADER + rows, places))
    with suppress(PhysretargetError):
        read_livelink(path)
    path.write_bytes(damaged("time,a\n" + "".join(f"{n},0.{n}\n" for n in range(9)), places))
    with suppress(PhysretargetError):
        read_csv(path)
