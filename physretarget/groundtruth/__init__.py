"""Ground truth: forces predicted from motion alone against force plates.

    markers (.trc) ─▶ actor ─▶ inverse dynamics ─▶ required force ┐
    plates (.mot) ──────────▶ the same filter ───▶ measured force ┴▶ Comparison ─▶ page

``python -m physretarget.groundtruth FOLDER --out docs/measured/ground-truth.md`` writes the page.
"""

from __future__ import annotations

from physretarget.groundtruth.compare import Agreement, Comparison, compare, with_weight_of_impulse
from physretarget.groundtruth.contacts import ContactTiming, contact_timing
from physretarget.groundtruth.coverage import Coverage, coverage, loaded_feet
from physretarget.groundtruth.explain import Unexplained, by_fitted_forces, by_measured_forces
from physretarget.groundtruth.feet import FootAgreement, foot_agreement
from physretarget.groundtruth.trial import (
    Trial,
    load_plate_trial,
    load_trial,
    load_trials,
    standing_weight,
)

__all__ = [
    "Agreement",
    "Comparison",
    "ContactTiming",
    "Coverage",
    "FootAgreement",
    "Trial",
    "Unexplained",
    "by_fitted_forces",
    "by_measured_forces",
    "compare",
    "contact_timing",
    "coverage",
    "foot_agreement",
    "load_plate_trial",
    "load_trial",
    "load_trials",
    "loaded_feet",
    "standing_weight",
    "with_weight_of_impulse",
]
