from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from physretarget import demo
from physretarget.clip import load_clip
from physretarget.errors import MissingExtraError
from physretarget.mjcf import Character


def test_models_come_with_the_package() -> None:
    folder = demo.models_folder()
    assert {"lamp.xml", "lamp.keyposes.toml"} <= {p.name for p in folder.iterdir()}


def test_without_the_extra_it_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(MissingExtraError, match=r"physretarget\[demo\]"):
        demo.motions_folder()


@pytest.mark.slow
@pytest.mark.usefixtures("motions")
def test_the_demo_shows_a_jump_and_a_dance(tmp_path: Path) -> None:
    steps: list[str] = []
    index, shown = demo.run(tmp_path, progress=steps.append)
    assert [each.name for each in shown] == ["jump", "dance"]
    page = index.read_text(encoding="utf-8")
    lamp = Character.load(demo.models_folder() / "lamp.xml")
    for each in shown:
        assert each.page.relative_to(tmp_path).as_posix() in page
        html = each.page.read_text(encoding="utf-8")
        assert "http://" not in html.split("<body", 1)[1].split("<script", 1)[0]
        assert load_clip(each.page.parent / "clip.npz", character=lamp).frames > 30
        assert each.result.physical is not None
        before, after = each.result.physical.mismatch_before, each.result.physical.mismatch_after
        assert after <= 0.4 * before
    assert len(steps) == demo.STEPS
    assert any("physics" in step for step in steps)
