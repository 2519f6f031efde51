"""Takes and shots as they lie about: milliseconds, odd timecodes, strangers among the shots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key
from physretarget.face.formats import read_take, write_json
from physretarget.face.library import Library
from physretarget.face.shot import Shot


def plain(path: Path, times: list[float]) -> Path:
    rows = "".join(f"{t},{np.sin(k / 5)}\n" for k, t in enumerate(times))
    path.write_text(f"time,jawOpen\n{rows}")
    return path


@pytest.mark.parametrize("rate", [24, 30, 60, 120])
def test_milliseconds_are_told_from_seconds(tmp_path: Path, rate: int) -> None:
    count = 40
    as_ms = read_take(plain(tmp_path / "ms.csv", [round(1000 * k / rate) for k in range(count)]))
    assert as_ms.fps == pytest.approx(rate, rel=0.02)
    assert as_ms.time[-1] == pytest.approx((count - 1) / rate, rel=0.03)
    assert "milliseconds" in " ".join(as_ms.notes)
    seconds = read_take(plain(tmp_path / "s.csv", [k / rate for k in range(count)]))
    assert seconds.fps == pytest.approx(rate)
    assert "milliseconds" not in " ".join(seconds.notes)


def test_a_slow_recording_in_seconds_stays_in_seconds(tmp_path: Path) -> None:
    assert read_take(plain(tmp_path / "slow.csv", list(range(10)))).time[-1] == pytest.approx(9)


def livelink(path: Path, frames: list[tuple[int, str]]) -> Path:
    rows = "".join(
        f"00:00:{second:02d}:{frame},51,{k / 100}\n" for k, (second, frame) in enumerate(frames)
    )
    path.write_text(f"Timecode,BlendshapeCount,JawOpen\n{rows}")
    return path


def test_a_fraction_that_runs_on_by_itself_is_no_dropped_frame(tmp_path: Path) -> None:
    """39.999, 40.000, 41.001: the whole numbers count, the fraction wraps without a carry."""
    frames = [(k // 60, f"{k % 60:02d}.{(980 + k) % 1000:03d}") for k in range(120)]
    take = read_take(livelink(tmp_path / "wrap.csv", frames))
    assert take.fps == pytest.approx(60)
    assert len(take.time) == 120
    assert "dropped" not in " ".join(take.notes)
    np.testing.assert_allclose(take.channel("JawOpen"), np.arange(120) / 100, atol=1e-9)


def test_a_fraction_that_places_rows_still_counts(tmp_path: Path) -> None:
    """59.94 rows a second on a clock of 60."""
    place = [k * 60 / 59.94 for k in range(200)]
    frames = [(int(p // 60), f"{int(p % 60):02d}.{round(p % 1 * 1000):03d}") for p in place]
    frames = [(s, f) for s, f in frames if not f.endswith(".1000")]
    take = read_take(livelink(tmp_path / "ntsc.csv", frames))
    assert take.fps == pytest.approx(59.94, rel=2e-3)


def shot(name: str) -> Shot:
    keys = tuple(Key(t, v) for t, v in ((0.0, 0.0), (0.4, 1.0), (1.0, 0.2)))
    return Shot(name, {"lid": Curve(keys).retangented()}, 30.0)


def test_strangers_in_a_folder_are_left_out_with_a_word(tmp_path: Path) -> None:
    write_json(tmp_path / "good.curves.json", shot("good"))
    (tmp_path / "package.json").write_text('{"name": "somebody\'s project"}')
    (tmp_path / "broken.json").write_text("{")
    told: list[str] = []
    library = Library.build([tmp_path], left_out=told.append)
    assert len(library.examples) == 1
    assert len(told) == 2
    assert any("package.json" in why for why in told)
    with pytest.raises(InputError, match=r"package\.json"):
        Library.build([tmp_path / "package.json"])


def test_a_shot_is_a_capture_too(tmp_path: Path) -> None:
    path = tmp_path / "good.curves.json"
    write_json(path, shot("good"))
    take = read_take(path)
    assert take.fps == pytest.approx(30)
    curve = shot("good").curves["lid"]
    np.testing.assert_allclose(take.channel("lid"), curve.evaluate(take.time), atol=1e-12)
    assert read_take(path, fps=120).fps == pytest.approx(120)


def test_a_shot_in_which_nothing_moves_is_no_capture(tmp_path: Path) -> None:
    path = tmp_path / "still.curves.json"
    write_json(path, Shot("still", {"lid": Curve((Key(0.0, 1.0),))}, 30.0))
    with pytest.raises(InputError, match="moves"):
        read_take(path)


def test_decimal_commas(tmp_path: Path) -> None:
    path = tmp_path / "komma.csv"
    rows = "".join(f"{k / 60:.4f};{np.sin(k / 5):.4f}\n".replace(".", ",") for k in range(60))
    path.write_text(f"time;jawOpen\n{rows}")
    take = read_take(path)
    assert take.fps == pytest.approx(60, rel=1e-3)
    np.testing.assert_allclose(take.channel("jawOpen"), np.sin(np.arange(60) / 5), atol=1e-3)


@pytest.mark.parametrize("digits", [3, 5])
def test_rounded_times_keep_their_rate(tmp_path: Path, digits: int) -> None:
    path = plain(tmp_path / "r.csv", [round(k / 60, digits) for k in range(300)])
    assert read_take(path).fps == pytest.approx(60, rel=1e-3)
