"""What face recorders write: each format back to its numbers, lost rows, times, hostile files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from physretarget.errors import InputError, PhysretargetError
from physretarget.face.curve import Curve
from physretarget.face.formats import read_shots, read_take, write_shot
from physretarget.face.formats.registry import FORMATS, table
from physretarget.face.rig import Rig, RigChannel
from physretarget.face.shot import Shot

ROOT = Path(__file__).parents[2]
NAMES = ("eyeBlinkLeft", "eyeBlinkRight", "jawOpen")
SHORT = ("eyeBlink_L", "eyeBlink_R", "jawOpen")
Array = NDArray[np.float64]
QUIET = settings(
    max_examples=30,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def audio2face(values: Array, times: Array) -> str:
    rate = 1 / (times[1] - times[0])
    rows = [None if np.isnan(v).any() else v.tolist() for v in values]
    return json.dumps({"exportFps": rate, "facsNames": NAMES, "weightMat": rows})


def audio2face_table(values: Array, times: Array) -> str:
    head = ",timeCode," + ",".join(f"blendShapes.{n[0].upper()}{n[1:]}" for n in NAMES)
    return head + "\n" + rows(values, times, lambda k, t: f"{k},{t!r}", ",")


def rows(values: Array, times: Array, lead: Callable[[int, float], str], comma: str) -> str:
    lines = []
    for k, (t, row) in enumerate(zip(times.tolist(), values.tolist(), strict=True)):
        cells = ["" if math.isnan(v) else repr(v) for v in row]
        if comma == ";":
            cells = [c.replace(".", ",") for c in cells]
        lines.append(comma.join([lead(k, t), *cells]))
    return "\n".join(lines) + "\n"


def mediapipe(values: Array, times: Array) -> str:
    frames = []
    for t, row in zip(times.tolist(), values.tolist(), strict=True):
        named = [("_neutral", 0.0), *zip(NAMES, row, strict=True)]
        listed = [{"index": i, "categoryName": n, "score": v} for i, (n, v) in enumerate(named)]
        faces = [] if np.isnan(row).any() else [{"headIndex": -1, "categories": listed}]
        frames.append({"timestamp_ms": 1000 * t, "faceBlendshapes": faces})
    return json.dumps(frames)


def mediapipe_python(values: Array, times: Array) -> str:
    lines = []
    for t, row in zip(times.tolist(), values.tolist(), strict=True):
        listed = [{"category_name": n, "score": v} for n, v in zip(NAMES, row, strict=True)]
        faces = [] if np.isnan(row).any() else [listed]
        lines.append(json.dumps({"timestamp": round(1e9 * t), "face_blendshapes": faces}))
    return "\n".join(lines)


def mediapipe_table(values: Array, times: Array) -> str:
    lead = lambda k, t: f"{k},{1000 * t!r},0.0"  # noqa: E731
    return "frame,timestamp_ms,_neutral," + ",".join(NAMES) + "\n" + rows(values, times, lead, ",")


def commas(values: Array, times: Array) -> str:
    lead = lambda k, t: repr(t).replace(".", ",")  # noqa: E731
    return "time;" + ";".join(NAMES) + "\n" + rows(values, times, lead, ";")


def clock(values: Array, times: Array) -> str:
    lead = lambda k, t: f"01:{int(t // 60) + 59:02d}:{t % 60:09.6f}"  # noqa: E731
    return "Timecode," + ",".join(NAMES) + "\n" + rows(values, times, lead, ",")


def facecap(values: Array, times: Array) -> str:
    lines = ["info,FaceCap,time in nano seconds", "bs," + ",".join(SHORT)]
    for t, row in zip(times.tolist(), values.tolist(), strict=True):
        lines.append(",".join(["k", repr(1000 * t), *["0.5"] * 10, *(repr(v) for v in row)]))
    return "\n".join(lines)


def ifacialmocap(values: Array, times: Array) -> str:
    lines = []
    for t, row in zip(times.tolist(), values.tolist(), strict=True):
        lost = np.isnan(row).any()
        weights = [f"{n}&{0.0 if lost else 100 * v:f}" for n, v in zip(SHORT, row, strict=True)]
        packet = "|".join([*weights, f"trackingStatus&{int(not lost)}"])
        packet += "|=head#1.5,-2.5,0.25,0.0,0.0,-0.5|rightEye#1,2,0|leftEye#1,2,0|"
        lines.append(json.dumps({"t": 1000 * t, "d": packet}))
    return "\n".join(lines)


def vmc(values: Array, times: Array) -> str:
    lines = []
    for t, row in zip(times.tolist(), values.tolist(), strict=True):
        seconds, part = divmod(t + 0xE5000000, 1.0)
        tag = f"{int(seconds):08x}.{int(part * 2**32):08x}"
        lines += [f'{tag} /VMC/Ext/Bone/Pos sfffffff "Head" 0 0 0 0 0 0 1']
        for n, v in zip(NAMES, row, strict=True):
            lines.append(f'{tag} /VMC/Ext/Blend/Val sf "{n}" {v!r}')
        lines.append(f"{tag} /VMC/Ext/Blend/Apply ")
    return "\n".join(lines)


def vrchat(values: Array, times: Array) -> str:
    lines = []
    for t, row in zip(times.tolist(), values.tolist(), strict=True):
        for n, v in zip(NAMES, row, strict=True):
            message = {"time": t, "address": f"/avatar/parameters/{n}", "args": [v]}
            lines.append(json.dumps(message))
    return "\n".join(lines)


WRITERS: dict[str, tuple[str, Callable[[Array, Array], str], float]] = {
    "audio2face": (".json", audio2face, 1e-12),
    "audio2face table": (".csv", audio2face_table, 1e-12),
    "mediapipe": (".json", mediapipe, 1e-12),
    "mediapipe of Python": (".jsonl", mediapipe_python, 1e-12),
    "mediapipe table": (".csv", mediapipe_table, 1e-12),
    "decimal commas": (".csv", commas, 1e-12),
    "times of day": (".csv", clock, 1e-12),
    "facecap": (".txt", facecap, 1e-12),
    "ifacialmocap": (".jsonl", ifacialmocap, 1e-7),
    "vmc": (".txt", vmc, 1e-12),
    "vrchat": (".jsonl", vrchat, 1e-12),
}
NO_GAPS = ("facecap", "vmc", "vrchat")


def saved(folder: Path, kind: str, values: Array, rate: float) -> Path:
    suffix, write, _ = WRITERS[kind]
    path = folder / f"take{suffix}"
    path.write_text(write(values, np.arange(len(values)) / rate))
    return path


def drive(path: Path) -> Array:
    """The three channels, whatever the recorder calls them."""
    rig = Rig("face", tuple(RigChannel(n, "other", -2.0, 2.0, {n: 1.0}) for n in NAMES))
    return rig.drive(read_take(path)).values


@pytest.mark.parametrize("kind", WRITERS)
def test_the_numbers_come_back(tmp_path, kind):
    @QUIET
    @given(
        st.sampled_from([24.0, 25.0, 30.0, 60.0, 120.0]),
        st.integers(2, 90),
        st.integers(0, 2**32 - 1),
    )
    def check(rate, count, seed):
        values = np.random.default_rng(seed).uniform(0.0, 1.0, (count, 3)).round(6)
        path = saved(tmp_path, kind, values, rate)
        take = read_take(path)
        assert take.fps == pytest.approx(rate, rel=1e-4)
        assert take.time[0] == 0.0
        assert "left out" not in " ".join(take.notes)
        np.testing.assert_allclose(drive(path), values, atol=WRITERS[kind][2])

    check()


@pytest.mark.parametrize("kind", [k for k in WRITERS if k not in NO_GAPS])
def test_lost_rows_are_gaps_and_no_zeros(tmp_path, kind):
    """A straight line with rows lost in the middle is that line again, and the notes tell."""
    line = np.linspace(0.2, 0.8, 31)[:, None] * np.array([1.0, 0.5, 0.25])
    values = line.copy()
    values[10:20] = np.nan
    path = saved(tmp_path, kind, values, 30.0)
    np.testing.assert_allclose(drive(path), line, atol=1e-6)
    told = " ".join(read_take(path).notes)
    assert "10 rows with a lost face" in told
    assert "0.37 s" in told


def test_live_link_rows_without_a_face_are_gaps(tmp_path):
    path = tmp_path / "take.csv"
    lines = [f"00:00:00:{k:02d},{0 if 5 <= k < 8 else 3},{k / 10}" for k in range(12)]
    lines[5] = "00:00:00:05,0,"
    lines[6] = "00:00:00:06,0"
    lines[7] = "00:00:00:07,0,0.0"
    path.write_text("Timecode,BlendshapeCount,JawOpen\n" + "\n".join(lines))
    take = read_take(path)
    np.testing.assert_allclose(take.channel("JawOpen"), np.arange(12) / 10, atol=1e-9)
    assert "3 dropped frames" in " ".join(take.notes)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_units_of_time_are_found(tmp_path, unit):
    size = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[unit]
    times = 1.7e9 + np.arange(60) / 60.0  # clocks that count from 1970
    cells = [str(round(t / size)) if unit != "s" else f"{t:.6f}" for t in times.tolist()]
    path = tmp_path / "take.csv"
    rows = "".join(f"{c},{k / 60}\n" for k, c in enumerate(cells))
    path.write_text(f"timestamp,jawOpen\n{rows}")
    take = read_take(path)
    assert take.fps == pytest.approx(60.0, rel=1e-3)
    assert take.time[0] == 0.0


def test_packets_without_times_come_at_the_rate_of_the_app(tmp_path):
    path = tmp_path / "take.txt"
    path.write_text("".join(f"jawOpen-{k}|eyeBlink_L-0|=head#0,{k},0|\n" for k in range(60)))
    take = read_take(path)
    assert take.fps == pytest.approx(60.0)
    assert "taken for granted" in " ".join(take.notes)
    np.testing.assert_allclose(take.channel("jawOpen"), np.arange(60) / 100)
    np.testing.assert_allclose(take.channel("head.rotation.y"), np.arange(60))


def test_what_vmc_does_not_send_again_keeps_its_value(tmp_path):
    def message(t: float, address: str, *args: object) -> str:
        return json.dumps({"time": t, "address": address, "args": list(args)})

    lines = []
    for k in range(4):
        t = k / 30
        lines.append(message(t, "/VMC/Ext/Blend/Val", "Blink", k / 10))
        if k == 1:
            lines.append(message(t, "/VMC/Ext/Blend/Val", "Joy", 0.5))
        lines.append(message(t, "/VMC/Ext/Blend/Apply"))
    (tmp_path / "take.jsonl").write_text("\n".join(lines))
    take = read_take(tmp_path / "take.jsonl")
    np.testing.assert_allclose(take.channel("Joy"), 0.5)
    np.testing.assert_allclose(take.channel("Blink"), [0.0, 0.1, 0.2, 0.3])


CLIP = """%YAML 1.1
%TAG !u! tag:unity3d.com,2011:
--- !u!74 &7400000
AnimationClip:
  m_ObjectHideFlags: 0
  m_Name: Smile
  m_PositionCurves:
  - curve:
      serializedVersion: 2
      m_Curve:
      - time: 0
        value: {x: 0, y: 1, z: 2}
        inSlope: {x: 0, y: 0, z: 0}
        outSlope: {x: 1, y: 0, z: 0}
      - time: 1
        value: {x: 1, y: 1, z: 2}
        inSlope: {x: 1, y: 0, z: 0}
        outSlope: {x: 1, y: 0, z: 0}
    path: Head
  m_FloatCurves:
  - curve:
      serializedVersion: 2
      m_Curve:
      - serializedVersion: 3
        time: 0
        value: 0
        inSlope: 0
        outSlope: 200
        tangentMode: 0
        weightedMode: 0
        inWeight: 0.33333334
        outWeight: 0.33333334
      - serializedVersion: 3
        time: 0.5
        value: 100
        inSlope: 200
        outSlope: Infinity
        tangentMode: 0
        weightedMode: 1
        inWeight: 0.6
        outWeight: 0.33333334
      - serializedVersion: 3
        time: 0.75
        value: 20
        inSlope: -Infinity
        outSlope: 0
    attribute: blendShape.eyeBlinkLeft
    path: Body
    classID: 137
  m_PPtrCurves: []
  m_SampleRate: 30
"""


def test_a_clip_of_unity_is_a_shot_and_a_capture(tmp_path):
    path = tmp_path / "smile.anim"
    path.write_text(CLIP)
    (shot,) = read_shots(path)
    assert (shot.name, shot.fps) == ("Smile", 30.0)
    lid = shot.curves["eyeBlinkLeft"]
    assert len(lid.keys) == 3
    # Percent become fractions, slopes a second; the handle into the second key is 0.6 of its span.
    assert lid.keys[0].out_tangent == pytest.approx((0.5 / 3, 2.0 * 0.5 / 3))
    assert lid.keys[1].in_tangent == pytest.approx((-0.3, -0.6))
    assert lid.evaluate([0.25, 0.6, 0.7499, 0.75]) == pytest.approx([0.5, 1.0, 1.0, 0.2])
    assert shot.curves["Head.position.x"].evaluate([0.5]) == pytest.approx([0.5])
    take = read_take(path)
    assert take.fps == pytest.approx(30.0)
    np.testing.assert_allclose(take.channel("eyeBlinkLeft")[:16], np.arange(16) / 15, atol=1e-9)


def test_a_rig_finds_its_channels_in_any_spelling(tmp_path):
    path = tmp_path / "take.txt"
    path.write_text("".join(f"eyeBlink_L-{k}|eyeBlink_R-0|\n" for k in range(9)))
    take = read_take(path)
    rig = Rig("r", (RigChannel("lid", "lids", 0.0, 1.0, {"EyeBlinkLeft": 1.0}),))
    np.testing.assert_allclose(rig.drive(take).channel("lid"), np.arange(9) / 100)
    strange = Rig("r", (RigChannel("lid", "lids", 0.0, 1.0, {"EyeBlink": 1.0}),))
    with pytest.raises(InputError, match=r"EyeBlink, which take\.txt does not have"):
        strange.drive(take)


BROKEN = {
    "no rate": (".json", '{"facsNames": ["a"], "weightMat": [[0], [1]]}', "exportFps"),
    "rate of zero": (".json", '{"facsNames": ["a"], "weightMat": [[0]], "exportFps": 0}', "rate"),
    "short row": (
        ".json",
        '{"facsNames": ["a", "b"], "weightMat": [[0, 1], [1]], "exportFps": 30}',
        "row 1",
    ),
    "no times": (".json", '[{"blendshapes": {"a": 1}}, {"blendshapes": {"a": 1}}]', "timestamp_ms"),
    "no face": (".json", '[{"timestamp": 1, "blendshapes": {}}]', "face was seen in none"),
    "a word": (".json", '[{"timestamp": 1, "blendshapes": {"a": "x"}}]', "not a number"),
    "packet": (".txt", "jawOpen-1|\njawOpen:1|\n", ":2"),
    "some times": (".txt", "1 jawOpen-1|\njawOpen-2|\n", "some have none"),
    "types": (".txt", 'e5000000.00000000 /VMC/Ext/Blend/Val sf "a"\n', ":1"),
    "no weight": (".txt", "e5000000.00000000 /VMC/Ext/OK i 1\n", "no message with a weight"),
    "no names": (".txt", "info,x\nk,0,1,2\n", "bs must name"),
    "commas": (".txt", "bs,a\nk,0" + ",1" * 12 + "\n", "decimal points"),
    "backwards": (".txt", "".join(f"{t} jawOpen-1|\n" for t in (3, 2, 1)), "come after"),
    "no clip": (".anim", "--- !u!91 &1\nAnimationClip:\n", "no animation clip"),
    "aliases": (".anim", "--- !u!74 &1\nAnimationClip: &a\n  b: *a\n", "aliases"),
    "key of Unity": (
        ".anim",
        "--- !u!74 &1\nAnimationClip:\n  m_FloatCurves:\n  - curve:\n      m_Curve:\n"
        "      - {time: 0, value: x}\n    attribute: a\n",
        "key 0, value",
    ),
    "number of Unity": (
        ".anim",
        "--- !u!74 &1\nAnimationClip:\n  m_FloatCurves:\n  - curve:\n      m_Curve:\n"
        f"      - {{time: 0, value: {'9' * 400}}}\n    attribute: a\n",
        "too large",
    ),
    "weights of Unity": (
        ".anim",
        "--- !u!74 &1\nAnimationClip:\n  m_FloatCurves:\n  - curve:\n      m_Curve:\n"
        "      - {time: 0, value: 1, weightedMode: .inf}\n    attribute: a\n",
        "none of 0 to 3",
    ),
    "endless": (".csv", "time,a\n0,1\n0.001,1\n0.002,1\n1e9,2\n", "million frames"),
    "strangers": (".json", '{"name": "x"}', "its content is none of"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_broken_is_told_in_a_sentence(tmp_path, case):
    suffix, content, words = BROKEN[case]
    path = tmp_path / f"take{suffix}"
    path.write_text(content)
    with pytest.raises(InputError) as told:
        read_take(path)
    assert words in str(told.value)
    assert path.name in str(told.value)


DAMAGE = [b"", b"9" * 400, b"-1e999", b"NaN", b"\xff", b'"', b"[[", b"\n", b",", b"e308"]


@pytest.mark.parametrize("kind", [*WRITERS, "unity"])
def test_damaged_files_are_refused_or_read_never_worse(tmp_path, kind):
    values = np.random.default_rng(0).uniform(0, 1, (6, 3)).round(4)
    if kind == "unity":
        path, sound = tmp_path / "take.anim", CLIP.encode()
    else:
        path = saved(tmp_path, kind, values, 30.0)
        sound = path.read_bytes()

    @QUIET
    @given(st.integers(0, len(sound) - 1), st.sampled_from(DAMAGE), st.integers(0, 12))
    def check(place, new, gone):
        path.write_bytes(sound[:place] + new + sound[place + gone :])
        try:
            take = read_take(path)
        except PhysretargetError as error:
            told = str(error)
        else:
            told = path.name if np.isfinite(take.values).all() else "not finite"
        assert path.name in told

    check()


def test_morph_weights_keyed_at_every_frame_are_a_capture_at_that_rate(tmp_path):
    pytest.importorskip("pygltflib")
    times = np.arange(50) / 30.0
    dense = Shot("web capture", {"jawOpen": Curve.through(times, np.sin(times), "linear")})
    write_shot(tmp_path / "take.glb", dense)
    take = read_take(tmp_path / "take.glb")
    assert take.fps == pytest.approx(30.0, rel=1e-4)
    np.testing.assert_allclose(take.channel("jawOpen"), np.sin(times), atol=1e-5)


def test_dense_captures_are_no_shots(tmp_path):
    path = saved(tmp_path, "audio2face", np.zeros((3, 3)), 30.0)
    with pytest.raises(InputError, match="dense capture"):
        read_shots(path)


def test_the_docs_hold_the_table_of_formats():
    assert table() in (ROOT / "docs" / "face.md").read_text(encoding="utf-8")
    assert all(f.shots or f.take for f in FORMATS)
