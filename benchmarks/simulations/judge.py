"""What the validator says of simulated clips, beside what MuJoCo knows about them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.simulations.models import NAMES, Subject, build, g1_file, generator
from benchmarks.simulations.scenarios import SCENARIOS, fits
from benchmarks.simulations.simulate import Simulation, simulate
from physretarget.validation import Finding, Report, Settings, validate

FALSE_ALARMS = ("DYN", "CON002", "CON003")
"""Beginnings of codes that may never be errors about a simulated clip."""
MOST_DEFECT = 0.2
"""BW and BW h by which a simulation's own steps may break Newton's laws: less than an error."""
RESIDUALS = (
    "unexplained_force_max_bw",
    "unexplained_force_rms_bw",
    "unexplained_moment_rms_bwh",
    "joint_torque_ratio_max",
)
"""Measures that are kept beside the verdict."""


@dataclass(frozen=True)
class Take:
    """Which simulation: everything follows from these four."""

    subject: str
    scenario: str
    seed: int
    number: int

    @property
    def name(self) -> str:
        return f"{self.subject.replace(' ', '-')}.{self.scenario}.{self.seed}.{self.number}"


@dataclass(frozen=True)
class Alarm:
    """An error about a simulated clip, and the truth at its worst frame.

    ``true_force`` and ``seen_force`` (BW) are the floor's vertical force in that instant and as
    frames can see it; ``touches`` are MuJoCo's contacts: geom, depth mm, normal and tangential
    force (BW).
    """

    code: str
    message: str
    frame: int | None
    value: float | None
    limit: float | None
    true_force: float | None = None
    seen_force: float | None = None
    touches: tuple[tuple[str, float, float, float], ...] = ()


@dataclass(frozen=True)
class Judged:
    """One clip at one frame rate, filtered or not; ``causes`` are codes of what is said to be
    behind errors, wrongly each."""

    take: Take
    fps: int
    lowpass_hz: float | None
    alarms: tuple[Alarm, ...]
    others: tuple[str, ...]
    causes: tuple[str, ...]
    residuals: dict[str, float]


def takes(
    seed: int,
    repeats: int,
    subjects: Sequence[str] = NAMES,
    scenarios: Sequence[str] = tuple(SCENARIOS),
) -> Iterator[Take]:
    """All combinations that make sense; without the G1 where its file is not here."""
    for subject in subjects:
        if subject == "g1" and g1_file() is None:
            continue
        for scenario in scenarios:
            for number in range(repeats):
                take = Take(subject, scenario, seed, number)
                if fits(subject_of(take), scenario):
                    yield take


def subject_of(take: Take) -> Subject:
    """The body of a take: all scenarios of one number share it."""
    return build(take.subject, generator(take.seed, take.number, take.subject), g1_file())


def simulated(take: Take) -> Simulation:
    """The simulation of a take; RuntimeError where MuJoCo itself gave up, or broke Newton's law."""
    subject = subject_of(take)
    rng = generator(take.seed, take.number, take.subject, take.scenario)
    simulation = simulate(subject, SCENARIOS[take.scenario](subject, rng))
    if simulation.unstable:
        raise RuntimeError(f"{take.name} is no simulation: MuJoCo warns of {simulation.unstable}")
    if simulation.defect > MOST_DEFECT:
        raise RuntimeError(
            f"{take.name} is no simulation: it breaks Newton's laws by "
            f"{simulation.defect:.2f} BW or BW h"
        )
    return simulation


def judged(take: Take, simulation: Simulation, fps: int, lowpass_hz: float | None = None) -> Judged:
    """The validator's word on the clip of a simulation at one frame rate."""
    settings = Settings(lowpass_hz=lowpass_hz)
    report = validate(simulation.clip(fps), simulation.subject.character, settings=settings)
    errors = [f for f in report.findings if f.severity == "error"]
    return Judged(
        take,
        fps,
        lowpass_hz,
        tuple(_alarm(simulation, fps, f) for f in errors if f.code.startswith(FALSE_ALARMS)),
        tuple(f.code for f in errors if not f.code.startswith(FALSE_ALARMS)),
        tuple(cause.code for cause in report.causes),
        _residuals(report),
    )


def _residuals(report: Report) -> dict[str, float]:
    values = {name: report.measures[name].value for name in RESIDUALS}
    return {name: value for name, value in values.items() if value is not None}


def _alarm(simulation: Simulation, fps: int, finding: Finding) -> Alarm:
    frame = finding.frame
    if frame is None:
        frame = finding.frame_first
    plain = (finding.code, finding.message, frame, finding.value, finding.limit)
    if frame is None:
        return Alarm(*plain)
    weight = simulation.subject.character.weight
    now, seen = simulation.true_force(fps, frame)
    touches = simulation.touches[frame * (simulation.subject.steps // fps)]
    return Alarm(
        *plain,
        float(now[2]) / weight,
        float(seen[2]) / weight,
        tuple((t.geom, 1e3 * t.depth, t.normal / weight, t.tangential / weight) for t in touches),
    )


def dump(take: Take, fps: int, folder: Path) -> None:
    """The model, the clip and the truth of a take, to look at with other tools."""
    simulation = simulated(take)
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / f"{take.name}.{fps}fps"
    (folder / f"{take.name}.xml").write_text(simulation.subject.text, encoding="utf-8")
    simulation.clip(fps).save(f"{stem}.npz")
    frames = range(len(simulation.clip(fps).time))
    truth = [simulation.true_force(fps, frame) for frame in frames]
    every = simulation.subject.steps // fps
    np.savez_compressed(
        f"{stem}.truth.npz",
        force=np.array([now for now, _ in truth]),
        force_seen=np.array([seen for _, seen in truth]),
        moment_about_com=simulation.moment[::every],
        motor_torque=simulation.torque[::every],
    )
    verdict = judged(take, simulation, fps)
    stem.with_name(f"{stem.name}.json").write_text(
        json.dumps(asdict(verdict), indent=1, ensure_ascii=False), encoding="utf-8"
    )


def mujoco_version() -> str:
    return str(mujoco.__version__)
