from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from physretarget.errors import InputError
from physretarget.face.curve import Curve, Key
from physretarget.face.formats import read_shots, write_json
from physretarget.face.library import Library, LibrarySettings, halves
from physretarget.face.recover import hold_out
from physretarget.face.shot import Shot
from physretarget.face.sources import Shapes


def wave(count=9, seed=0):
    rng = np.random.default_rng(seed)
    return Curve.through(np.arange(count) * 0.25, rng.normal(size=count))


def test_halving_shares_the_median_key():
    assert set(halves(9, 4)) == {(0, 8), (0, 4), (4, 8)}
    assert set(halves(7, 4)) == {(0, 6), (0, 3), (3, 6)}
    assert halves(6, 4) == [(0, 5)]
    assert halves(3, 4) == []
    for first, last in halves(100, 4):
        assert last - first + 1 >= 4


def test_segments_are_longest_first_and_rebased():
    library = Library.of([Shot("a", {"x": wave()})], LibrarySettings())
    durations = [library.duration(s) for s in library.segments]
    assert durations == [2.0, 1.0, 1.0]
    last = library.curve(library.segments[-1])
    assert last.start == 0
    assert last.keys[0].value == library.examples[0].curve.keys[4].value


def test_curves_that_teach_nothing_are_left_out():
    flat = Curve((Key(0, 1), Key(1, 1)))
    library = Library.of([Shot("a", {"one": Curve((Key(0, 3),)), "flat": flat, "x": wave()})])
    assert [e.channel for e in library.examples] == ["x"]


def test_storing_is_deterministic_and_complete(tmp_path):
    library = Library.of([Shot("a", {"x": wave(), "y": wave(5, 2)}, sha256="abc")])
    library.save(tmp_path / "l.npz")
    back = Library.load(tmp_path / "l.npz")
    assert back.examples == library.examples
    assert back.segments == library.segments
    assert back.to_bytes() == library.to_bytes()
    assert "2 curves" in back.describe()


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing", b"\x93NUMPY"])
def test_what_is_no_library_is_refused(tmp_path, content):
    (tmp_path / "l.npz").write_bytes(content)
    with pytest.raises(InputError):
        Library.load(tmp_path / "l.npz")


def test_truncated_library_is_refused(tmp_path):
    content = Library.of([Shot("a", {"x": wave()})]).to_bytes()
    for cut in (10, len(content) // 2, len(content) - 5):
        (tmp_path / "l.npz").write_bytes(content[:cut])
        with pytest.raises(InputError):
            Library.load(tmp_path / "l.npz")


def test_incremental_build_reads_only_what_changed(tmp_path, monkeypatch):
    write_json(tmp_path / "a.json", Shot("a", {"x": wave()}))
    write_json(tmp_path / "b.json", Shot("b", {"x": wave(7, 1)}))
    first = Library.build([tmp_path])
    assert [e.shot for e in first.examples] == ["a", "b"]
    write_json(tmp_path / "b.json", Shot("b", {"x": wave(7, 5)}))
    read = []
    import physretarget.face.library as module

    original = read_shots

    def noted(path: Path) -> object:
        read.append(path.name)
        return original(path)

    monkeypatch.setattr(module, "read_shots", noted)
    second = Library.build([tmp_path], previous=first)
    assert read == ["b.json"]
    assert second.to_bytes() == Library.build([tmp_path]).to_bytes()
    (tmp_path / "b.json").unlink()
    assert len(Library.build([tmp_path], previous=second).examples) == 1
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no file"):
        Library.build([tmp_path / "empty"])


def test_alike_spans_are_one_shape():
    ease = [
        Key(0, 0, out_tangent=(1 / 3, 0)),
        Key(1, 2, (-1 / 3, 0), (1 / 3, 0)),
        Key(2, -1, (-1 / 3, 0)),
    ]
    library = Library.of([Shot("a", {"x": Curve(tuple(ease))})])
    shapes = Shapes.of(library, lambda name: True)
    assert [o.alike for o in shapes.origins] == [2]
    assert shapes.at(10)[0, [0, 5, 10]] == pytest.approx([0, 0.5, 1], abs=1e-3)
    assert shapes.chance == 0.0


def test_holding_out_leaves_no_copy_behind():
    same = wave(6)
    library = Library.of(
        [
            Shot("a", {"x": same, "z": wave(6, 8)}),
            Shot("b", {"y": same.scaled(1.0, -3.0).shifted(4.0, 1.0), "w": wave(8, 3)}),
        ]
    )
    rest, asked = hold_out(library, ["a"])
    assert len(asked) == 2
    assert [e.channel for e in rest.examples] in (["w"], ["y", "w"])
    copy = Library.of([Shot("a", {"x": same}), Shot("b", {"y": same.shifted(4.0, 1.0)})])
    assert hold_out(copy, ["a"])[0].examples == ()
