"""RRT-Connect by OMPL, seeded and bounded by iterations, with shortcuts."""

from collections.abc import Callable

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from split_drake.poses import Array
from split_drake.robot.kinematics import LIMIT_MARGIN_RAD
from split_drake.robot.panda import arm_limits

# OMPL reports an error whenever it is seeded again, though a new seed acts on all planners made
# after it; whether a plan was found is read from the solution.
ou.setLogLevel(ou.LOG_NONE)

MAX_ITERATIONS = 600
MAX_EXTENSION_RAD = 1.2
SHORTCUTS = 40

EdgeFree = Callable[[Array], bool]


def rrt_connect(
    q_start: Array, q_goal: Array, path_free: EdgeFree, rng: np.random.Generator
) -> Array | None:
    """Return a path (N, 7) of straight joint motions, or None after `MAX_ITERATIONS`.

    Args:
        q_start, q_goal: (7,) joint angles, rad.
        path_free: whether the straight motions through a path (M, 7) are free.
        rng: seeds OMPL and draws the shortcuts.
    """
    if not (path_free(q_start[None]) and path_free(q_goal[None])):
        return None
    ou.RNG.setSeed(int(rng.integers(1, 2**31 - 1)))
    space = _joint_space()
    setup = og.SimpleSetup(space)
    information = setup.getSpaceInformation()
    setup.setStateValidityChecker(lambda state: path_free(_array(state)[None]))
    validator = _MotionValidator(information, path_free)
    information.setMotionValidator(validator)
    planner = og.RRTConnect(information)
    planner.setRange(MAX_EXTENSION_RAD)
    setup.setPlanner(planner)
    setup.setStartAndGoalStates(_state(space, q_start), _state(space, q_goal))
    setup.setup()
    setup.solve(_stop_after(MAX_ITERATIONS))
    if not setup.haveExactSolutionPath():
        return None
    states = setup.getSolutionPath().getStates()
    return shortcut(np.stack([_array(state) for state in states]), path_free, rng)


def shortcut(qs: Array, path_free: EdgeFree, rng: np.random.Generator) -> Array:
    """Return the path (M, 7) with detours between random points on it cut off where free."""
    path = qs
    for _ in range(SHORTCUTS):
        if len(path) < 3:
            break
        (i, a), (j, b) = sorted(_point_on(path, share) for share in rng.random(2))
        if i == j:
            continue
        ends = np.stack([_between(path, i, a), _between(path, j, b)])
        if path_free(ends):
            path = np.concatenate([path[: i + 1], ends, path[j + 1 :]])
    return path


def _point_on(path: Array, share: float) -> tuple[int, float]:
    """Return the piece of the path, and the share of that piece, at `share` of its length."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    ends = np.cumsum(lengths)
    piece = min(int(np.searchsorted(ends, share * ends[-1])), len(lengths) - 1)
    before = ends[piece] - lengths[piece]
    return piece, float((share * ends[-1] - before) / max(lengths[piece], 1e-12))


def _between(path: Array, piece: int, share: float) -> Array:
    return np.asarray(path[piece] + share * (path[piece + 1] - path[piece]))


def _joint_space() -> ob.RealVectorStateSpace:
    space, limits = ob.RealVectorStateSpace(7), arm_limits()
    bounds = ob.RealVectorBounds(7)
    for joint in range(7):
        bounds.setLow(joint, float(limits.q_lower[joint]) + LIMIT_MARGIN_RAD / 2.0)
        bounds.setHigh(joint, float(limits.q_upper[joint]) - LIMIT_MARGIN_RAD / 2.0)
    space.setBounds(bounds)
    return space


def _stop_after(iterations: int) -> ob.PlannerTerminationCondition:
    """Return a condition that holds after so many evaluations: one an iteration of the planner."""
    count = 0

    def stop() -> bool:
        nonlocal count
        count += 1
        return count > iterations

    return ob.PlannerTerminationCondition(stop)


def _state(space: ob.RealVectorStateSpace, q: Array) -> ob.State:
    state = space.allocState()
    for joint in range(7):
        state[joint] = float(q[joint])
    return state


def _array(state: ob.State) -> Array:
    return np.array([state[joint] for joint in range(7)])


class _MotionValidator(ob.MotionValidator):
    """Checks a whole straight motion at once."""

    def __init__(self, information: ob.SpaceInformation, path_free: EdgeFree) -> None:
        super().__init__(information)
        self._path_free = path_free

    def checkMotion(self, start: ob.State, end: ob.State, *_: object) -> bool:
        return self._path_free(np.stack([_array(start), _array(end)]))
