"""The whole way from a capture to a clip: one line per stage of the paper.

    capture ─ load ─▶ ActorMotion ─ features ─▶ Mapper ─ ik ─▶ mapped
        ─ momentum ─▶ placed ─ contact ─▶ contacted ─ ocp ─▶ physical
        ─ balance ─▶ balanced ─▶ Clip

Every stage's output is kept in :class:`Retargeted`, so that it can be looked at and
compared (Yamane 2010, Figure 7).
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from physretarget import contact, ik, momentum, ocp, passive
from physretarget._version import __version__
from physretarget.balance import Balanced, balance
from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.clip import Clip
from physretarget.errors import InputError, UsageError
from physretarget.features import features
from physretarget.mapping import Mapped
from physretarget.mjcf import Character, actor_character
from physretarget.mjcf.dynamics import lowpass
from physretarget.novelty import Novelty, novelty
from physretarget.trained import TrainedMapper

Array = NDArray[np.float64]
Stage = Literal["mapped", "placed", "contacted", "physical", "balanced"]
Tail = Literal["mapped", "passive"]
TAILS: tuple[Tail, ...] = get_args(Tail)
SWINGS = 2
"""Rounds of swing, place and contact: the swinging limb moves the body that swings it."""
FEWEST = 8
"""Frames of a clip."""
STAGES: tuple[Stage, ...] = get_args(Stage)
Progress = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class RetargetSettings:
    """What can be set about a retargeting; read once at the edge.

    until: the last stage to run. physics: preset of the root-height optimisation.
    fps: frame rate of the clip, None for the capture's own up to ``max_fps``.
    lowpass_hz: zero-lag 4th order Butterworth on the actor's motion before anything else
    (6 Hz is the biomechanics standard, Winter 2009); None for no filter.
    heading: where the character's yaw comes from, see :func:`physretarget.momentum.place`.
    tail: where joints that the model names as passive get their motion: from the mapper, or
    from passive dynamics on the moving body, see :mod:`physretarget.passive`.
    """

    until: Stage = "balanced"
    physics: ocp.Preset = "default"
    heading: momentum.Heading = "actor"
    tail: Tail = "mapped"
    fps: float | None = None
    max_fps: float = 60.0
    lowpass_hz: float | None = 6.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.until not in STAGES:
            raise UsageError(f"until is {self.until!r}; it is one of {', '.join(STAGES)}.")
        if self.tail not in TAILS:
            raise UsageError(f"tail is {self.tail!r}; it is one of {', '.join(TAILS)}.")
        if self.tail == "passive" and self.until in ("mapped", "placed"):
            raise UsageError(f"a passive tail needs the contact stage; until is {self.until!r}.")
        for name, rate in (("frame rate", self.fps), ("highest frame rate", self.max_fps)):
            if rate is not None and not 1 <= rate <= 1000:
                raise UsageError(f"The {name} is {rate:g}; it must lie between 1 and 1000.")
        if self.lowpass_hz is not None and not 0 < self.lowpass_hz < float("inf"):
            raise UsageError(f"The low-pass is {self.lowpass_hz:g} Hz; it must be above 0.")


@dataclass(frozen=True, kw_only=True, eq=False)
class Retargeted:
    """A capture's way through the stages; stages that did not run are None.

    ``motion`` is the actor in its own proportions at the clip's rate, ``reference`` the same
    on the reference actor; ``y`` (T, D_Y) the actor's features, ``mapped`` the mapper's answer,
    ``novelty`` which frames no key pose is like. ``seconds`` is the wall time of each stage.
    """

    character: Character
    actor: Character
    motion: ActorMotion
    reference: ActorMotion
    y: Array
    mapped: Mapped
    novelty: Novelty
    pose: ik.IkResult
    placed: momentum.Placed | None
    phases: contact.Phases | None
    contacted: contact.Contacted | None
    physical: ocp.RootHeight | None
    balanced: Balanced | None
    clip: Clip
    seconds: dict[str, float]
    notes: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the notes that say the clip may be of no use."""
        warning = self.novelty.warning
        return () if warning is None else (warning,)

    def stages(self) -> dict[Stage, Array]:
        """The character's qpos (T, nq) after each stage that ran, in order."""
        found: dict[Stage, Array] = {"mapped": self.pose.qpos}
        if self.placed is not None:
            found["placed"] = self.placed.qpos
        if self.contacted is not None:
            found["contacted"] = self.contacted.qpos
        if self.physical is not None:
            found["physical"] = self.physical.qpos
        if self.balanced is not None:
            found["balanced"] = self.balanced.qpos
        return found


@dataclass
class _Stopwatch:
    progress: Progress
    seconds: dict[str, float] = field(default_factory=dict)
    _name: str = ""
    _since: float = 0.0

    def start(self, name: str) -> None:
        self.stop()
        self.progress(name)
        self._name, self._since = name, clock.perf_counter()

    def stop(self) -> None:
        if self._name:
            spent = clock.perf_counter() - self._since
            self.seconds[self._name] = self.seconds.get(self._name, 0.0) + spent
            self._name = ""


def _silent(_: str) -> None:
    return None


def retarget(
    motion: ActorMotion,
    mapper: TrainedMapper,
    *,
    settings: RetargetSettings | None = None,
    phases: contact.Phases | None = None,
    progress: Progress = _silent,
) -> Retargeted:
    """Turn an actor's motion into a clip of the mapper's character.

    Args:
        motion: the actor's motion, from :func:`physretarget.capture.load`.
        mapper: learned by :func:`physretarget.trained.learn`; carries its character.
        settings: what can be set, defaults if None.
        phases: contact phases set by hand; detected from the motion if None.
        progress: called with each stage's name as it starts.

    Raises:
        InputError: no run of valid frames is long enough to differentiate, at the capture's frame
            rate or at the clip's.
    """
    settings = settings or RetargetSettings()
    watch = _Stopwatch(progress)
    character = mapper.character

    watch.start("prepare")
    motion, notes = _prepare(motion, settings)
    actor = actor_character(motion.shape)
    motion = _filtered(motion, actor, settings)
    reference = motion.on(ActorShape.reference())

    watch.start("map")
    y = features(mapper.actor, reference.qpos)
    mapped = mapper.mapper.predict(y)
    unlike = novelty(y, mapper.y, mapper.names, fps=motion.fps)
    notes += () if unlike.warning is None else (unlike.warning,)

    watch.start("pose")
    pose = ik.solve(character, mapped.mean, start=mapper.nearest_pose(y))

    placed = contacted = physical = balanced = None
    time = motion.time
    swinging = settings.tail == "passive"
    pose_error = np.zeros_like(mapped.mean)
    if settings.until != "mapped" and settings.until != "placed":
        phases = phases.at(time) if phases is not None else contact.detect_phases(motion)
    for again in range(SWINGS + 1 if swinging else 1):
        if again and contacted is not None:
            watch.start("swing")
            swung = passive.swing(character, contacted.qpos, time)
            contacted = replace(contacted, qpos=swung.qpos)
            pose = replace(pose, qpos=passive.with_limb(character, pose.qpos, swung.qpos))
            if again == SWINGS:
                notes += swung.notes
                break
        if STAGES.index(settings.until) >= STAGES.index("placed"):
            watch.start("place")
            placed = momentum.place(
                character, pose.qpos, actor, motion.qpos, time, heading=settings.heading
            )
        if placed is not None and phases is not None and settings.until != "placed":
            watch.start("contact")
            contacted = contact.adjust(character, placed.qpos, time, phases)
    if contacted is not None:
        notes += contacted.notes
        pose_error = features(character, contacted.qpos) - mapped.mean
        if swinging:  # nobody has posed it, so there is no pose to keep to
            pose_error[:, passive.passive_features(character)] = 0.0
    if contacted is not None and STAGES.index(settings.until) >= STAGES.index("physical"):
        for again in range(2 if swinging else 1):
            if again and physical is not None:  # the limb has felt the root's new height
                watch.start("swing")
                swung = passive.swing(character, physical.qpos, time)
                limb = passive.with_limb(character, contacted.qpos, swung.qpos)
                contacted = replace(contacted, qpos=limb)
            watch.start("physics")
            physical = ocp.optimise(
                character,
                contacted.qpos,
                time,
                contacted.active,
                pose_error=pose_error,
                pose_variance=mapped.variance,
                settings=ocp.RootHeightSettings.preset(settings.physics),
            )
        notes += physical.notes if physical is not None else ()
    if contacted is not None and physical is not None and settings.until == "balanced":
        watch.start("balance")
        balanced = balance(character, physical.qpos, time, contacted.active)
        if swinging:  # the limb feels the lean
            swung = passive.swing(character, balanced.qpos, time)
            limb = passive.with_limb(character, balanced.qpos, swung.qpos)
            balanced = replace(balanced, qpos=limb)
        notes += balanced.notes
    watch.stop()

    final = balanced or physical or contacted or placed or pose
    return Retargeted(
        character=character,
        actor=actor,
        motion=motion,
        reference=reference,
        y=y,
        mapped=mapped,
        novelty=unlike,
        pose=pose,
        placed=placed,
        phases=phases,
        contacted=contacted,
        physical=physical,
        balanced=balanced,
        clip=Clip(
            qpos=final.qpos,
            time=time,
            joint_names=character.joint_names,
            model_name=character.name,
            model_sha256=character.sha256,
            contact_points=character.contacts.names if contacted else (),
            contact_active=contacted.active if contacted else None,
            meta=_provenance(motion, mapper, settings) | {"novelty": unlike.summary()},
        ),
        seconds=watch.seconds,
        notes=motion.notes + notes,
    )


def _provenance(
    motion: ActorMotion, mapper: TrainedMapper, settings: RetargetSettings
) -> dict[str, Any]:
    """What the clip was made from: every input with its hash, every parameter, the seed.

    No time of day and no absolute path: same inputs and seed give the same bytes.
    """
    return {
        "tool": {"name": "physretarget", "version": __version__},
        "inputs": {
            "capture": {"name": motion.source.name, "sha256": motion.source.sha256},
            "character": {"name": mapper.character.name, "sha256": mapper.character.sha256},
            "keyposes": {"names": list(mapper.names), "sha256": mapper.sha256},
        },
        "mapper": mapper.mapper.name,
        "settings": asdict(settings),
    }


def _prepare(
    motion: ActorMotion, settings: RetargetSettings
) -> tuple[ActorMotion, tuple[str, ...]]:
    """The longest run of valid frames, at the clip's frame rate."""
    first, last = _longest_run(motion.valid)
    notes: tuple[str, ...] = ()
    _enough(last - first + 1, "usable frames in a row", motion)
    if (first, last) != (0, len(motion.time) - 1):
        notes += (
            f"Frames {first} to {last} of {len(motion.time)} are used: "
            "the others have no usable pose.",
        )
        motion = motion.cut(first, last)
    fps = settings.fps if settings.fps is not None else min(motion.fps, settings.max_fps)
    if abs(fps - motion.fps) > 1e-6:
        notes += (f"Resampled from {motion.fps:g} to {fps:g} frames per second.",)
        motion = motion.resampled(fps)
        _enough(len(motion.time), f"frames at {fps:g} frames per second", motion)
    return motion, notes


def _enough(frames: int, of_what: str, motion: ActorMotion) -> None:
    """Differences of second order need four frames at each end of a clip."""
    if frames < FEWEST:
        raise InputError(
            f"only {frames} {of_what}; at least {FEWEST} are needed, for the accelerations that "
            "forces come from take four frames at each end.",
            path=motion.source.path,
        )


def _filtered(motion: ActorMotion, actor: Character, settings: RetargetSettings) -> ActorMotion:
    if settings.lowpass_hz is None:
        return motion
    return replace(motion, qpos=lowpass(actor, motion.qpos, motion.fps, settings.lowpass_hz))


def _longest_run(valid: NDArray[np.bool_]) -> tuple[int, int]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], valid.astype(np.int8), [0]))))
    if edges.size == 0:
        return 0, -1
    starts, ends = edges[::2], edges[1::2] - 1
    longest = int(np.argmax(ends - starts))
    return int(starts[longest]), int(ends[longest])
