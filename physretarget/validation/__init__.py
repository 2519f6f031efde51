"""The validator: any clip, any MJCF, a verdict one can act on.

    Clip + Character ─ analyse ─▶ Analysis ─ measures ─▶ numbers
                                       └──── rules ────▶ findings, coverage ─▶ Report

Every array is computed once; rules only read. Thresholds stand in the rules with their
sources; what could not be judged stands in the report's coverage with its reason.
"""

from __future__ import annotations

from physretarget.validation.baseline import apply_baseline, load_baseline, save_baseline
from physretarget.validation.codes import BY_CODE, RULES
from physretarget.validation.config import Settings, load_settings, settings_of
from physretarget.validation.report import Coverage, Finding, Measure, Report
from physretarget.validation.rule import Limit, Rule
from physretarget.validation.validate import judge_model, validate, validate_many

__all__ = [
    "BY_CODE",
    "RULES",
    "Coverage",
    "Finding",
    "Limit",
    "Measure",
    "Report",
    "Rule",
    "Settings",
    "apply_baseline",
    "judge_model",
    "load_baseline",
    "load_settings",
    "save_baseline",
    "settings_of",
    "validate",
    "validate_many",
]
