from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from physretarget.clip import Clip
from physretarget.errors import InputError, UsageError
from physretarget.mjcf import Character
from physretarget.validation import (
    RULES,
    Settings,
    apply_baseline,
    load_baseline,
    load_settings,
    save_baseline,
    validate,
    validate_many,
)

# The corners of a box.
SIGNS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


@pytest.fixture
def lifted(standing: Clip) -> Clip:
    return replace(standing, qpos=standing.qpos + np.eye(13)[2] * 0.03, path="lifted.npz")


def test_select_and_ignore(biped: Character, lifted: Clip) -> None:
    chosen = validate(lifted, biped, settings=Settings(select=("DYN", "CON003")))
    assert {c.code[:3] for c in chosen.coverage} == {"DYN", "CON"}
    assert {f.code for f in chosen.findings} == {"CON003"}
    without = validate(lifted, biped, settings=Settings(ignore=("CON003",)))
    assert without.passed
    assert len(without.coverage) == sum(rule.code[:3] != "SIM" for rule in RULES) - 1


@pytest.mark.parametrize("code", ["XYZ", "DYN999", ""])
def test_unknown_codes_list_the_valid_ones(code: str, biped: Character, lifted: Clip) -> None:
    with pytest.raises(UsageError, match="DYN001"):
        validate(lifted, biped, settings=Settings(select=(code,)))


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_toml_sets_everything(tmp_path: Path, biped: Character, lifted: Clip) -> None:
    path = write(
        tmp_path / "c.toml",
        """
        profile = "robot"
        lowpass_hz = 10
        contact_tolerance_m = 0.005
        friction = 0.7
        ignore = ["DAT"]
        [limits.CON003]
        error = 100
        [severity]
        CON003 = "warning"
        """,
    )
    settings = load_settings(path, RULES)
    report = validate(lifted, biped, settings=settings)
    assert report.settings.profile == "robot"
    assert report.settings.lowpass_hz == 10
    assert report.settings.friction == 0.7
    assert report.settings.contact_tolerance_m == 0.005
    assert {f.code: f.severity for f in report.findings} == {
        "CON003": "warning", "CON007": "warning"
    }  # fmt: skip
    assert report.passed
    assert report.fails("warning")
    assert not report.fails("error")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("profil = 'robot'", "did you mean 'profile'"),
        ("profile = 'boat'", "one of animation, robot"),
        ("select = 'DYN'", "list of codes"),
        ("ignore = ['DYM']", "valid are DAT001"),
        ("lowpass_hz = 'six'", "must be a number"),
        ("lowpass_hz = -1", "from 0 to 1000 Hz"),
        ("[limits.DYN001]\nwarn = 1", "has no limit 'warn'"),
        ("[limits.DYN77]\nwarning = 1", "no rule has the code"),
        ("[severity]\nDYN001 = 'fatal'", "error"),
        ("[limits.DYN001]\nerror = -1", "0 or more"),
        ("limits = 3", "must be a table"),
        ("a = = 1", "not valid TOML"),
    ],
)
def test_toml_mistakes_name_what_is_valid(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path / "c.toml", text)
    with pytest.raises(InputError, match=message) as caught:
        load_settings(path, RULES)
    assert caught.value.path == str(path)


def test_an_error_told_below_the_warning_is_an_error(
    tmp_path: Path, biped: Character, standing: Clip
) -> None:
    qpos = standing.qpos.copy()
    qpos[:, 2] -= 0.003
    sunk = replace(standing, qpos=qpos)
    assert not validate(sunk, biped).findings
    path = write(tmp_path / "c.toml", "[limits.CON001]\nerror = 0.002")
    report = validate(sunk, biped, settings=load_settings(path, RULES))
    assert [(f.code, f.severity, f.limit) for f in report.findings] == [("CON001", "error", 0.002)]


def test_a_filter_that_the_frame_rate_does_not_bear_is_told(
    biped: Character, standing: Clip
) -> None:
    slow = replace(standing, time=standing.time * standing.fps / 30)
    with pytest.raises(UsageError, match="low-pass of 20 Hz"):
        validate(slow, biped, settings=Settings(lowpass_hz=20))


def test_profile_changes_limits(biped: Character, standing: Clip) -> None:
    qpos = standing.qpos.copy()
    qpos[:, 7] = 0.8 * np.sin(40 * standing.time)  # 32 rad/s
    clip = replace(standing, qpos=qpos)
    fast = {
        profile: {
            f.code for f in validate(clip, biped, settings=Settings(profile=profile)).findings
        }
        for profile in ("animation", "robot")
    }
    assert "KIN002" in fast["robot"]
    assert "KIN002" not in fast["animation"]


def test_baseline_accepts_today_and_catches_tomorrow(
    tmp_path: Path, biped: Character, lifted: Clip
) -> None:
    today = validate(lifted, biped)
    assert not today.passed
    path = tmp_path / "baseline.json"
    save_baseline([today], path)
    accepted = load_baseline(path)
    quiet = apply_baseline(today, accepted)
    assert quiet.passed
    assert quiet.accepted == len(today.findings)
    sunk = replace(lifted, qpos=lifted.qpos - np.eye(13)[2] * 0.08)
    new = apply_baseline(validate(sunk, biped), accepted)
    assert {f.code for f in new.findings} >= {"CON001"}
    elsewhere = apply_baseline(validate(replace(lifted, path="other.npz"), biped), accepted)
    assert not elsewhere.passed


def test_baseline_does_not_accept_what_got_worse(
    tmp_path: Path, biped: Character, standing: Clip
) -> None:
    down = np.eye(13)[2]
    before = replace(standing, qpos=standing.qpos - 0.03 * down, path="a.npz")
    save_baseline([validate(before, biped)], tmp_path / "b.json")
    after = replace(standing, qpos=standing.qpos - 0.05 * down, path="a.npz")
    judged = apply_baseline(validate(after, biped), load_baseline(tmp_path / "b.json"))
    assert "CON001" in {f.code for f in judged.findings}


@pytest.mark.parametrize("text", ["", "[]", '{"schema": "x"}', '{"accepted": [1]}'])
def test_broken_baseline_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        load_baseline(write(tmp_path / "b.json", text))
    with pytest.raises(InputError):
        load_baseline(tmp_path / "none.json")


def test_several_clips_in_order_on_threads(biped: Character, standing: Clip, hop: Clip) -> None:
    clips = [standing, hop, standing]
    alone = [json.dumps(validate(c, biped).to_dict()) for c in clips]
    together = [json.dumps(r.to_dict()) for r in validate_many(clips, biped, workers=2)]
    assert alone == together


def test_literature_numbers_carry_their_caution(biped: Character, hop: Clip) -> None:
    report = validate(hop, biped, settings=Settings(also_literature=True))
    assert {"physdiff_float_mm", "physdiff_penetrate_mm", "physdiff_skate_mm"} <= set(
        report.literature
    )
    assert {"edge_pfc", "holosoma_sliding_fraction"} <= set(report.literature)
    assert all(entry["caution"] and entry["definition"] for entry in report.literature.values())
    assert report.literature["physdiff_penetrate_mm"]["value"] < 5
    assert report.literature["physdiff_float_mm"]["value"] > 0  # the jump counts as floating


def test_edges_score_of_a_clip_that_stands_still_is_none(biped: Character, standing: Clip) -> None:
    """Its formula divides by the peak acceleration, which is rounding here; a clip that slides
    at a constant speed is the worst of them, both feet moving."""
    for rounding in (0.0, 1e-6):
        rng = np.random.default_rng(1)
        qpos = standing.qpos + rounding * rng.uniform(-0.5, 0.5, standing.qpos.shape)
        qpos[:, 0] += 0.3 * standing.time
        qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
        entry = validate(
            replace(standing, qpos=qpos), biped, settings=Settings(also_literature=True)
        ).literature["edge_pfc"]
        assert entry["value"] is None
        assert "rounding" in entry["caution"]


def test_edges_score_is_its_formula(biped: Character, hop: Clip) -> None:
    """1 / (N max|a|) sum |a_i| |v_left| |v_right|, from the bodies' own paths."""
    model, data = biped.model, mujoco.MjData(biped.model)
    com, feet = [], []
    for qpos in hop.qpos:
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        com.append(data.subtree_com[1].copy())
        boxes = [model.body(f"{side}_foot").geomadr[0] for side in ("left", "right")]
        turned = [data.geom_xmat[g].reshape(3, 3) for g in boxes]
        corners = [
            data.geom_xpos[g] + (t @ (SIGNS * model.geom_size[g]).T).T
            for g, t in zip(boxes, turned, strict=True)
        ]
        feet.append([[*c[:, :2].mean(axis=0), c[:, 2].min()] for c in corners])
    step = 1 / hop.fps
    a = np.zeros((len(com), 3))
    a[1:-1] = np.diff(np.array(com), 2, axis=0) / step**2
    a[:, 2] = np.maximum(a[:, 2], 0)
    size = np.linalg.norm(a, axis=1)
    speed = np.linalg.norm(np.diff(np.array(feet), axis=0), axis=2) / step
    expected = np.mean(size[1:] * speed[:, 0] * speed[:, 1]) / size.max()
    report = validate(hop, biped, settings=Settings(also_literature=True))
    assert report.literature["edge_pfc"]["value"] == pytest.approx(expected, rel=0.03)
