"""Faults of a clip as data: found, mended, and nothing else touched; before and after on a page."""

from __future__ import annotations

import numpy as np
import pytest

import physretarget as pr
from physretarget.clip import Clip
from physretarget.report.fix import render_fix_html, rule_rows
from physretarget.wholebody.clean import cleaned, noise_of


@pytest.fixture
def swaying(standing):
    qpos, time, _ = standing(3.0)
    qpos[:, 7] = 0.1 * np.sin(2 * np.pi * 0.5 * time)
    return qpos, time


def test_a_sound_clip_keeps_every_bit(stalk, swaying) -> None:
    qpos, time = swaying
    found, notes = cleaned(stalk, qpos, time)
    np.testing.assert_array_equal(found, qpos)
    assert notes == ()


@pytest.mark.parametrize(("coordinate", "size"), [(0, 0.2), (2, 0.2), (7, 0.5)])
def test_a_frame_that_is_off_is_put_back(stalk, swaying, coordinate: int, size: float) -> None:
    sound, time = swaying
    faulty = sound.copy()
    faulty[40, coordinate] += size
    found, notes = cleaned(stalk, faulty, time)
    assert np.abs(found - sound).max() < 2e-3
    np.testing.assert_array_equal(np.delete(found, 40, axis=0), np.delete(sound, 40, axis=0))
    assert notes == ("1 frame is off for a moment, put between their neighbours.",)


def test_a_fast_but_smooth_move_is_no_spike(stalk, swaying) -> None:
    qpos, time = swaying
    qpos = qpos.copy()
    qpos[:, 7] += 0.8 * np.exp(-(((time - 1.5) / 0.08) ** 2))  # a nod within a sixth of a second
    qpos[:, 7] = np.clip(qpos[:, 7], stalk.lower[7], stalk.upper[7])
    found, _ = cleaned(stalk, qpos, time)
    np.testing.assert_allclose(found, qpos, atol=1e-12)


def test_a_jump_of_the_root_moves_the_rest_back(stalk, swaying) -> None:
    sound, time = swaying
    sound = sound.copy()
    sound[:, 0] += 0.3 * time  # it travels
    faulty = sound.copy()
    faulty[50:, 1] += 0.3
    found, notes = cleaned(stalk, faulty, time)
    np.testing.assert_allclose(found, sound, atol=2e-3)
    assert notes[0].startswith("Jumps of the root (1)")


def test_noise_is_measured_in_what_is_tolerated_and_filtered(stalk, swaying) -> None:
    sound, time = swaying
    noise = np.random.default_rng(2).normal(size=len(sound))
    shaking = sound.copy()
    shaking[:, 7] += np.radians(1.0) * noise
    assert noise_of(stalk, sound) < 0.5
    assert noise_of(stalk, shaking) == pytest.approx(1.0 / 0.3, rel=0.3)
    found, notes = cleaned(stalk, shaking, time)
    before, after = (np.std(np.diff(each[:, 7], 2)) for each in (shaking, found))
    assert after < 0.3 * before
    assert np.abs(found[:, 7] - sound[:, 7]).max() < np.radians(3.0)
    assert "low-passed at 6 Hz" in notes[0]


def test_no_angle_stays_beyond_its_limit(stalk, swaying) -> None:
    qpos, time = swaying
    qpos = qpos.copy()
    beyond = stalk.upper[7] + 0.2
    qpos[:, 7] = beyond * np.exp(-(((time - 1.5) / 0.5) ** 2))
    found, notes = cleaned(stalk, qpos, time)
    assert found[:, 7].max() == stalk.upper[7]
    assert "beyond joint limits" in notes[-1]


def test_fix_says_what_it_took_and_shows_before_and_after(stalk, swaying) -> None:
    sound, time = swaying
    faulty = sound.copy()
    faulty[:, 2] += 0.05 * np.exp(-(((time - 1.5) / 0.4) ** 2))
    faulty[30, 0] += 0.2
    clip = Clip(qpos=faulty, time=time, joint_names=stalk.joint_names, model_name=stalk.name,
                model_sha256=stalk.sha256)  # fmt: skip
    done = pr.fix(clip, stalk)
    reports = (pr.validate(clip, stalk), pr.validate(done.clip, stalk))
    assert reports[0].errors > 0 == reports[1].errors
    assert done.posed_rms_m < 0.01 < done.moved_rms_m
    assert done.clip.meta["fixed"]["notes"] == list(done.notes)
    rows = rule_rows(reports)
    assert sum(row["errors"][0] for row in rows) == reports[0].errors
    assert sum(row["errors"][1] for row in rows) == 0
    page = render_fix_html(clip, done, stalk, reports, painted=False)
    assert "✗ failed" in page
    assert "✓ passed" in page
    assert f"{100 * done.posed_rms_m:.1f} cm" in page
    assert "1 frame is off for a moment" in page
