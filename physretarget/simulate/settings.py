"""What a simulation is asked for and what it is made of: every constant with unit and source.

Sources: *measured* is a comparison on clips of four bodies; *definition* needs none.
"""

from __future__ import annotations

from dataclasses import dataclass

from physretarget.options.simulation import SimulationOptions

__all__ = ["SimulationSettings", "settings_of"]


@dataclass(frozen=True, kw_only=True)
class SimulationSettings:
    """How a clip is played forward.

    Attributes:
        assist: whether a wrench on the root may help; without it the simulation is exact.
        timestep: of MuJoCo, s. Contacts of MuJoCo's default stiffness (time constant 20 ms) need at
            least five steps per constant (MuJoCo's documentation, solref): at most 4 ms; half of it
            is what the shipped models ask for.
        steps_per_knot: steps with one torque. Feedback at 250 Hz, twice of what robots of this
            size are driven by; derivatives are taken over one step of a knot's length.
        window: s that are planned ahead. The time constant of a fall is the root of height over
            gravity (0.15 to 0.3 s for the bodies measured): two of them; 0.8 s lost walks.
        commit: s of a plan that are played before the next is made.
        iterations: Newton steps on each window, at most.
        hard_iterations: the same on windows that cost more than ``good``.
        stuck: cost of a window, after its Newton steps, from which on it gets other beginnings:
            6 % of the height off throughout.
        samples: how many of these are its torques with noise. Contacts make local minima, and
            Newton steps stay in one.
        finalists: the best of them that get Newton steps of their own.
        noise: standard deviation of that noise, in limits of the torque.
        noise_s: seconds between its independent values, joined by splines.
        seed: of the noise; drawn anew for every window from this and the window's first knot.
        good: cost of a window that needs no more iterations: markers, feet and the centre of mass
            3 % of the height off throughout.
        gain: relative fall of the cost below which a window is settled (measured).
        marker, feet, com, tilt: weights of squared errors, in heights and radians, averaged over
            the points (measured; their ratio matters, not their size).
        posture: weight of a joint's squared error, rad or heights: what no marker sees.
        speed_hz: an error in speed weighs as much as one in place that swings at this frequency.
        torque_hz: a torque off the reference weighs as much as the error that it would make if it
            swung the joint at this frequency. 6 Hz was too dear for landings.
        limit: weight of the squared excess over joint limits, rad or m.
        limit_margin: rad before a limit where its cost begins: limits are soft springs, a knee went
            0.49 rad past one without.
        terminal: weight of the last knot of a window against the others.
        capture: weight there of the capture point's error (Pratt et al. 2006), in heights.
        assist_weight: of the squared assist, force in body weights, moment in body weights times
            the height of the centre of mass.
        tail_hz: frequency of the critically damped servo that continues a plan beyond its end.
        smooth_hz: low-pass on the accelerations of the reference torques.
        friction_share: of the friction coefficient that plans count on while they are good with it;
            the simulation itself has all of it. A foot planned to the edge of its cone slips when
            the state or the floor is a little off, and the gains know nothing of slipping
            (constraints tightened against disturbances: Chisci, Rossiter and Zappa 2001).
        aside: m along x and y that a start may be off, from which gains must lead back.
        touch: share of the height within which geometry bears load in the reference.
        lift: m of median penetration that count as an offset of the whole clip and are taken out.
        torque_multiple: limit of a joint's torque, in gravity torques, where the model has none.
        lost: root-mean-square marker error, in heights, at which the body no longer plays the clip.
        speed_most: rad/s or m/s at which a simulation has come apart.
        retreat: s that are taken back when the body is lost, to be planned again with more care.
        care: how the window, in s, and the iterations grow with each attempt on the same stretch;
            after the last the simulation ends.
        budget: CPU-seconds per second of the clip that may be spent; beyond, windows get one
            iteration and no second attempt. None for no bound: only then is the result the same on
            every run.
    """

    assist: bool = False
    timestep: float = 0.002
    steps_per_knot: int = 2
    window: float = 0.4
    commit: float = 0.1
    iterations: int = 3
    hard_iterations: int = 8
    stuck: float = 2.0
    samples: int = 24
    finalists: int = 2
    noise: float = 0.02
    noise_s: float = 0.05
    seed: int = 0
    good: float = 0.5
    gain: float = 2e-3
    marker: float = 1.0
    feet: float = 2.0
    com: float = 1.0
    tilt: float = 0.1
    posture: float = 1e-3
    speed_hz: float = 3.0
    torque_hz: float = 12.0
    limit: float = 5.0
    limit_margin: float = 0.02
    terminal: float = 20.0
    capture: float = 20.0
    assist_weight: float = 0.1
    tail_hz: float = 3.0
    smooth_hz: float = 10.0
    friction_share: float = 0.8
    aside: float = 0.005
    touch: float = 0.01
    lift: float = 0.002
    torque_multiple: float = 8.0
    lost: float = 0.25
    speed_most: float = 300.0
    retreat: float = 0.4
    care: tuple[tuple[float, int], ...] = ((0.6, 8), (0.5, 12))
    budget: float | None = None

    @property
    def knot(self) -> float:
        """Seconds between two torques."""
        return self.timestep * self.steps_per_knot


def settings_of(options: SimulationOptions) -> SimulationSettings:
    """The settings that the options of a user stand for.

    With a hand on the root, one iteration on a short window does.

    Args:
        options: The options of command line, service or suite.

    Returns:
        The settings.
    """
    if not options.assist:
        return SimulationSettings(budget=options.budget, seed=options.seed)
    return SimulationSettings(
        assist=True, window=0.3, iterations=1, care=(), budget=options.budget, seed=options.seed
    )
