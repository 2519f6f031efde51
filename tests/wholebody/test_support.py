from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget.wholebody import WholeBodySettings
from physretarget.wholebody.support import completed_stances, residual, support_of

PLACE = np.array([[0.1, 0.08, 0.0], [0.1, -0.08, 0.0], [-0.1, 0.08, 0.0], [-0.1, -0.08, 0.0]])


def test_three_corners_that_stand_hold_the_fourth(stalk) -> None:
    active = np.array([[1, 1, 1, 0], [1, 1, 0, 0], [0, 0, 0, 0], [1, 1, 1, 1]], dtype=bool)
    whole = completed_stances(stalk, active)
    assert whole.tolist() == [[True] * 4, [True, True, False, False], [False] * 4, [True] * 4]


def test_three_points_on_a_line_hold_nothing_else(stalk) -> None:
    contacts = replace(
        stalk.contacts,
        local=np.array([[0.1, 0, 0], [0, 0, 0], [-0.1, 0, 0], [0, 0.1, 0]], dtype=float),
    )
    line = replace(stalk, contacts=contacts)
    active = np.array([[True, True, True, False]])
    assert np.array_equal(completed_stances(line, active), active)


def _support(stalk, frames: int = 40):
    qpos = np.tile(stalk.reference_qpos, (frames, 1))
    return support_of(stalk, qpos, np.ones((frames, 4), bool), WholeBodySettings(inset=0.0))


def test_weight_over_the_support_is_explained_and_beyond_the_edge_it_is_not(stalk) -> None:
    support, h = _support(stalk, 3), stalk.com_height
    com = np.array([[0.0, 0.0, h], [0.09, 0.0, h], [0.2, 0.0, h]])
    rest, _ = residual(support, com, np.tile([0.0, 0, 1, 0, 0, 0], (3, 1)), h)
    left = np.linalg.norm(rest, axis=1)
    assert left[:2].max() < 2e-3
    assert left[2] > 0.1


def test_no_floor_pulls(stalk) -> None:
    rest, _ = residual(
        _support(stalk, 1), np.array([[0, 0, 0.2]]), np.array([[0.0, 0, -1, 0, 0, 0]]), 0.2
    )
    assert rest[0] == pytest.approx([0, 0, -1, 0, 0, 0], abs=1e-6)


def test_residual_answers_to_the_wrench_as_its_curvature_says(stalk) -> None:
    """Within one face of the cone the residual is linear: central differences find its slope."""
    rng = np.random.default_rng(0)
    support, h = _support(stalk), stalk.com_height
    com = np.tile([0.02, 0.01, h], (40, 1))
    wrench = rng.normal(size=(40, 6))
    step, eps = rng.normal(size=(40, 6)), 1e-6
    _, slope = residual(support, com, wrench, h)
    ahead, behind = (residual(support, com, wrench + s * eps * step, h)[0] for s in (1, -1))
    twin = (ahead - behind) / (2 * eps)
    found = np.einsum("tij,tj->ti", slope, step)
    assert np.median(np.abs(found - twin).max(axis=1)) < 1e-3
    assert np.all(np.linalg.eigvalsh(slope) > 0)
    assert np.all(np.linalg.eigvalsh(slope) < 1 + 1e-9)


def test_a_contact_bears_load_one_frame_before_and_after_where_it_stands(stalk) -> None:
    stands = np.zeros((9, 4), bool)
    stands[3:6] = True
    qpos = np.tile(stalk.reference_qpos, (9, 1))
    qpos[:3, 2] += 1.0
    support = support_of(stalk, qpos, stands, WholeBodySettings(inset=0.0))
    assert support.on.any(axis=1).tolist() == [False] * 2 + [True] * 5 + [False] * 2
    found = support.place[2][support.on[2]]
    assert sorted(map(tuple, found.round(9))) == sorted(map(tuple, PLACE))
