"""Numbers about a clip, each with its unit and the frame to look at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from physretarget.validation import states
from physretarget.validation.analysis import Analysis
from physretarget.validation.report import Measure
from physretarget.validation.standing import has_base, tip_margin

Floats = NDArray[np.float64]

PENETRATION_M = 0.005  # PhysDiff's tolerance (Yuan et al. 2023)
PULL_BW = 0.02  # more than rounding and the noise of second differences
# Displacement while sliding slower than this is drift of the data, not skating.
SKATE_M_S = 0.05
CHATTER_S = 0.1
# The fastest frame of a landing foot is a matter of luck: what it slides in this time is not.
SKATE_WINDOW_S = 0.2


def measures(analysis: Analysis) -> dict[str, Measure]:
    """Every measure by name; value None where it could not be taken.

    Of clips faster than that they are taken at 30 instants a second, so that a motion has the same
    numbers at any frame rate.
    """
    found: dict[str, Measure] = {}
    for part in (_required, _explained, _standing, _flight, _floor, _joints):
        found.update(part(analysis.measured))
    return found


def peak(analysis: Analysis, series: Floats, unit: str, *, lowest: bool = False) -> Measure:
    """The largest (or lowest) value of a series and its frame; NaN frames are left out."""
    if len(series) == 0 or np.isnan(series).all():
        return Measure(value=None, unit=unit)
    frame = int(np.nanargmin(series) if lowest else np.nanargmax(series))
    return Measure(value=float(series[frame]), unit=unit, frame=analysis.clip_frame(frame))


def rms(series: Floats) -> float | None:
    """Root mean square, None of nothing."""
    return float(np.sqrt(np.mean(series**2))) if len(series) else None


def _over(series: Floats, frames: float) -> Floats:
    """Means over so many frames around each."""
    count = min(max(1, round(frames)), len(series))
    means: Floats = uniform_filter1d(series, count, mode="nearest")
    return means


def time_share(margin: Floats) -> float:
    """Share of the time in which a margin (T,) is above 0, between frames by interpolation.

    Counted in frames, a stretch of three at 30 frames/s may be eleven at 120. A frame of NaN is
    below; next to one the stretch ends half-way.
    """
    above = margin > 0
    if len(margin) < 2:
        return float(above.mean())
    before, after = margin[:-1], margin[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        crossing = np.maximum(before, after) / np.abs(after - before)
    crossing = np.where(np.isfinite(crossing), crossing, 0.5)
    share = np.where(above[:-1] == above[1:], above[1:].astype(np.float64), crossing)
    return float(share.mean())


def _share(analysis: Analysis, margin: Floats) -> Measure:
    frame = None
    if (margin > 0).any():
        frame = analysis.clip_frame(int(np.nanargmax(margin)))
    return Measure(value=time_share(margin), unit="1", frame=frame)


def _required(a: Analysis) -> Iterator[tuple[str, Measure]]:
    names = ("max", "min", "mean")
    required, pushes = a.series.required, a.series.pushes
    if required is None or pushes is None:
        yield from (
            (f"required_force_vertical_{n}_bw", Measure(value=None, unit="BW")) for n in names
        )
        yield "root_acceleration_max_m_s2", Measure(value=None, unit="m/s^2")
        yield "pull_frames_fraction", Measure(value=None, unit="1")
        yield "friction_exceeded_fraction", Measure(value=None, unit="1")
        return
    vertical = required.force[:, 2]
    yield "required_force_vertical_max_bw", peak(a, vertical, "BW")
    yield "required_force_vertical_min_bw", peak(a, vertical, "BW", lowest=True)
    yield "required_force_vertical_mean_bw", Measure(value=float(vertical.mean()), unit="BW")
    yield "root_acceleration_max_m_s2", peak(a, required.root_acceleration, "m/s^2")
    yield "pull_frames_fraction", _share(a, -PULL_BW - vertical)
    yield "friction_exceeded_fraction", _share(a, pushes.friction_demand - a.friction)


def _explained(a: Analysis) -> Iterator[tuple[str, Measure]]:
    if a.forces is None:
        yield "unexplained_force_rms_bw", Measure(value=None, unit="BW")
        yield "unexplained_force_max_bw", Measure(value=None, unit="BW")
        yield "unexplained_moment_rms_bwh", Measure(value=None, unit="BW h")
        yield "unexplained_moment_max_bwh", Measure(value=None, unit="BW h")
        yield "cop_outside_fraction", Measure(value=None, unit="1")
        yield "cop_outside_max_m", Measure(value=None, unit="m")
        return
    residual = a.forces.residual
    force, moment = residual.force, residual.moment
    worst = peak(a, force, "BW")
    yield "unexplained_force_rms_bw", Measure(value=rms(force), unit="BW", frame=worst.frame)
    yield "unexplained_force_max_bw", worst
    worst = peak(a, moment, "BW h")
    yield "unexplained_moment_rms_bwh", Measure(value=rms(moment), unit="BW h", frame=worst.frame)
    yield "unexplained_moment_max_bwh", worst
    yield "cop_outside_fraction", _share(a, residual.cop_outside - a.tolerance / 2)
    yield "cop_outside_max_m", peak(a, residual.cop_outside, "m")


def _standing(a: Analysis) -> Iterator[tuple[str, Measure]]:
    if not a.stands or a.forces is None or not has_base(a):
        yield "tip_margin_min_m", Measure(value=None, unit="m")
        yield "tip_margin_min_bwh", Measure(value=None, unit="BW h")
    else:
        required = a.forces.required
        margin = tip_margin(a, required)
        height = max(a.character.com_height, 1e-3)
        yield "tip_margin_min_m", peak(a, margin, "m", lowest=True)
        bearing = margin * required.force[:, 2] / height
        yield "tip_margin_min_bwh", peak(a, bearing, "BW h", lowest=True)
    demand = a.series.pushes.friction_demand if a.series.pushes else np.zeros(0)
    yield "friction_demand_max", peak(a, demand, "1")


def _flight(a: Analysis) -> Iterator[tuple[str, Measure]]:
    names = {
        "flight_frames_fraction": "1", "flight_com_acceleration_error_rms": "m/s^2",
        "flight_moment_rms_bwh": "BW h", "float_time_s": "s",
    }  # fmt: skip
    forces = a.forces
    if forces is None:
        yield from ((n, Measure(value=None, unit=u)) for n, u in names.items())
        return
    yield "flight_frames_fraction", _share(a, forces.floor.clearance)
    judged = states.flight(forces)
    error = np.where(judged, states.flight_error(a, forces), np.nan)
    worst = peak(a, error, "m/s^2").frame
    yield (
        "flight_com_acceleration_error_rms",
        Measure(value=rms(error[judged]), unit="m/s^2", frame=worst),
    )
    moment = np.where(judged, states.flight_moment(forces), np.nan)
    yield (
        "flight_moment_rms_bwh",
        Measure(value=rms(moment[judged]), unit="BW h", frame=peak(a, moment, "BW h").frame),
    )
    margin = states.floating_margin(a, forces)
    floats = _share(a, margin)
    seconds = time_share(margin) * a.frames / a.fps if a.fps else 0.0
    yield "float_time_s", Measure(value=seconds, unit="s", frame=floats.frame)


def _floor(a: Analysis) -> Iterator[tuple[str, Measure]]:
    floor = a.series.floor
    if floor is None:
        yield "penetration_max_m", Measure(value=None, unit="m")
        yield "penetration_frames_fraction", Measure(value=None, unit="1")
        yield "contact_chatter_per_s", Measure(value=None, unit="1/s")
    else:
        depth = np.maximum(-floor.deepest, 0.0)
        yield "penetration_max_m", peak(a, depth, "m")
        yield "penetration_frames_fraction", _share(a, depth - PENETRATION_M)
        flips = states.chatter(floor, a.fps, CHATTER_S)
        frame = a.clip_frame(int(np.argmax(flips))) if flips.any() else None
        seconds = a.frames / a.fps if a.fps else 1.0
        yield "contact_chatter_per_s", Measure(value=flips.sum() / seconds, unit="1/s", frame=frame)
    skate = a.series.skate
    if skate is None:
        yield "skate_speed_max_m_s", Measure(value=None, unit="m/s")
        yield "skate_distance_m", Measure(value=None, unit="m")
    else:
        speed = skate.speed
        worst = peak(a, _over(speed, a.fps * SKATE_WINDOW_S), "m/s")
        yield "skate_speed_max_m_s", worst
        slid = float(speed[speed > SKATE_M_S].sum() / a.fps) if a.fps else 0.0
        yield "skate_distance_m", Measure(value=slid, unit="m", frame=worst.frame)


def _joints(a: Analysis) -> Iterator[tuple[str, Measure]]:
    s = a.series
    for name, worst, unit in (
        ("joint_limit_excess_max_rad", s.limit_excess.excess if s.limit_excess else None, "rad"),
        ("joint_speed_max_rad_s", s.joint_speed.speed if s.joint_speed else None, "rad/s"),
        ("joint_torque_ratio_max", s.torque.share if s.torque else None, "1"),
        ("self_penetration_max_m", s.overlap.depth if s.overlap else None, "m"),
        ("jerk_dimensionless_max", s.jerk.worst if s.jerk else None, "1"),
    ):
        yield name, Measure(value=None, unit=unit) if worst is None else peak(a, worst, unit)
