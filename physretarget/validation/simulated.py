"""The clip played forward, for the SIM rules and measures: exactly, and with assist."""

from __future__ import annotations

from dataclasses import dataclass, replace

from physretarget.clip import Clip, LongClip, Motion
from physretarget.errors import InputError, UsageError
from physretarget.mjcf import Character, lowpass
from physretarget.options.simulation import SimulationOptions
from physretarget.simulate import Simulation, SimulationMeasures, settings_of, simulate
from physretarget.validation.report import Measure

__all__ = ["Played", "play", "simulated_measures"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Played:
    """Both simulations, or why there are none.

    ``fall_s`` is the clip's time at which the body was lost without assist, None where it was not.
    """

    exact: SimulationMeasures | None = None
    assisted: SimulationMeasures | None = None
    fall_s: float | None = None
    reason: str = ""


def play(motion: Motion, character: Character, lowpass_hz: float | None) -> Played:
    """Simulate a clip without and with assist."""
    assert isinstance(motion, Clip | LongClip)
    clip = motion.whole() if isinstance(motion, LongClip) else motion
    if lowpass_hz is not None and clip.frames > 2:
        clip = replace(clip, qpos=lowpass(character, clip.qpos, clip.fps, lowpass_hz))
    try:
        exact = simulate(clip, character)
        assisted = simulate(clip, character, settings_of(SimulationOptions(assist=True)))
    except (InputError, UsageError) as error:
        return Played(reason=str(error).rstrip("."))
    return Played(exact=exact.measures, assisted=assisted.measures, fall_s=_fall(exact, clip))


def _fall(exact: Simulation, clip: Clip) -> float | None:
    return None if exact.survived else float(clip.time[0]) + exact.measures.survived_s


def simulated_measures(played: Played) -> dict[str, Measure]:
    """Survival, deviation and saturation of the exact simulation, assist of the other."""
    units = SimulationMeasures.units()
    if played.exact is None or played.assisted is None:
        return {name: Measure(value=None, unit=unit) for name, unit in units.items()}
    both = replace(
        played.exact,
        assist_force_rms_bw=played.assisted.assist_force_rms_bw,
        assist_moment_rms_bwh=played.assisted.assist_moment_rms_bwh,
    )
    return {name: Measure(value=v, unit=unit) for name, (v, unit) in both.named().items()}
