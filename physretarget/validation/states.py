"""Frames by what holds the character: support, flight, floating."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physretarget.ground.response import dilated, reach_frames
from physretarget.kinematics import runs
from physretarget.validation.analysis import Analysis
from physretarget.validation.series import FloorTouch, ForceSeries

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

# A frame without contact floats when this share of body weight would have to be borne.
FLOAT_BW = 0.3
# A stretch in the air that needs support for longer than this floats as a whole.
_FLOATS_S = 0.05
# A tenth of a second is three frames at 30 frames/s, however the rate was rounded.
_ROUNDING = 1e-3


def known(analysis: Analysis) -> Bools:
    """(T,) nothing but the floor can bear the character, in this frame or within reach of it."""
    external = analysis.series.external
    if external is None:
        return np.ones(analysis.frames, dtype=bool)
    reach = reach_frames(analysis.fps, analysis.settings.lowpass_hz)
    free: Bools = ~dilated(external.geom >= 0, reach)
    return free


def held_elsewhere(analysis: Analysis) -> str | None:
    """Why contact forces cannot be judged in any frame, or None."""
    if known(analysis).any():
        return None
    return f"the character touches {foreign_names(analysis)} all the time, whose force is not known"


def foreign_names(analysis: Analysis) -> str:
    """What the character touches besides the floor."""
    model, external = analysis.character.model, analysis.series.external
    geoms = np.unique(external.geom) if external is not None else np.zeros(0, dtype=np.int64)
    names = [
        model.geom(int(g)).name or model.body(int(model.geom_bodyid[g])).name or f"geom{int(g)}"
        for g in geoms[geoms >= 0]
    ]
    return ", ".join(f"'{name}'" for name in dict.fromkeys(names))


def airborne(forces: ForceSeries) -> Bools:
    """(T,) nothing touches the floor."""
    free: Bools = forces.floor.points == 0
    return free


def flight(forces: ForceSeries) -> Bools:
    """(T,) nothing touches in this frame nor within reach of its force."""
    return ~forces.bearing.supported


def floating(analysis: Analysis, forces: ForceSeries) -> Bools:
    """(T,) nothing touches, yet more support is required than contacts nearby can have left."""
    needs: Bools = _missing(forces) > FLOAT_BW
    return airborne(forces) & needs & known(analysis)


def _missing(forces: ForceSeries) -> Floats:
    """(T,) BW of support that no contact nearby explains."""
    missing: Floats = forces.required.force[:, 2] - forces.residual.explained[:, 2]
    return missing


def floating_margin(analysis: Analysis, forces: ForceSeries) -> Floats:
    """(T,) above 0 where the character floats, by how much in shares of both limits."""
    height = forces.floor.clearance / analysis.tolerance
    margin: Floats = np.minimum(height, _missing(forces) / FLOAT_BW - 1)
    return margin


def free_flight(analysis: Analysis, forces: ForceSeries) -> Bools:
    """(T,) flight, without the stretches in the air of which a part floats."""
    judged, floats = flight(forces) & known(analysis), floating(analysis, forces)
    for first, last in runs(airborne(forces)):
        if floats[first : last + 1].sum() > _FLOATS_S * analysis.fps:
            judged[first : last + 1] = False
    return judged


def flight_error(analysis: Analysis, forces: ForceSeries) -> Floats:
    """(T,) m/s^2 that the CoM's acceleration is off gravity, what contacts nearby do left out."""
    gravity = float(np.linalg.norm(analysis.character.model.opt.gravity))
    return forces.residual.force * gravity


def flight_moment(forces: ForceSeries) -> Floats:
    """(T,) BW h that turn the body, less what the filter's side lobes may show of contacts."""
    moment = np.linalg.norm(forces.required.moment, axis=1)
    left: Floats = np.maximum(moment - forces.residual.side_lobes, 0.0)
    return left


def too_short(analysis: Analysis, forces: ForceSeries) -> str | None:
    """Why flight cannot be judged although there is some, or None."""
    if not airborne(forces).any() or flight(forces).any():
        return None
    reach = reach_frames(analysis.fps, analysis.settings.lowpass_hz) / analysis.fps
    return (
        f"every flight is over within {2 * reach:.2g} s: differences"
        f"{'' if analysis.settings.lowpass_hz is None else ' and the filter'} mix it with contact"
    )


def chatter(floor: FloorTouch, fps: float, shortest_s: float) -> Bools:
    """(T,) frames in which a contact begins or ends a touch or a gap shorter than so long."""
    touch = floor.bodies
    flags = np.zeros(len(touch), dtype=bool)
    for column in touch.T:
        changes = np.flatnonzero(np.diff(column)) + 1
        short = np.diff(changes) < shortest_s * fps - _ROUNDING
        flags[changes[:-1][short]] = True
    return flags
