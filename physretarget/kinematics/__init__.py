"""Articulated trees in plain NumPy: forward kinematics, Jacobians and inverse kinematics.

Everything works on whole batches of frames at once and knows no simulator, so that the
same few functions serve the fit of an actor to a capture, the inverse kinematics of a
character and the adjustment of its contacts. Conventions are MuJoCo's: quaternions are
``w x y z``; a free joint moves linearly in the world and rotates in its body's frame; a
ball joint rotates in its body's frame.
"""

from __future__ import annotations

from physretarget.kinematics.pose import (
    Pose,
    forward,
    jacobian,
    points,
    rises,
    screws,
    trajectories,
)
from physretarget.kinematics.rotations import (
    continuous,
    matrix_to_quat,
    quat_conjugate,
    quat_multiply,
    quat_rotate,
    quat_to_matrix,
    quat_to_rotvec,
    rotvec_slope,
    rotvec_to_quat,
    slerp,
)
from physretarget.kinematics.runs import runs
from physretarget.kinematics.solver import PointTargets, Solution, attraction, solve, stiffness
from physretarget.kinematics.trajectory import Price, Trajectory, solve_trajectory
from physretarget.kinematics.tree import (
    Joint,
    StepSlopes,
    Tree,
    difference,
    difference_slopes,
    integrate,
)

__all__ = [
    "Joint",
    "PointTargets",
    "Pose",
    "Price",
    "Solution",
    "StepSlopes",
    "Trajectory",
    "Tree",
    "attraction",
    "continuous",
    "difference",
    "difference_slopes",
    "forward",
    "integrate",
    "jacobian",
    "matrix_to_quat",
    "points",
    "quat_conjugate",
    "quat_multiply",
    "quat_rotate",
    "quat_to_matrix",
    "quat_to_rotvec",
    "rises",
    "rotvec_slope",
    "rotvec_to_quat",
    "runs",
    "screws",
    "slerp",
    "solve",
    "solve_trajectory",
    "stiffness",
    "trajectories",
]
