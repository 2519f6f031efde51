"""Numbers and names as people read them: labels of measures and series, digits, times."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from physretarget.report.charts import Ink


@dataclass(frozen=True)
class SeriesLook:
    """How a per-frame series of a report is drawn: series of one group share a chart."""

    group: str
    label: str
    unit: str
    ink: Ink
    dashed: bool = False


# Measures that become tiles, with the name a person reads; the first ones present are shown.
TILES: dict[str, str] = {
    "unexplained_force_rms_bw": "Unexplained force, RMS",
    "required_force_vertical_max_bw": "Vertical force, highest",
    "required_force_vertical_min_bw": "Vertical force, lowest",
    "pull_frames_fraction": "Frames in which the ground pulls",
    "penetration_max_m": "Deepest ground penetration",
    "skate_speed_max_m_s": "Fastest foot slide",
    "float_time_s": "Time afloat",
    "flight_com_acceleration_error_rms": "Flight, off ballistic by",
    "joint_speed_max_rad_s": "Fastest joint",
    "joint_limit_excess_max_rad": "Beyond a joint limit",
}

GROUPS: dict[str, str] = {
    "force": "Vertical force the motion requires",
    "unexplained": "Force no contact can explain",
    "height": "Height of the lowest point",
    "depth": "Ground penetration",
    "speed": "Slide speed of standing contacts",
    "moment": "Moment no contact can explain",
    "cop": "Centre of pressure outside the support",
    "torque": "Joint torque, share of the limit",
    "joints": "Speed of the fastest joint",
    "self": "Self-penetration",
    "jerk": "Jerk, dimensionless",
    "com": "Centre of mass",
}


def number(value: Any, digits: int = 3) -> str:
    """A value as text with some significant digits, no exponent between 1e-4 and 1e6."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:d}"
    if not isinstance(value, float):
        return str(value)
    if not math.isfinite(value):
        return "–"
    if abs(value) < 1e-9:  # what is left of a zero after arithmetic
        return "0"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        text = f"{value:.0f}"
    return text.replace("-", "−")


def count(things: int, noun: str) -> str:
    """``1 error``, ``2 errors``: regular nouns only."""
    return f"{things} {noun}{'' if things == 1 else 's'}"


def quantity(value: Any, unit: str) -> tuple[str, str]:
    """Value and unit as read: fractions in per cent, small lengths in mm."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        if unit == "1" and abs(value) <= 1:
            return f"{number(100.0 * value)}", "%"
        if unit == "m" and abs(value) < 0.1:
            return f"{number(1000.0 * value)}", "mm"
    return number(value), "" if unit == "1" else pretty(unit)


def pretty(unit: str) -> str:
    """A unit as print has it: m/s² for m/s^2, BW·h for BW h."""
    return unit.replace("^2", "²").replace("^3", "³").replace("BW h", "BW·h")


def duration(seconds: float) -> str:
    """Seconds, minutes and seconds, or hours and minutes."""
    if seconds < 90:
        return f"{seconds:.1f} s"
    if seconds < 5400:
        return f"{int(seconds // 60)} min {seconds % 60:.0f} s"
    return f"{int(seconds // 3600)} h {seconds % 3600 // 60:.0f} min"


def look(name: str) -> SeriesLook | None:
    """How to draw a series by its name, None for names that are not meant to be seen."""
    known = {
        "required_force_vertical_bw": SeriesLook("force", "required", "BW", "blue"),
        "contact_force_vertical_bw": SeriesLook("force", "contacts can give", "BW", "red", True),
        "explained_force_vertical_bw": SeriesLook("force", "contacts can give", "BW", "red", True),
        "unexplained_force_bw": SeriesLook("unexplained", "unexplained force", "BW", "violet"),
        "unexplained_moment_bwh": SeriesLook("moment", "unexplained moment", "BW·h", "violet"),
        "lowest_point_m": SeriesLook("height", "lowest point", "m", "green"),
        "penetration_m": SeriesLook("depth", "penetration", "m", "red"),
        "skate_speed_m_s": SeriesLook("speed", "slide speed", "m/s", "amber"),
        "com_height_m": SeriesLook("com", "height of the CoM", "m", "green"),
        "joint_torque_ratio": SeriesLook("torque", "largest share", "", "amber"),
        "cop_outside_m": SeriesLook("cop", "outside by", "m", "amber"),
        "joint_speed_rad_s": SeriesLook("joints", "fastest joint", "rad/s", "blue"),
        "self_penetration_m": SeriesLook("self", "depth", "m", "red"),
        "jerk_dimensionless": SeriesLook("jerk", "jerk", "", "violet"),
    }
    if name in known:
        return known[name]
    for suffix, unit in _UNITS:
        if name.endswith(suffix):
            text = name.removesuffix(suffix).replace("_", " ")
            return SeriesLook(name, text, unit, "blue")
    return SeriesLook(name, name.replace("_", " "), "", "blue")


_UNITS = (
    ("_m_s2", "m/s²"),
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("_bwh", "BW·h"),
    ("_bw", "BW"),
    ("_rad", "rad"),
    ("_ratio", "1"),
    ("_m", "m"),
)
