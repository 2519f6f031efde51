"""The whole way from a capture to a clip: one line per stage of the paper.

    capture ─ load ─▶ ActorMotion ─ features ─▶ Mapper ─ ik ─▶ mapped
        ─ momentum ─▶ placed ─ contact ─▶ contacted ─ ocp ─▶ physical
        ─ balance ─▶ balanced [─ simulate ─▶ simulated] ─▶ Clip

Every stage's output is kept in :class:`Retargeted`, so that it can be looked at and
compared (Yamane 2010, Figure 7).
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget import contact, dials, ik, momentum, ocp, passive
from physretarget._version import __version__
from physretarget.acting import Acting, measure_acting, over_budget
from physretarget.capture.actor import ActorMotion, ActorShape
from physretarget.clip import Clip
from physretarget.errors import InputError, UsageError
from physretarget.features import features
from physretarget.kinematics import difference, integrate, runs
from physretarget.mapping import Mapped, SharedGPLVM
from physretarget.mjcf import Character, actor_character
from physretarget.mjcf.dynamics import lowpass
from physretarget.novelty import Novelty, novelty
from physretarget.options.retargeting import STAGES, RetargetSettings, Stage
from physretarget.simulate import Simulation, SimulationSettings, simulate
from physretarget.trained import TrainedMapper
from physretarget.wholebody import WholeBody, balance

__all__ = [
    "STAGES",
    "Progress",
    "RetargetSettings",
    "Retargeted",
    "Stage",
    "retarget",
]

Array = NDArray[np.float64]
SWINGS = 2
"""Rounds of place, contact and swing: the swinging limb moves the body that swings it."""
FEWEST = 8
"""Frames of a clip."""
Progress = Callable[[str], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Retargeted:
    """A capture's way through the stages; stages that did not run are None.

    ``motion`` is the actor in its own proportions at the clip's rate, ``reference`` the same
    on the reference actor; ``acting`` is what each stage did to the acting;
    ``y`` (T, D_Y) the actor's features, ``mapped`` the mapper's answer,
    ``novelty`` which frames no key pose is like. ``seconds`` is the wall time of each stage.
    ``simulated`` may have lost the body on the way: then the clip is that of stage ``balanced``.
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
    balanced: WholeBody | None
    simulated: Simulation | None
    acting: tuple[Acting, ...]
    clip: Clip
    seconds: dict[str, float]
    notes: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the notes that say the clip may be of no use."""
        warning = self.novelty.warning
        return (*self.motion.doubts, *(() if warning is None else (warning,)))

    def stages(self) -> dict[Stage, Array]:
        """The character's qpos (T, nq) after each stage that ran, in order."""
        found = _clips(self.pose, self.placed, self.contacted, self.physical, self.balanced)
        if self.simulated is not None and self.simulated.survived:
            found["simulated"] = self.clip.qpos
        return found


def _clips(
    pose: ik.IkResult,
    placed: momentum.Placed | None,
    contacted: contact.Contacted | None,
    physical: ocp.RootHeight | None,
    balanced: WholeBody | None,
) -> dict[Stage, Array]:
    """The clips of the stages that ran, in order."""
    found: dict[Stage, Array] = {"mapped": pose.qpos}
    if placed is not None:
        found["placed"] = placed.qpos
    if contacted is not None:
        found["contacted"] = contacted.qpos
    if physical is not None:
        found["physical"] = physical.qpos
    if balanced is not None:
        found["balanced"] = balanced.qpos
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


@dataclass(frozen=True, eq=False)
class _Run:
    """What every stage after the mapping needs.

    ``actor`` is the reference actor, ``reference`` the motion on it, ``motion`` that of the actor.
    """

    character: Character
    actor: Character
    motion: ActorMotion
    reference: ActorMotion
    mapped: Mapped
    settings: RetargetSettings
    watch: _Stopwatch

    def reaches(self, stage: Stage) -> bool:
        return STAGES.index(self.settings.until) >= STAGES.index(stage)

    @cached_property
    def kept(self) -> NDArray[np.bool_] | None:
        """(T,) frames that the last two stages leave alone."""
        ranges = self.settings.keep
        return dials.spans(self.motion.time, ranges) if ranges else None

    @property
    def swinging(self) -> bool:
        return self.settings.tail == "passive"

    def swing(self, qpos: Array) -> passive.Swung:
        self.watch.start("swing")
        return passive.swing(self.character, qpos, self.motion.time)


def retarget(
    motion: ActorMotion,
    mapper: TrainedMapper,
    *,
    settings: RetargetSettings | None = None,
    phases: contact.Phases | None = None,
    simulation: SimulationSettings | None = None,
    progress: Progress = _silent,
) -> Retargeted:
    """Turn an actor's motion into a clip of the mapper's character.

    Args:
        motion: the actor's motion, from :func:`physretarget.capture.load`.
        mapper: learned by :func:`physretarget.trained.learn`; carries its character.
        settings: what can be set, defaults if None.
        phases: contact phases set by hand; detected from the motion if None.
        simulation: of the last stage, ``simulated``; exact if None.
        progress: called with each stage's name as it starts.

    Returns:
        The clip after the last stage, and what each stage made.

    Raises:
        InputError: no run of valid frames is long enough to differentiate, at the capture's frame
            rate or at the clip's.
        SolverError: a programme of the last two stages fails.
    """
    settings = settings or RetargetSettings()
    watch = _Stopwatch(progress)
    character = mapper.character

    watch.start("prepare")
    motion, notes = _prepare(dials.excerpt(motion, settings.start, settings.end), settings)
    actor = actor_character(motion.shape)
    phases = None if phases is None else _shifted(phases, settings.start).at(motion.time)
    motion, phases, hasty = _filtered(motion, actor, phases, character, settings)
    notes += hasty
    reference = motion.on(ActorShape.reference())

    watch.start("map")
    mapper = _searching(mapper, settings)
    own = settings.markers == "own"
    y = features(actor, motion.qpos) if own else features(mapper.actor, reference.qpos)
    mapped = mapper.mapper.predict(y)
    mapped = replace(mapped, mean=dials.exaggerated(mapped.mean, settings.exaggerate))
    unlike = novelty(y, mapper.y, mapper.names, fps=motion.fps)
    notes += () if unlike.warning is None else (unlike.warning,)

    watch.start("pose")
    pose = ik.follow(character, mapped.mean, motion.fps, start=mapper.nearest_pose(y))

    run = _Run(character, mapper.actor, motion, reference, mapped, settings, watch)
    if phases is None and run.reaches("contacted"):
        phases = contact.detect_phases(motion)
    pose, placed, contacted, told = _on_the_floor(run, pose, phases)
    contacted, physical = _physical(run, contacted)
    balanced = _balanced(run, contacted, physical)
    for stage in (contacted, physical, balanced):
        told += () if stage is None else stage.notes
    clips = _clips(pose, placed, contacted, physical, balanced)
    qpos = list(clips.values())[-1]
    simulated = _simulated(run, qpos, simulation)
    if simulated is not None:
        told += _how_it_ended(simulated)
        if simulated.survived:
            qpos = clips["simulated"] = _at(simulated, character, motion.time)
    notes += told
    watch.stop()

    acting = measure_acting(character, {str(k): q for k, q in clips.items()}, motion.time)
    notes += over_budget(acting) + dials.too_high(acting[-1].hop, settings.max_hop)
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
        simulated=simulated,
        acting=acting,
        clip=Clip(
            qpos=qpos,
            time=motion.time,
            joint_names=character.joint_names,
            model_name=character.name,
            model_sha256=character.sha256,
            contact_points=character.contacts.names if contacted else (),
            contact_active=_standing(contacted, balanced),
            meta=_provenance(motion, mapper, settings)
            | {"novelty": unlike.summary(), "acting": [asdict(each) for each in acting]},
        ),
        seconds=watch.seconds,
        notes=motion.notes + notes,
    )


def _on_the_floor(
    run: _Run, pose: ik.IkResult, phases: contact.Phases | None
) -> tuple[ik.IkResult, momentum.Placed | None, contact.Contacted | None, tuple[str, ...]]:
    """Poses placed in the world and planted, and what a passive limb has to say.

    A passive limb swings on the planted body, and the body is placed again with what it swung:
    hence the poses come back too.
    """
    placed: momentum.Placed | None = None
    contacted: contact.Contacted | None = None
    notes: tuple[str, ...] = ()
    for _ in range(SWINGS if run.swinging else 1):
        if run.reaches("placed"):
            run.watch.start("place")
            placed = momentum.place(
                run.character,
                pose.qpos,
                run.actor,
                run.reference.qpos,
                run.motion.time,
                heading=run.settings.heading,
            )
        if run.reaches("contacted") and placed is not None and phases is not None:
            run.watch.start("contact")
            contacted = contact.adjust(
                run.character,
                placed.qpos,
                run.motion.time,
                phases,
                settings=contact.ContactSettings(blend=run.settings.blend),
            )
        if run.swinging and contacted is not None:
            swung = run.swing(contacted.qpos)
            contacted = replace(contacted, qpos=swung.qpos)
            limb = passive.with_limb(run.character, pose.qpos, swung.qpos)
            pose, notes = replace(pose, qpos=limb), swung.notes
    return pose, placed, contacted, notes


def _physical(
    run: _Run, contacted: contact.Contacted | None
) -> tuple[contact.Contacted | None, ocp.RootHeight | None]:
    """The root's height; a passive limb feels it, and the height is found again for that limb."""
    if contacted is None or not run.reaches("physical"):
        return contacted, None
    pose_error = features(run.character, contacted.qpos) - run.mapped.mean
    if run.swinging:  # nobody has posed it, so there is no pose to keep to
        pose_error[:, passive.passive_features(run.character)] = 0.0

    def optimised(clip: contact.Contacted) -> ocp.RootHeight:
        run.watch.start("physics")
        return ocp.optimise(
            run.character,
            clip.qpos,
            run.motion.time,
            clip.active,
            pose_error=pose_error,
            pose_variance=run.mapped.variance,
            share=None if run.kept is None else dials.share_beside(run.kept, run.motion.time),
            strength=run.settings.strength.get("physical", 1.0),
            settings=replace(
                ocp.RootHeightSettings.preset(run.settings.physics), solver=run.settings.solver
            ),
        )

    physical = optimised(contacted)
    if run.swinging:
        swung = run.swing(physical.qpos)
        limb = passive.with_limb(run.character, contacted.qpos, swung.qpos)
        contacted = replace(contacted, qpos=limb)
        physical = optimised(contacted)
    return contacted, physical


def _balanced(
    run: _Run, contacted: contact.Contacted | None, physical: ocp.RootHeight | None
) -> WholeBody | None:
    """The whole body moved to where the floor can bear it; a passive limb feels that.

    From stage ``contacted``: what the root's height alone mends, the whole body mends with less.
    """
    if contacted is None or physical is None or not run.reaches("balanced"):
        return None
    run.watch.start("balance")
    balanced = balance(
        run.character,
        contacted.qpos,
        run.motion.time,
        contacted.active,
        keep=run.kept,
        strength=run.settings.strength.get("balanced", 1.0),
    )
    if run.swinging:
        swung = run.swing(balanced.qpos)
        limb = passive.with_limb(run.character, balanced.qpos, swung.qpos)
        balanced = replace(balanced, qpos=limb)
    return balanced


def _simulated(run: _Run, qpos: Array, settings: SimulationSettings | None) -> Simulation | None:
    """The clip as MuJoCo plays it."""
    if not run.reaches("simulated"):
        return None
    run.watch.start("simulate")
    character = run.character
    clip = Clip(qpos=qpos, time=run.motion.time, joint_names=character.joint_names)
    simulated = simulate(clip, character, settings)
    if simulated.ending == "interrupted":
        raise KeyboardInterrupt
    return simulated


def _at(simulated: Simulation, character: Character, time: Array) -> Array:
    """A simulation's poses at a clip's frames; between two steps on the line that joins them."""
    tree, qpos = character.tree, simulated.clip.qpos
    place = np.clip((time - time[0]) / simulated.timestep, 0.0, len(qpos) - 1.0)
    before = np.minimum(place.astype(np.int64), len(qpos) - 2)
    step = difference(tree, qpos[before], qpos[before + 1])
    return integrate(tree, qpos[before], (place - before)[:, None] * step)


def _how_it_ended(simulated: Simulation) -> tuple[str, ...]:
    measures = simulated.measures
    if simulated.survived:
        return (
            f"Simulated: {100 * measures.tracking_share:.1f} % of the height off the stage before, "
            f"assist {measures.assist_force_rms_bw:.2f} BW, "
            f"trackability {measures.trackability:.2f}.",
        )
    return (
        f"MuJoCo loses the body at {measures.survived_s:.2f} s of {measures.duration_s:.2f} s: "
        "the clip is that of the stage before.",
    )


def _standing(
    contacted: contact.Contacted | None, balanced: WholeBody | None
) -> NDArray[np.bool_] | None:
    """Which contact points the clip says stand."""
    if contacted is None:
        return None
    return contacted.active if balanced is None else balanced.active


def _provenance(
    motion: ActorMotion, mapper: TrainedMapper, settings: RetargetSettings
) -> dict[str, Any]:
    """What the clip was made from: every input with its hash, every parameter, the seed.

    No time of day and no absolute path: same inputs and seed give the same bytes.
    """
    doubts = {"doubts": list(motion.doubts)} if motion.doubts else {}
    return doubts | {
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


def _filtered(
    motion: ActorMotion,
    actor: Character,
    phases: contact.Phases | None,
    character: Character,
    settings: RetargetSettings,
) -> tuple[ActorMotion, contact.Phases | None, tuple[str, ...]]:
    """Low-pass filtered, flights not too long; phases only where they are known already."""

    def smooth(rough: ActorMotion) -> ActorMotion:
        if settings.lowpass_hz is None:
            return rough
        return replace(rough, qpos=lowpass(actor, rough.qpos, rough.fps, settings.lowpass_hz))

    filtered = smooth(motion)
    if settings.max_hop is None:
        return filtered, phases, ()
    phases = phases or contact.detect_phases(filtered)
    highest = settings.max_hop * character.height
    # The rough motion is played faster: what is between its frames is filtered afterwards.
    played, phases, notes = dials.lower_hops(motion, phases, highest)
    return smooth(played), phases, notes


def _searching(mapper: TrainedMapper, settings: RetargetSettings) -> TrainedMapper:
    """The mapper that searches as it is told."""
    if settings.search == "guided":
        return mapper
    if not isinstance(mapper.mapper, SharedGPLVM):
        raise UsageError(
            f"search is 'nearest', which is for mapper sgplvm; this one is {mapper.mapper.name}."
        )
    return replace(mapper, mapper=mapper.mapper.as_paper())


def _shifted(phases: contact.Phases, start: float | None) -> contact.Phases:
    """Phases of the capture on the clock of a clip that begins later."""
    return phases if start is None else replace(phases, time=phases.time - start)


def _longest_run(valid: NDArray[np.bool_]) -> tuple[int, int]:
    return max(runs(valid), key=lambda run: run[1] - run[0], default=(0, -1))
