from __future__ import annotations

import logging
from pathlib import Path

import mujoco
import pytest

import physretarget.mjcf  # noqa: F401 - installs the handler


def test_warnings_are_logged_and_no_file_appears(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[0] = float("nan")
    with caplog.at_level(logging.WARNING, logger="physretarget.mujoco"):
        mujoco.mj_step(model, data)
    assert "NaN" in caplog.text or "nan" in caplog.text.lower()
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()
