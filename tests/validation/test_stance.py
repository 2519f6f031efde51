"""Soles are judged while their body stands on them."""

from __future__ import annotations

import numpy as np
import pytest

from physretarget.mjcf import Character
from physretarget.validation.evidence import evidence
from physretarget.validation.stance import sole_tilts


@pytest.mark.parametrize(("share", "stands"), [(1.0, True), (0.6, True), (0.4, False)])
def test_the_feet_of_who_sits_do_not_stand(biped: Character, share: float, stands: bool) -> None:
    usual = float(biped.reference_qpos[2])
    bend = np.arccos(np.clip((share * usual - 0.04) / 0.6, -1, 1))
    pose = biped.reference_qpos.copy()
    pose[7:] = np.array([-bend, 2 * bend, -bend + np.radians(8)] * 2)
    pose[2] = share * usual
    qpos = np.tile(pose, (60, 1))
    tilts = sole_tilts(biped, evidence(biped, qpos, 1 / 30), qpos)
    assert tilts is not None
    if stands:
        turns = [np.degrees(np.linalg.norm(tilt.turn)) for tilt in tilts]
        assert turns == pytest.approx([8.0] * len(turns), abs=0.1)
        assert tilts
    else:
        assert tilts == []
