"""What the whole-body stage weighs against what."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class WholeBodySettings:
    """Weights and limits; what is counted is half the squared, over heights, radians and BW.

    The unit of cost is half the mean square displacement of the markers over the character's
    height: 1 % of the height in every marker costs 5e-5. τ = √(h / g), h the height of the centre
    of mass, is the time in which a body that leans falls.

    residual: price of the length of the wrench that no force in the friction cones explains, in
        body weights (moments over h). spike: it grows with the square, too, by half of this.
    soft: length below which the price of a residual goes with its square; it falls from the first
        to the second number over the iterations.
    hopeless: frames that leave this much all the same count half, and less the more they leave:
        nobody is to lean for what no leaning mends. patience: the iterations after which
        that is decided.
    friction: share of the floor's friction that is used; inset: share by which the support is
        drawn in towards its middle, so that some of both is left. reach: frames before and
        after a contact in which it may bear load: accelerations are second differences, and an
        impact shows in the frames around it.
    velocity, acceleration: of the markers' change, per τ and per τ². ends: more of the velocity
        within about τ of a clip's ends: beyond them nobody has to catch a fall.
    joint: of the change of a joint, per rad, against the displacement of one marker. turn: of the
        root's turning, in velocity and acceleration: a base under a head that keeps still would
        flutter, for its own few markers say little.
    stance, flight: of contact points against 1 for a marker, on the floor and off it; in between
        they fade over ``fade`` s from the stance and ``low`` heights above the floor.
    gaze, gaze_rate: of the change of the direction that the face has, and of its rate per τ.
    limit: beyond the joints' ranges, per rad; floor: of what is too deep in the floor, per height.
    most: displacement of a frame's markers (RMS, over the height) beyond which it is dear, by half
        of ``beyond`` times the squared excess.
    quiet: a clip is left as it is if no frame leaves more than this unexplained (BW).
    iterations, tolerance: of the search; it ends when an iteration gains less than this share.
    window, overlap: seconds solved at once, and those after it that are solved with it and then
        again with the next. Farther than ``overlap`` from all that is unexplained nothing moves.
    """

    residual: float = 0.2
    spike: float = 5.0
    soft: tuple[float, float] = (0.2, 0.02)
    hopeless: float = 0.5
    patience: tuple[int, ...] = (4, 8)
    friction: float = 0.9
    inset: float = 0.1
    reach: int = 1
    velocity: float = 0.005
    acceleration: float = 0.003
    ends: float = 1.0
    joint: float = 0.1
    turn: float = 5.0
    stance: float = 1e6
    flight: float = 3.0
    fade: float = 0.04
    low: float = 0.03
    gaze: float = 0.01
    gaze_rate: float = 0.1
    limit: float = 500.0
    floor: float = 100.0
    most: float = 0.12
    beyond: float = 1e4
    quiet: float = 0.01
    iterations: int = 20
    tolerance: float = 3e-3
    window: float = 10.0
    overlap: float = 1.5
