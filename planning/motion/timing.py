"""Time-optimal timing of joint paths by Drake's Toppra, within a share of the arm's limits."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from pydrake.multibody.optimization import Toppra
from pydrake.multibody.plant import MultibodyPlant
from pydrake.trajectories import PathParameterizedTrajectory, PiecewisePolynomial

from planning.collision.world import densified
from planning.problem import SAMPLE_S, JointTrajectory
from split_drake.poses import Array
from split_drake.robot.panda import add_panda, arm_limits

# Paths are interpolated through points this close, so that corners are rounded only within it.
KNOT_STEP_RAD = 0.05
# Toppra sees the limits at the points of its grid, evenly spaced: with fewer of them it drives
# around the corners of long paths at up to 26 times its acceleration limit.  A finer grid is taken
# where the last one leaves a corner that is driven at more than `SHARPEST` times the arm's limit.
GRID_POINTS_PER_KNOT = (8, 16, 32)
SHARPEST = 1.0
# Knots closer than this are merged: the curvature between them would mean nothing.
MIN_KNOT_STEP_RAD = 1e-3
# Less than this is no motion: Toppra ends the process over it.
LEAST_MOTION_RAD = 1e-6
# A path that turns on the spot makes Toppra crawl through the turn; no real motion takes this long.
LONGEST_S = 60.0


@dataclass(frozen=True)
class Speed:
    """Shares of the arm's limits, in (0, 1]."""

    velocity: float
    acceleration: float


FREE = Speed(0.7, 0.4)
LOADED = Speed(0.4, 0.25)
CAREFUL = Speed(0.25, 0.2)
# Out of an object that was just let go: slow enough for the arm to feel it, not its own inertia.
RETREATING = Speed(0.12, 0.05)
FEELING = Speed(0.02, 0.05)


def time_path(qs: Array, speed: Speed) -> JointTrajectory:
    """Return the path through `qs` (N, 7), from rest to rest, sampled every 10 ms.

    The arm stops at every corner of a path that turns too sharply to be driven through.

    Raises RuntimeError where Toppra finds no timing for a straight path, which limits that are all
    positive exclude.
    """
    knots = _knots(np.asarray(qs, dtype=float))
    if len(knots) < 2:
        return rest(knots[0], SAMPLE_S)
    for grid_points in GRID_POINTS_PER_KNOT:
        smooth = _smooth_timing(knots, speed, grid_points)
        if smooth is None:
            break
        sampled = _sampled(smooth)
        if len(qs) == 2 or _sharpest(sampled) < SHARPEST:
            return sampled
    if len(qs) == 2:
        raise RuntimeError(f"Toppra found no timing from {qs[0]} to {qs[1]}")
    return join([time_path(qs[i : i + 2], speed) for i in range(len(qs) - 1)])


def _knots(qs: Array) -> Array:
    """Return points (M, 7) along the path, close to each other but no two of them the same."""
    dense = densified(qs, KNOT_STEP_RAD)
    kept = [dense[0]]
    for q in dense[1:]:
        if np.abs(q - kept[-1]).max() > MIN_KNOT_STEP_RAD:
            kept.append(q)
    if len(kept) > 1:
        kept[-1] = dense[-1]
    elif np.abs(dense[-1] - dense[0]).max() > LEAST_MOTION_RAD:
        kept.append(dense[-1])
    return np.stack(kept)


def _sharpest(trajectory: JointTrajectory) -> float:
    """Return the largest share of the arm's limit that a joint's acceleration is."""
    moved = np.diff(trajectory.qs, axis=0) / SAMPLE_S
    changed = np.diff(np.pad(moved, ((1, 1), (0, 0))), axis=0) / SAMPLE_S
    return float((np.abs(changed).max(axis=0) / arm_limits().a_max).max())


def _smooth_timing(
    knots: Array, speed: Speed, grid_points: int
) -> PathParameterizedTrajectory | None:
    """Return the fastest drive through knots (M, 7) without a stop, or None.

    Args:
        grid_points: for each knot, where the limits are seen.
    """
    if len(knots) == 2:
        knots = np.stack([knots[0], knots.mean(axis=0), knots[1]])
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    fingers = np.zeros((len(knots), 2))
    path = PiecewisePolynomial.CubicShapePreserving(lengths, np.hstack([knots, fingers]).T)
    grid = np.linspace(0.0, lengths[-1], grid_points * len(knots))
    toppra = Toppra(path, _plant(), grid)
    limits = arm_limits()
    toppra.AddJointVelocityLimit(*_bounds(speed.velocity * limits.v_max))
    toppra.AddJointAccelerationLimit(*_bounds(speed.acceleration * limits.a_max))
    timing = toppra.SolvePathParameterization()
    if timing is None or not timing.end_time() < LONGEST_S:
        return None
    return PathParameterizedTrajectory(path, timing)


def rest(q: Array, duration_s: float) -> JointTrajectory:
    """Return a trajectory that stays at `q` (7,)."""
    count = max(2, 1 + round(duration_s / SAMPLE_S))
    qs = np.tile(np.asarray(q, dtype=np.float64), (count, 1))
    return JointTrajectory(_sample_times(count), qs, np.zeros((count, 7)))


def join(pieces: Sequence[JointTrajectory]) -> JointTrajectory:
    """Return trajectories from rest to rest, each starting where the last one ends, as one."""
    times, qs, vs = [pieces[0].times_s], [pieces[0].qs], [pieces[0].vs]
    for piece in pieces[1:]:
        times.append(times[-1][-1] + piece.times_s[1:])
        qs.append(piece.qs[1:])
        vs.append(piece.vs[1:])
    return JointTrajectory(np.concatenate(times), np.concatenate(qs), np.concatenate(vs))


def _sample_times(count: int) -> Array:
    return np.arange(count, dtype=np.float64) * SAMPLE_S


def _bounds(maximum: Array) -> tuple[Array, Array]:
    """Return lower and upper limits of arm and fingers, which stay where they are."""
    upper = np.concatenate([maximum, np.ones(2)])
    return -upper, upper


def _sampled(trajectory: PathParameterizedTrajectory) -> JointTrajectory:
    end_s = trajectory.end_time()
    count = max(2, 1 + int(np.ceil(end_s / SAMPLE_S)))
    times = np.minimum(SAMPLE_S * np.arange(count), end_s)
    qs = trajectory.vector_values(times).T[:, :7]
    vs = np.stack([trajectory.EvalDerivative(t).reshape(-1)[:7] for t in times])
    vs[[0, -1]] = 0.0
    return JointTrajectory(_sample_times(count), qs, vs)


@cache
def _plant() -> MultibodyPlant:
    plant = MultibodyPlant(time_step=0.001)
    add_panda(plant)
    plant.Finalize()
    return plant
