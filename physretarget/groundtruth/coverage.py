"""Which frames the plates tell the whole truth about: every foot that bears load is on one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion

from physretarget import kinematics
from physretarget.capture.mot import GroundForce
from physretarget.contact import detect_phases
from physretarget.groundtruth.trial import Bools, Floats, Trial
from physretarget.kinematics import runs

LOADED = 20.0  # N on a plate: the usual threshold of contact in gait laboratories
MARGIN = 0.1  # s around what is not covered, and at a trial's ends
_SLOW = 0.25  # m/s
_STANDS = 0.3  # s: nothing in free fall stays that slow for that long
_RAISED = 0.10  # m above the floor: higher than any foot in stance
_LEFT = 0.05  # m below the top of a box: the foot has left it


@dataclass(frozen=True, kw_only=True, eq=False)
class Coverage:
    """``whole`` (T,): every loaded foot is on a plate. ``judged`` (T,): those frames without
    MARGIN s at their edges, into which the filter carries what was not measured.
    ``loaded`` and ``contact`` (T, 2), left and right foot: by the plates, by the motion.
    """

    whole: Bools
    judged: Bools
    loaded: Bools
    contact: Bools


def coverage(trial: Trial) -> Coverage:
    """Plates and feet compared, stance by stance.

    A foot's stance (found in the motion) during which its plate never bears load is a stance
    beside the plates. A foot that stands still above the floor stands on something else, from
    then until it is below that height. Neither uses the size of any force beyond LOADED, so
    that frames are not chosen by how well they agree.
    """
    loaded = loaded_feet(trial)
    feet = detect_phases(trial.motion).active[:, :4]
    contact = np.stack([feet[:, :2].any(axis=1), feet[:, 2:].any(axis=1)], axis=1)
    beside = np.zeros_like(contact)
    for foot in range(2):
        for first, last in runs(contact[:, foot]):
            if not loaded[first : last + 1, foot].any():
                beside[first : last + 1, foot] = True
    beside |= _on_a_box(trial)
    whole = ~beside.any(axis=1) & trial.motion.valid & trial.known
    reach = round(MARGIN * trial.motion.fps)
    judged = binary_erosion(whole, np.ones(2 * reach + 1, dtype=bool))
    return Coverage(whole=whole, judged=judged, loaded=loaded, contact=contact)


def loaded_feet(trial: Trial) -> Bools:
    """(T, 2) whether a plate bears the left and the right foot.

    Columns of a force file are plates or feet, in no fixed order: each stretch of load goes to
    the foot that is nearest to its centre of pressure.
    """
    loaded = np.zeros((len(trial.motion.time), 2), dtype=bool)
    for _, foot, frames in loads(trial):
        loaded[frames, foot] = True
    return loaded


def loads(trial: Trial) -> Iterator[tuple[GroundForce, int, slice]]:
    """Every stretch of load: the plate's force, the foot that it bears, the motion's frames."""
    time = trial.motion.time
    feet = _foot_points(trial)[..., :2].mean(axis=2)
    for force in trial.forces:
        vertical = np.interp(time, force.time, force.force[:, 2])
        pressed = (vertical > LOADED) & trial.known
        point = np.stack([np.interp(time, force.time, force.point[:, i]) for i in (0, 1)], axis=1)
        for first, last in runs(pressed):
            frames = slice(first, last + 1)
            # Where load is small its centre is noise: weigh by the load.
            away = np.linalg.norm(feet[frames] - point[frames, None], axis=2)
            yield force, int(np.argmin(vertical[frames] @ away)), frames


def _foot_points(trial: Trial) -> Floats:
    """(T, 2, 2, 3): left and right foot, heel and toe."""
    shape = trial.motion.shape
    segment, local = shape.contact_points()
    pose = kinematics.forward(shape.tree(), trial.motion.qpos)
    return kinematics.points(pose, segment[:4] + 1, local[:4]).reshape(-1, 2, 2, 3)


def _on_a_box(trial: Trial) -> Bools:
    """(T, 2) feet that stand on something that is no plate."""
    points, time = _foot_points(trial), trial.motion.time
    slow = np.linalg.norm(np.gradient(points, time, axis=0), axis=3).min(axis=2) < _SLOW
    lowest = points[..., 2].min(axis=2)
    on = np.zeros(lowest.shape, dtype=bool)
    for foot in range(2):
        for first, last in runs(slow[:, foot] & (lowest[:, foot] > _RAISED)):
            if time[last] - time[first] < _STANDS:
                continue
            top = float(np.median(lowest[first : last + 1, foot]))
            gone = np.flatnonzero(lowest[last:, foot] < top - _LEFT)
            on[first : last + (int(gone[0]) if len(gone) else len(time)), foot] = True
    return on
