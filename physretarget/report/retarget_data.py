"""What the report of a retargeting shows; filled by whoever ran it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget.acting import Acting
from physretarget.errors import UsageError
from physretarget.replay.figures import Modelled
from physretarget.replay.scene import Forces

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class StageMotion:
    """The character after one stage: ``qpos`` (T, nq); ``note`` says briefly what changed.

    ``acting`` is what the stage did to the acting, and ``errors`` how many the validator finds in
    its clip; None where nobody looked.
    """

    label: str
    qpos: Array
    note: str = ""
    acting: Acting | None = None
    errors: int | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class MomentumCurves:
    """Yamane 2010 Figure 8: the actor's scaled momentum and the character's, (T,) each.

    ``axis`` names the direction ("forward"), ``unit`` the unit (kg m/s or kg m²/s).
    """

    axis: str
    target: Array
    achieved: Array
    unit: str = "kg m/s"


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceCurves:
    """Yamane 2010 Figure 9: vertical force (T,) in BW the motion requires and a model supplies.

    ``bound`` (T,) BW is the force of the convex bound where it was computed.
    """

    required_before: Array
    contact_before: Array
    required_after: Array
    contact_after: Array
    displacement: Array | None = None
    bound: Array | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class LatentMap:
    """Yamane 2010 Figure 6: a trajectory on the variance map, two latent dimensions.

    ``trajectory`` (T, 2); ``key_poses`` (N, 2) with ``names`` and ``own`` (N,), true for key
    poses of this very capture; ``variance`` (H, W), row 0 at the lowest y; ``extent``
    (x low, x high, y low, y high) of the variance map.
    """

    label: str
    trajectory: Array
    key_poses: Array
    own: Bools
    names: tuple[str, ...]
    variance: Array
    extent: tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class KeyNumber:
    """One tile: ``value`` with ``unit``; ``good`` colours it (None: no judgement).

    ``stage`` is the one after which it was measured; "" for a number on the whole.
    """

    label: str
    value: float | str
    stage: str = ""
    unit: str = ""
    note: str = ""
    good: bool | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class RetargetReport:
    """Everything on the page of one retargeting.

    ``time`` (T,) s is the clock of all tracks. ``stages`` in order, the last one is the clip.
    ``contact_active`` (T, K) belongs to the character's contact points, ``actor_contact_active``
    to the actor's. ``report`` is a validation report (or its JSON form) on the last stage.
    ``pose_variance`` (T,) is the mapper's uncertainty, variance or standard deviation.
    ``sections`` of plain name → value pairs: inputs with hashes, versions, parameters, timings.
    """

    title: str
    capture: str
    time: Array
    actor: Modelled
    actor_qpos: Array
    character: Modelled
    character_name: str
    stages: tuple[StageMotion, ...]
    contact_active: Bools | None = None
    actor_contact_active: Bools | None = None
    forces: Forces | None = None
    momentum: tuple[MomentumCurves, ...] = ()
    force: ForceCurves | None = None
    latent: tuple[LatentMap, ...] = ()
    pose_variance: Array | None = None
    numbers: tuple[KeyNumber, ...] = ()
    report: Any = None
    strip_times: tuple[float, ...] | None = None
    notes: tuple[str, ...] = ()
    sections: Mapping[str, Mapping[str, object]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        frames = len(self.time)
        tracks = {"the actor": self.actor_qpos} | {s.label: s.qpos for s in self.stages}
        for curves in self.momentum:
            tracks[f"momentum {curves.axis}"] = curves.target
        for name, track in tracks.items():
            if len(track) != frames:
                raise UsageError(f"{name} has {len(track)} frames, the clock {frames}.")
        if not self.stages:
            raise UsageError("a retargeting report needs at least one stage.")
