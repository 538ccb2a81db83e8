"""Planners on motion problems: their free motions alone, timed and checked."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planning.collision.world import CollisionWorld, Situation, densified
from planning.motion.free import FreeMotion, MotionQuery, NoMotion, timed
from planning.motion.ik import solve_ik
from planning.motion.timing import FREE
from planning.pick_place.search import PickPlacePlanner
from planning.planner import Planner, make_planner
from planning.problem import JointTrajectory
from scenarios.bench.motions.problem import MotionProblem
from split_drake.bad_input import BadInputError
from split_drake.objects.rigid import Primitive
from split_drake.poses import Array, transform_points
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import gripper_pose

# Of the configurations that reach the goal, so many of the nearest are tried.
GOALS = 5
# What is held is a set of points so far apart.
HELD_STEP_M = 0.009
# The fingers around what is held: boxes and cylinders do not say where they are touched.
HELD_OPENING_M = 0.04
# A path is checked at steps of this size, finer than any planner's.
CHECK_STEP_RAD = 0.005
# Elementwise, of the goal's pose: configurations in files have few digits.
GOAL_TOLERANCE = 5e-3


@dataclass(frozen=True)
class MotionTask:
    """A motion problem in its world, made ready so that planning alone is timed.

    Attributes:
        problem: to be solved.
        world: of the problem.
        situation: what is in the hand.
    """

    problem: MotionProblem
    world: CollisionWorld
    situation: Situation

    @classmethod
    def of(cls, problem: MotionProblem) -> "MotionTask":
        """Return the task of a problem."""
        held = [surface_points(solid) for solid in problem.held.values()]
        situation = (
            Situation(HELD_OPENING_M, p_GHeld=np.concatenate(held))
            if held
            else Situation(MAX_OPENING_M)
        )
        return cls(problem, problem.world(), situation)

    def plan(self, motion: FreeMotion, rng: np.random.Generator) -> JointTrajectory | str:
        """Return a trajectory from the start to the goal pose, or why there is none."""
        q_start, world, situation = self.problem.q_start, self.world, self.situation
        if not world.free(q_start[None], situation)[0]:
            return "the start touches something"
        qs = self._goals()
        if not len(qs):
            return "no configuration that reaches the goal is free"
        reasons: list[str] = []
        for q_goal in qs[:GOALS]:
            path = motion(MotionQuery(world, q_start, q_goal, situation), rng)
            if not isinstance(path, NoMotion):
                return timed(world, path, situation, FREE)
            reasons.append(path.reason)
        return "; ".join(dict.fromkeys(reasons))

    def fault(self, trajectory: JointTrajectory) -> str:
        """Return what is wrong with a trajectory, "" for nothing."""
        problem, qs = self.problem, trajectory.qs
        if not np.allclose(qs[0], problem.q_start, atol=1e-6):
            return "it begins elsewhere"
        if not np.allclose(gripper_pose(qs[-1]), problem.X_WGoal, atol=GOAL_TOLERANCE):
            return "it ends elsewhere"
        if not self.world.free(densified(qs, CHECK_STEP_RAD), self.situation).all():
            return "it touches something"
        return ""

    def _goals(self) -> Array:
        """Return free configurations (K, 7) that reach the goal, the nearest first."""
        qs = self.problem.q_goals
        if not len(qs):
            qs = solve_ik(self.problem.X_WGoal[None]).qs
        if not len(qs):
            return qs
        qs = qs[self.world.free(qs, self.situation)]
        return qs[np.argsort(np.abs(qs - self.problem.q_start).max(axis=1), kind="stable")]


def motion_of(name: str) -> FreeMotion:
    """Return the free motions of a planner; raise BadInputError where it has none by itself."""
    planner: Planner = make_planner(name)
    if not isinstance(planner, PickPlacePlanner):
        raise BadInputError(
            f"--planner {name} has no free motions that could be asked for alone; expected one "
            "that is a PickPlacePlanner, such as default or rrt"
        )
    return planner.motion


def surface_points(solid: Primitive) -> Array:
    """Return points (N, 3) on a box or cylinder, `HELD_STEP_M` apart, in the frame of its pose."""
    make: Callable[[tuple[float, ...]], Array] = _on_box if solid.kind == "box" else _on_cylinder
    return transform_points(solid.X_OP, make(solid.size))


def _steps(length_m: float) -> Array:
    return np.linspace(-length_m / 2.0, length_m / 2.0, 2 + int(length_m / HELD_STEP_M))


def _on_box(size: tuple[float, ...]) -> Array:
    axes = [_steps(edge) for edge in size]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.any(np.isclose(np.abs(grid), np.array(size) / 2.0), axis=1)]


def _on_cylinder(size: tuple[float, ...]) -> Array:
    radius_m, length_m = size
    around = np.linspace(0.0, 2.0 * np.pi, 8 + int(2.0 * np.pi * radius_m / HELD_STEP_M))[:-1]
    rings = [(radius_m, z) for z in _steps(length_m)]
    for end in (-length_m / 2.0, length_m / 2.0):
        rings += [(r, end) for r in np.linspace(0.0, radius_m, 2 + int(radius_m / HELD_STEP_M))]
    circle = np.column_stack([np.cos(around), np.sin(around)])
    return np.concatenate(
        [np.column_stack([r * circle, np.full(len(circle), z)]) for r, z in rings]
    )
