"""The one table of codes. A code is never reused; retired ones stay listed below."""

from __future__ import annotations

from physretarget.validation.rule import Rule
from physretarget.validation.rules import (
    con001_ground_penetration,
    con002_skate,
    con003_floating,
    con004_chatter,
    dat001_uneven_time,
    dat002_low_frame_rate,
    dat003_frozen_frames,
    dat004_too_short,
    dat005_other_model,
    dyn001_unexplained_force,
    dyn002_unexplained_moment,
    dyn003_pulling_floor,
    dyn004_friction,
    dyn005_centre_of_pressure,
    dyn006_flight_not_ballistic,
    dyn007_flight_spin,
    dyn008_joint_torque,
    dyn009_support_peak,
    kin001_joint_limit,
    kin002_joint_speed,
    kin003_jitter,
    kin004_teleport,
    kin005_self_penetration,
)

RULES: tuple[Rule, ...] = (
    con001_ground_penetration.RULE,
    con002_skate.RULE,
    con003_floating.RULE,
    con004_chatter.RULE,
    dat001_uneven_time.RULE,
    dat002_low_frame_rate.RULE,
    dat003_frozen_frames.RULE,
    dat004_too_short.RULE,
    dat005_other_model.RULE,
    dyn001_unexplained_force.RULE,
    dyn002_unexplained_moment.RULE,
    dyn003_pulling_floor.RULE,
    dyn004_friction.RULE,
    dyn005_centre_of_pressure.RULE,
    dyn006_flight_not_ballistic.RULE,
    dyn007_flight_spin.RULE,
    dyn008_joint_torque.RULE,
    dyn009_support_peak.RULE,
    kin001_joint_limit.RULE,
    kin002_joint_speed.RULE,
    kin003_jitter.RULE,
    kin004_teleport.RULE,
    kin005_self_penetration.RULE,
)
RETIRED: tuple[str, ...] = ()

BY_CODE: dict[str, Rule] = {rule.code: rule for rule in RULES}
