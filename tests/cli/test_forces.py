"""The command `forces`."""

from __future__ import annotations

import numpy as np

from physretarget.capture.mot import read_mot


def test_forces_of_a_capture(run, tmp_path, motions):
    out, picture = tmp_path / "walk.mot", tmp_path / "walk.png"
    got = run(
        "forces", motions / "humanoid3d_walk.txt", "--mass", "70", "--out", out, "--report", picture
    )
    assert got.code == 0, got.err
    assert "70.0 kg (687 N = 1 BW)" in got.out
    assert "left foot" in got.out
    total = sum(force.force[:, 2] for force in read_mot(out))
    assert 0.8 < np.mean(total) / 686.7 < 1.2
    assert picture.stat().st_size > 10_000


def test_what_forces_refuses(run, tmp_path, motions):
    walk = motions / "humanoid3d_walk.txt"
    for given, says in (
        (("--out", tmp_path / "f.txt"), ".mot or .csv"),
        (("--out", tmp_path / "f.mot", "--mass", "-3"), "mass"),
        (("--out", tmp_path / "f.mot", "--lowpass", "-1"), "--lowpass"),
        (("--out", tmp_path / "f.mot", "--lowpass", "99"), "not possible"),
    ):
        got = run("forces", walk, *given)
        assert got.code == 2
        assert says in got.err
        assert len(got.err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
