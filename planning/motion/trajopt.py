"""Trajectory optimization: smooth motions around the static station.

Drake's KinematicTrajectoryOptimization shapes a B-spline between two configurations; its collision
constraint knows the robot, table and hook, so the caller still checks against the object.
"""

import numpy as np
from pydrake.multibody.inverse_kinematics import MinimumDistanceLowerBoundConstraint
from pydrake.planning import CollisionChecker, KinematicTrajectoryOptimization
from pydrake.solvers import SnoptSolver, SolutionResult, SolverOptions
from pydrake.trajectories import BsplineTrajectory

from split_drake.poses import Array
from split_drake.robot.kinematics import LIMIT_MARGIN_RAD
from split_drake.robot.panda import arm_limits, panda_positions

CONTROL_POINTS = 12
# Where along the path the distance to the station is constrained, and what it must be.
CONSTRAINED_SHARES = np.linspace(0.08, 0.92, 15)
MIN_DISTANCE_M = 0.02
INFLUENCE_M = 0.03
PATH_SAMPLES = 40
# An unfinished optimization may have improved the path already; the caller checks it anyway.
_USABLE = (SolutionResult.kSolutionFound, SolutionResult.kIterationLimit)
MAX_ITERATIONS = 40


def optimize_path(checker: CollisionChecker, qs: Array, opening_m: float) -> Array | None:
    """Return a shorter, smooth path (M, 7) with the ends of the path `qs` (N, 7), or None.

    Args:
        checker: of the robot against the static station.
        qs: joint angles of the path that the optimization starts from, rad.
        opening_m: distance between the pads.
    """
    guess = [panda_positions(q, opening_m) for q in _resampled(qs, CONTROL_POINTS)]
    ends = [guess[0], guess[-1]]
    optimization = KinematicTrajectoryOptimization(9, CONTROL_POINTS)
    _add_limits(optimization, opening_m)
    for share, q in zip((0.0, 1.0), ends, strict=True):
        optimization.AddPathPositionConstraint(q, q, share)
    optimization.SetInitialGuess(
        BsplineTrajectory(optimization.basis(), [q[:, None] for q in guess])
    )
    optimization.AddPathEnergyCost(1.0)
    context = checker.MakeStandaloneModelContext()
    clear = MinimumDistanceLowerBoundConstraint(checker, MIN_DISTANCE_M, context, None, INFLUENCE_M)
    for share in CONSTRAINED_SHARES:
        optimization.AddPathPositionConstraint(clear, share)
    options = SolverOptions()
    options.SetOption(SnoptSolver.id(), "Major iterations limit", MAX_ITERATIONS)
    result = SnoptSolver().Solve(optimization.prog(), None, options)
    if result.get_solution_result() not in _USABLE:
        return None
    trajectory = optimization.ReconstructTrajectory(result)
    times = np.linspace(trajectory.start_time(), trajectory.end_time(), PATH_SAMPLES)
    path = trajectory.vector_values(times).T[:, :7]
    path[0], path[-1] = qs[0], qs[-1]
    return path


def _resampled(qs: Array, count: int) -> Array:
    """Return (count, 7) points at equal distances along a path (N, 7)."""
    lengths = np.linalg.norm(np.diff(qs, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    shares = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(shares, along, joint) for joint in qs.T])


def _add_limits(optimization: KinematicTrajectoryOptimization, opening_m: float) -> None:
    limits = arm_limits()
    fingers = np.full(2, opening_m / 2.0)
    optimization.AddPositionBounds(
        np.concatenate([limits.q_lower + LIMIT_MARGIN_RAD / 2.0, fingers]),
        np.concatenate([limits.q_upper - LIMIT_MARGIN_RAD / 2.0, fingers]),
    )
    optimization.AddDurationConstraint(1.0, 1.0)
