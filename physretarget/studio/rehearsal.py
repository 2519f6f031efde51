"""What key poses do: the mapper learned from them, and whole takes played by the character."""

from __future__ import annotations

from dataclasses import dataclass, replace
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.features import features
from physretarget.ik import solve
from physretarget.keyposes import KeyPose, KeyPoseSet, settled
from physretarget.keyposes.candidates import Candidates, find_candidates, posed_features
from physretarget.keyposes.suggest import uncertainty
from physretarget.mjcf import Character
from physretarget.options.retargeting import MapperOptions, RetargetSettings, Stage
from physretarget.pipeline import Retargeted, retarget
from physretarget.studio.session import Session
from physretarget.trained import TrainedMapper, learn
from physretarget.validation import Report, validate

__all__ = ["Coverage", "Played", "Rehearsal"]

Array = NDArray[np.float64]
# Fewer poses than that span no motion.
FEWEST = 2


@dataclass(frozen=True, eq=False)
class Played:
    """A take as the character plays it, after a stage; ``report`` of the finished clip alone."""

    made: Retargeted
    report: Report | None


@dataclass(frozen=True, eq=False)
class Coverage:
    """How well candidates are known, given what is posed.

    ``unknown`` (M,) is what remains of each candidate's standard deviation, 1 where nothing like it
    is posed; ``expected`` the error to be expected on frames that are not posed, as a share of the
    character's height: the root mean square of the mapper's own standard deviation there. None
    while there are too few key poses for a mapper.
    """

    candidates: Candidates
    unknown: Array
    expected: float | None


class Rehearsal:
    """Mappers and takes of a session, kept as long as the key poses stay as they are."""

    def __init__(self, session: Session) -> None:
        self._session, self.takes = session, session.takes
        self._lock = Lock()
        self._for: KeyPoseSet | None = None
        self._mapper: TrainedMapper | None = None
        self._played: dict[tuple[int, Stage], Played] = {}
        self._candidates: Candidates | None = None

    @property
    def character(self) -> Character:
        """The session's, as its file stands."""
        return self._session.character

    def mapper(self, keyposes: KeyPoseSet) -> TrainedMapper:
        """The mapper learned from these key poses.

        Raises:
            InputError: there are too few.
        """
        if len(keyposes) < FEWEST:
            raise InputError(f"a motion needs {FEWEST} key poses or more to be learned from")
        with self._lock:
            if self._for is not keyposes or self._mapper is None:
                self._for, self._played = keyposes, {}
                self._mapper = self._learned(keyposes)
            return self._mapper

    def play(self, keyposes: KeyPoseSet, take: int, until: Stage) -> Played:
        """A take retargeted with these key poses, judged if it went through all stages."""
        mapper = self.mapper(keyposes)
        with self._lock:
            known = self._played.get((take, until)) if self._for is keyposes else None
        if known is not None:
            return known
        settings = RetargetSettings(until=until)
        made = retarget(self.takes[take].motion, mapper, settings=settings)
        finished = until in ("contacted", "physical", "balanced")
        report = validate(made.clip, self.character) if finished else None
        played = Played(made, report)
        with self._lock:
            if self._for is keyposes:
                self._played[take, until] = played
        return played

    def mapped_pose(self, keyposes: KeyPoseSet, pose: KeyPose) -> Array:
        """(nq,) what the other key poses make of this one's actor, put down on the floor."""
        others = tuple(each for each in keyposes.poses if each.name != pose.name)
        if len(others) < FEWEST:
            raise InputError(f"a pose can be mapped from {FEWEST} others or more")
        mapper = self._learned(replace(keyposes, poses=others))
        y = features(mapper.actor, pose.actor_qpos[None])
        found = solve(self.character, mapper.mapper.predict(y).mean, start=mapper.nearest_pose(y))
        return settled(self.character, found.qpos[0], planted=pose.planted)

    def _learned(self, keyposes: KeyPoseSet) -> TrainedMapper:
        """A mapper of fewer dimensions than there are key poses, as it must be."""
        dims = min(MapperOptions.dims, len(keyposes) - 1)
        return learn(self.character, keyposes, dims=dims)

    def coverage(self, keyposes: KeyPoseSet) -> Coverage:
        """How well frames of the takes are known."""
        candidates, expected = self.candidates(), None
        if len(keyposes) >= FEWEST:
            mapped = self.mapper(keyposes).mapper.predict(candidates.y)
            expected = mapped.expected_error / self.character.height
        return Coverage(candidates, uncertainty(candidates.y, posed_features(keyposes)), expected)

    def candidates(self) -> Candidates:
        """Frames of all takes that could be posed."""
        with self._lock:
            if self._candidates is None:
                if not self.takes:
                    raise InputError("no capture is open: start the studio with one")
                self._candidates = find_candidates([take.motion for take in self.takes])
            return self._candidates
