"""The unit that a clip's lengths are in: metres, unless told."""

from __future__ import annotations

from physretarget.errors import UsageError
from physretarget.options.motion import CLIP_UNITS as UNITS


def unit_scale(unit: str | None) -> float | None:
    """Metres per unit of a named unit, or of a number written out ("0.0254"); None for None."""
    if unit is None or unit in UNITS:
        return None if unit is None else UNITS[unit]
    try:
        scale = float(unit)
    except ValueError:
        scale = -1.0
    if not 1e-6 <= scale <= 1e3:
        raise UsageError(
            f"unit '{unit}' was given: use {', '.join(UNITS)}, or metres per unit as a number."
        )
    return scale
