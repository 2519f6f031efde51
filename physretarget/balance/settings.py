"""What can be set about the balance."""

from __future__ import annotations

from dataclasses import dataclass

from physretarget.ocp.balance import Weights


@dataclass(frozen=True, kw_only=True)
class BalanceSettings(Weights):
    """What balance may cost, and how it is sought; times are in s.

    hopeless: frames that leave this much unexplained all the same count half, and less the
        more they leave: nobody is to lean for what no leaning mends.
    inset, friction: the floor pushes only in the inner share of the support and with this
        share of the friction, so that some is left.
    reach: frames before and after a contact in which it may bear load: accelerations are
        second differences, and an impact shows in the frames around it.
    quiet: a clip is left as it is if no frame leaves more than this unexplained.
    stance, flight: weights of contact points against 1 for each marker, on the floor and away
        from it; in between they fade over ``fade`` s from the stance and ``low`` above the floor.
    flank: weight of the rest of a sole's underside, as a share of that of a contact point.
    joint: weight of a joint's change, per rad² and height².
    stop: weight added where a joint would have to leave its range.
    rounds: of programme and kinematics.
    window, overlap: seconds solved at once, and those before and after that are solved again
        with the next. Farther than ``overlap`` from all that is unexplained nothing moves.
    """

    hopeless: float = 0.5
    inset: float = 0.1
    friction: float = 0.9
    reach: int = 1
    quiet: float = 0.01
    stance: float = 1e4
    flight: float = 3.0
    fade: float = 0.04
    low: float = 0.03
    flank: float = 0.1
    joint: float = 0.1
    stop: float = 100.0
    rounds: int = 4
    window: float = 10.0
    overlap: float = 1.5
