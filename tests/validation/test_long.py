"""Clips of any length: read some frames at a time, judged as if they had been read whole."""

from __future__ import annotations

import pickle
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from physretarget.archives import arrays
from physretarget.clip import Clip, load_clip, open_clip, scratch, table
from physretarget.clip.scratch import Rows, Scratch
from physretarget.errors import InputError
from physretarget.mjcf import Character
from physretarget.validation import Report, Settings, validate

Write = Callable[[Path, Clip], Path]


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seven frames at a time, everything in temporary files at once."""
    monkeypatch.setattr(scratch, "HELD_BYTES", 0)
    for module in (scratch, arrays, table):
        monkeypatch.setattr(module, "PART", 7)


def own(path: Path, clip: Clip) -> Path:
    clip.save(path / "a.npz")
    return path / "a.npz"


def compressed(path: Path, clip: Clip) -> Path:
    np.savez_compressed(path / "a.npz", qpos=clip.qpos, fps=clip.fps)
    return path / "a.npz"


def by_columns(path: Path, clip: Clip) -> Path:
    np.savez(path / "a.npz", qpos=np.asfortranarray(clip.qpos), fps=clip.fps)
    return path / "a.npz"


def gmr(path: Path, clip: Clip) -> Path:
    q = clip.qpos
    np.savez(
        path / "a.npz", root_pos=q[:, :3], root_rot=q[:, [4, 5, 6, 3]], dof_pos=q[:, 7:],
        fps=clip.fps,
    )  # fmt: skip
    return path / "a.npz"


def plain(path: Path, clip: Clip) -> Path:
    np.save(path / "a.npy", clip.qpos)
    return path / "a.npy"


def csv(path: Path, clip: Clip) -> Path:
    np.savetxt(path / "a.csv", clip.qpos, delimiter=",", fmt="%.17g")
    return path / "a.csv"


def timed_csv(path: Path, clip: Clip) -> Path:
    head = "time,x,y,z,qw,qx,qy,qz," + ",".join(clip.joint_names[1:])
    rows = np.c_[clip.time, clip.qpos]
    np.savetxt(path / "a.csv", rows, delimiter=",", fmt="%.17g", header=head, comments="")
    return path / "a.csv"


FORMATS = [own, compressed, by_columns, gmr, plain, csv, timed_csv]


def same(report: Report, other: Report) -> None:
    ours, theirs = report.to_dict(), other.to_dict()
    for document in (ours, theirs):
        document["clip"] = {k: document["clip"][k] for k in ("frames",)}
    assert ours == theirs
    assert set(report.series) == set(other.series)
    for name in report.series:
        np.testing.assert_array_equal(report.series[name], other.series[name])
    assert report.forces is not None
    assert other.forces is not None
    np.testing.assert_array_equal(report.forces.vector, other.forces.vector)


@pytest.mark.parametrize("write", FORMATS, ids=lambda f: f.__name__)
def test_parts_make_the_whole(
    write: Write, tmp_path: Path, biped: Character, hop: Clip, small_parts: None
) -> None:
    path = write(tmp_path, hop)
    read = open_clip(path, character=biped, fps=hop.fps, quat="wxyz" if write is csv else None)
    assert (read.frames, read.nq) == hop.qpos.shape
    np.testing.assert_allclose(read.whole().qpos, hop.qpos, atol=1e-15)
    np.testing.assert_allclose(read.between(3, 30), hop.qpos[3:30], atol=1e-15)
    np.testing.assert_allclose(read.time, hop.time, atol=1e-12)
    assert read.between(hop.frames - 2, hop.frames + 9).shape == (2, 13)


@pytest.mark.parametrize("hz", [None, 6.0])
@pytest.mark.parametrize("uneven", [False, True])
def test_a_clip_read_in_parts_gets_the_same_report(
    hz: float | None, uneven: bool, tmp_path: Path, biped: Character, hop: Clip,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    time = hop.time + (0.001 * np.sin(np.arange(hop.frames)) if uneven else 0.0)
    clip = Clip(qpos=hop.qpos, time=time, joint_names=hop.joint_names)
    clip.save(tmp_path / "a.npz")
    settings = Settings(lowpass_hz=hz, also_literature=True)
    whole = validate(load_clip(tmp_path / "a.npz", character=biped), biped, settings=settings)
    monkeypatch.setattr(scratch, "HELD_BYTES", 0)
    monkeypatch.setattr(arrays, "PART", 11)
    parts = validate(open_clip(tmp_path / "a.npz", character=biped), biped, settings=settings)
    same(whole, parts)
    # Reports travel between processes with all they show.
    copy = pickle.loads(pickle.dumps(parts))
    same(parts, copy)


def test_damage_in_a_later_part_is_named(tmp_path: Path, hop: Clip, small_parts: None) -> None:
    qpos = hop.qpos.copy()
    qpos[100, 8] = np.nan
    np.save(tmp_path / "a.npy", qpos)
    with pytest.raises(InputError, match="finite") as caught:
        open_clip(tmp_path / "a.npy", fps=30)
    assert caught.value.frame == 100
    qpos[100, 8], qpos[50, 3:7] = 0, 0.5
    qpos[90, 3:7] *= 1.04
    np.save(tmp_path / "a.npy", qpos)
    note = next(n for n in open_clip(tmp_path / "a.npy", fps=30).notes if "normalised" in n)
    assert "frame 90" in note


def test_scratch_gives_back_what_it_was_given() -> None:
    rng = np.random.default_rng(0)
    for held in (0, 1000, 1 << 20):
        kept = Scratch(held)
        parts = [rng.normal(size=n) for n in (5, 0, 300, 1, 40)]
        places = [kept.add(p) for p in parts]
        with ThreadPoolExecutor(4) as pool:
            sizes, kinds = map(len, parts), (p.dtype for p in parts)
            back = list(pool.map(kept.get, places, sizes, kinds))
        for part, found in zip(parts, back, strict=True):
            np.testing.assert_array_equal(part, found)


def test_an_hour_takes_no_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """108 000 frames of 36 numbers are 31 MB; opened, they are 2: their times, and a part."""
    values = np.zeros((108_000, 36))
    values[:, 3] = 1
    np.save(tmp_path / "hour.npy", values)
    del values
    tracemalloc.start()
    try:
        clip = open_clip(tmp_path / "hour.npy", fps=30)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert clip.frames == 108_000
    assert peak < scratch.HELD_BYTES + 8e6
    assert isinstance(clip.rows, Rows)
