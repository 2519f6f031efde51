"""Acting unlike any key pose is told; acting that was posed, or is like it, is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from physretarget import capture
from physretarget.capture.actor import ActorMotion
from physretarget.demo import models_folder
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.novelty import OTHER_POSTURE, SAME_ACTING, novelty
from physretarget.pipeline import Retargeted, RetargetSettings, retarget
from physretarget.report.retarget import retarget_data
from physretarget.trained import TrainedMapper, learn
from physretarget.validation import validate

MODELS = models_folder()
Motion = Callable[[str], ActorMotion]
POSED = ("backflip", "cartwheel", "dance_a", "dance_b", "jump", "kick", "punch", "run", "walk")
UNLIKE = ("crawl", "getup_facedown", "getup_faceup", "roll", "spin", "spinkick")


@pytest.fixture(scope="module")
def mapper() -> TrainedMapper:
    lamp = Character.load(MODELS / "lamp.xml")
    return learn(lamp, load_keyposes([MODELS / "lamp.keyposes.toml"], lamp), mapper="nn3")


@pytest.fixture(scope="module")
def motion(motions: Path) -> Motion:
    """Captures of the demo by their names."""
    return lambda name: capture.load(motions / f"humanoid3d_{name}.txt")


def mapped(acted: ActorMotion, mapper: TrainedMapper) -> Retargeted:
    return retarget(acted, mapper, settings=RetargetSettings(until="mapped", fps=30))


@pytest.mark.parametrize("name", POSED)
def test_what_was_posed_is_silent(name: str, motion: Motion, mapper: TrainedMapper) -> None:
    result = mapped(motion(name), mapper)
    assert f"humanoid3d_{name}.txt" in mapper.sources
    assert result.warnings == ()
    assert result.clip.meta["novelty"]["frames"] == 0


@pytest.mark.parametrize("name", UNLIKE)
def test_what_nobody_posed_is_told(name: str, motion: Motion, mapper: TrainedMapper) -> None:
    result = mapped(motion(name), mapper)
    assert f"humanoid3d_{name}.txt" not in mapper.sources
    (warning,) = result.warnings
    assert warning in result.notes
    assert "keyposes suggest" in warning
    assert result.clip.meta["novelty"]["frames"] == result.novelty.frames > 0
    first, last = result.novelty.worst
    assert result.novelty.distance[first : last + 1].min() > result.novelty.limit


def test_the_report_says_it(motion: Motion, mapper: TrainedMapper) -> None:
    result = mapped(motion("crawl"), mapper)
    page = retarget_data(result, mapper, validate(result.clip, result.character))
    assert result.warnings[0] in page.notes


def test_other_key_poses_make_the_crawl_familiar(motion: Motion) -> None:
    squirrel = Character.load(MODELS / "squirrel.xml")
    poses = load_keyposes([MODELS / "squirrel.keyposes.toml"], squirrel)
    assert mapped(motion("crawl"), learn(squirrel, poses, mapper="nn3")).warnings == ()


@pytest.mark.data
def test_other_people_who_act_alike_are_silent(data: Path, mapper: TrainedMapper) -> None:
    alike = sorted((data / "bvh").rglob("*.bvh")) + sorted((data / "grf").rglob("*.trc"))
    alike += [data / "c3d" / f"{n}.c3d" for n in ("Qualisys", "cmu_dribble_shoot_basketball")]
    told = [p.name for p in alike if mapped(capture.load(p, fps=30), mapper).warnings]
    assert len(alike) > 30
    assert told == []


@pytest.mark.data
def test_the_same_with_captures_that_were_posed(data: Path) -> None:
    lamp = Character.load(MODELS / "lamp.xml")
    files = [MODELS / f"lamp{kind}.keyposes.toml" for kind in ("", ".cmu")]
    trained = learn(lamp, load_keyposes(files, lamp), mapper="nn3")
    posed = [p for p in sorted((data / "c3d").glob("*.c3d")) if p.name in trained.sources]
    assert posed
    assert [p.name for p in posed if mapped(capture.load(p, fps=30), trained).warnings] == []


def acted(distance: float, frames: int, *, rest: int = 30) -> np.ndarray:
    """Ten points at rest, then all of them this far off for some frames, then at rest."""
    y = np.zeros((rest + frames + rest, 30))
    y[rest : rest + frames, ::3] = distance
    return y


def test_distance_is_of_the_points() -> None:
    found = novelty(acted(0.7, 15), np.zeros((1, 30)), ["rest"], fps=30)
    np.testing.assert_allclose(found.distance.max(), 0.7)
    assert found.spans == ((30, 44),)
    assert (found.frames, found.worst, found.nearest) == (15, (30, 44), "rest")
    assert "from 1.00 to 1.47 s" in found.warning


@pytest.mark.parametrize(("frames", "told"), [(9, False), (10, True)])
def test_what_passes_is_not_told(frames: int, told: bool) -> None:
    found = novelty(acted(0.7, frames), np.zeros((1, 30)), ["rest"], fps=30)
    assert (found.warning is not None) is told


def test_the_limit_follows_the_key_poses_within_bounds() -> None:
    def limit(apart: float) -> float:
        posed = np.zeros((20, 30))
        posed[:, ::3] = apart * np.arange(20)[:, None]
        return novelty(posed, posed, ["k"] * 20, fps=30).limit

    assert limit(0.01) == SAME_ACTING
    assert limit(0.4) == pytest.approx(0.4)
    assert limit(2.0) == OTHER_POSTURE


def test_the_farthest_span_is_the_worst_and_names_its_key_pose() -> None:
    y = np.concatenate([acted(0.6, 20), acted(0.9, 12)])
    posed = np.zeros((2, 30))
    posed[1, ::3] = -0.1
    found = novelty(y, posed, ["here", "behind"], fps=30)
    assert len(found.spans) == 2
    assert found.worst == found.spans[1]
    assert found.nearest == "here"
    assert found.frames == 32


def test_blocks_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    y, posed = rng.normal(size=(50, 12)), rng.normal(size=(7, 12))
    whole = novelty(y, posed, list("abcdefg"), fps=30)
    monkeypatch.setattr("physretarget.novelty.BLOCK", 8)
    parts = novelty(y, posed, list("abcdefg"), fps=30)
    np.testing.assert_allclose(parts.distance, whole.distance)
    assert parts.spans == whole.spans
