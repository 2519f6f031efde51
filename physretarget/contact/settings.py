"""What can be set about the contact adjustment."""

from __future__ import annotations

from dataclasses import dataclass

from physretarget.options.retargeting import Blend


@dataclass(frozen=True, kw_only=True)
class ContactSettings:
    """How stances are formed and how the character moves between them.

    Lengths are fractions of the character's height, so that they hold for every size.

    same_place: two consecutive stances of one body whose mean places are closer than this
        share one rigid target; same_heading: and whose headings are closer (rad).
    shared: so do two stances of which the shorter overlaps the longer for more than this
        share of its time: the actor stands on both feet.
    min_flight: shortest flight between two stances at different places, s.
    hop_angle: a hop over a distance R takes at least as long as a throw over R at this angle,
        sqrt(2 R tan(angle) / g), rad.
    grip: a body that carries points of both feet is thrown as a whole, from standing to standing.
        The floor pushes it off and stops it, with this share of the friction: its hops are at
        least as steep as 1 / (grip · friction), but no steeper than ``steepest``.
    hop_share: at most this share of a stance is given up to a hop, at each end.
    max_speed: a stance that could only be reached faster than this times sqrt(g · height) is
        dropped.
    hop_height: a flight of duration T rises at least g T²/8 (a ballistic hop), but no
        higher than this. longest_flight: nobody flies longer than this, s; the actor then is
        on hands or back, and nothing is thrown.
    swing_height: a foot passes at least this far over the floor while another one stands, but
        no farther than ``swing_share`` of its step's length, or ``shuffle_height`` if larger.
    blend: corrections over flights of the whole character go linearly in time ("ballistic"),
        which leaves a body in flight without horizontal acceleration, or by eq. (9) ("paper"),
        which is always used for a foot that swings.
    swivel, pivot: how far the motion's heading may be from that of the stance, rad, if what
        the body carries stands on a swivel, and if it does not; beyond that the stance is cut
        and the body turns in a small hop. min_piece: none is shorter than this, s.
        cut_grid: cuts are sought at multiples of this, s.
    waddle: a body that carries points of both feet rolls onto the side that stands by this
        angle, so that a walk shows (rad; zero for none), and back, each within ``rock`` s.
    max_tilt: such a body tilts no more than this while it stands, rad, and not at all where it
        leaves the floor or lands: an edge would bear the whole blow.
    pace: what such a body carries keeps its pace while the body itself stands and hops: it moves
        on horizontally as if every correction of the body were smoothed by a Gaussian of this
        standard deviation, s. lean: but leans no farther than this from where the pose has it,
        at its top, less below. Zero for none.
    settle_down: time from the first or last stance over which a foot on a leg comes to hang from
        the trunk as the motion has it, s.
    settle: time over which a body's tilt changes when other points become planted, s.
    missed: a stance ends where its points are farther than this from their place, m, because
        the legs do not reach, or where its sole rolls so far that some of it is ``rolled`` m
        lower than it should be; the ends are looked for ``releases`` times. None that would
        become shorter than ``shortest_stance`` s is kept.
    stance_weight: weight of planted points against 1 for each virtual marker;
        flight_weight: of the same points in flight, fading over ``fade`` s from the stance.
    flank_weight: of the rest of a foot's underside, over all its points, as a share of the
        weight of a contact point.
    clearance_weight: of a body that would be below the floor, over all its points.
    trunk_tilt, trunk_yaw, trunk_height: a trunk on legs tilts and turns no farther than this from
        where the motion has it, rad, and moves no farther up or down, when feet ask for it. What
        legs do not reach within these is given up: the stance becomes shorter.
    joint_weight: of a joint's change, per rad² and height².
    """

    same_place: float = 0.06
    same_heading: float = 0.15
    shared: float = 0.5
    min_flight: float = 0.1
    hop_angle: float = 0.6
    grip: float = 0.95
    steepest: float = 2.0
    hop_share: float = 0.4
    max_speed: float = 3.0
    hop_height: float = 0.5
    longest_flight: float = 0.85
    swing_height: float = 0.05
    swing_share: float = 0.2
    shuffle_height: float = 0.015
    swivel: float = 1.2
    pivot: float = 0.6
    min_piece: float = 0.22
    cut_grid: float = 1.0 / 30.0
    waddle: float = 0.1
    rock: float = 0.25
    max_tilt: float = 0.35
    pace: float = 0.25
    lean: float = 0.2
    settle_down: float = 0.3
    settle: float = 0.06
    missed: float = 1e-3
    rolled: float = 4e-3
    releases: int = 5
    shortest_stance: float = 0.1
    stance_weight: float = 1e4
    flight_weight: float = 1e2
    fade: float = 0.15
    flank_weight: float = 0.1
    clearance_weight: float = 1000.0
    trunk_tilt: float = 0.15
    trunk_yaw: float = 0.35
    trunk_height: float = 0.05
    joint_weight: float = 0.05
    blend: Blend = "ballistic"
    gravity: float = 9.81
