"""What docs/measured/other-definitions.md says of motions whose truth is known."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    path = ROOT / "benchmarks" / "other_definitions.py"
    spec = importlib.util.spec_from_file_location("other_definitions", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_slide_is_the_same_slide_at_every_rate_by_ours_alone(script: ModuleType):
    found = script.judge(*script.slide(), 3.0, None)
    for rate in script.RATES:
        numbers = found[rate]
        # The page's claim: a distance per frame is the speed over the rate.
        assert numbers["PhysDiff skate, mm per frame"] == pytest.approx(200 / rate)
        assert numbers["**ours** `skate_speed_max_m_s`"] == pytest.approx(0.2)
        assert numbers["**ours** `skate_distance_m`"] == pytest.approx(0.6, rel=0.03)
    share = "holosoma sliding, share over 1 cm per frame"
    assert (found[15][share], found[30][share]) == (1.0, 0.0)


def test_a_flawless_hop_floats_by_physdiff_alone(script: ModuleType):
    found = script.judge(*script.hop(), 3.0, None)
    for rate in script.SHOWN:
        assert found[rate]["PhysDiff float, mm"] > 10
        assert found[rate]["**ours** `float_time_s`"] == 0
        error = found[rate]["**ours** `flight_com_acceleration_error_rms`, m/s²"]
        assert error == pytest.approx(0, abs=1e-6)


def test_the_page_has_the_table_that_the_script_writes(script: ModuleType):
    page = (ROOT / "docs" / "measured" / "other-definitions.md").read_text(encoding="utf-8")
    for label, *_ in script.NUMBERS:
        assert f"\n| {label} | " in page
    found = script.judge(*script.slide(), 3.0, None)
    skate = [f"{found[rate][script.NUMBERS[0][0]]:.2f}" for rate in script.SHOWN]
    assert f"| {script.NUMBERS[0][0]} | {skate[0]} | {skate[1]} |" in page
