"""Other tools' numbers by their own formulas, for comparison only."""

from __future__ import annotations

from typing import Any

from physretarget.validation.analysis import Analysis


def literature(analysis: Analysis) -> dict[str, dict[str, Any]]:
    """PhysDiff's, EDGE's and holosoma's figures, each with what to beware of."""
    return {}
