"""The search for a grasp that an arm can reach, take something with, and carry to the bin."""

from collections import Counter
from collections.abc import Iterator
from itertools import islice

import numpy as np

from planning.clearing.drop_plan import DropPlan, DropProblem
from planning.clearing.takings import Taking, TakingSearch
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.modes import distinct_modes
from planning.geometry.waypoints import with_half_turns
from planning.motion.free import MotionQuery, NoMotion, free_motion
from planning.motion.ik import solve_ik
from planning.motion.segment_builder import (
    SegmentBuilder,
    closing_segment,
    opening_segment,
    settled,
)
from planning.motion.timing import FEELING, FREE, LOADED
from planning.problem import PlanFailure, Segment, SegmentName, Stage
from split_drake.pose_task import GRASP
from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import same_fixtures

# Bounds of the search; the clock plays no part, so that the same seed gives the same plan.
MAX_GRASPS = 40
DROPS = 4
# How far what is seen of an object stays above the rim: it reaches lower where nothing was seen.
ABOVE_RIM_M = 0.06
YAWS_RAD = np.radians(np.arange(0.0, 360.0, 30.0))


class DropPlanner:
    """Plans drops; keeps the collision world of the layout that it planned for last."""

    def __init__(self) -> None:
        self._world: CollisionWorld | None = None

    def plan(self, problem: DropProblem, rng: np.random.Generator) -> DropPlan | PlanFailure:
        """Return a plan with the first grasp that has one, or what all were rejected by."""
        if not len(problem.grasps):
            return PlanFailure(Stage.PERCEPTION, "no grasp was detected")
        if self._world is None or not same_fixtures(problem.layout, self._world.layout):
            self._world = CollisionWorld(problem.layout)
        return _Search(self._world, problem, rng).first_plan()


class _Search:
    """One search, with its counts."""

    def __init__(
        self, world: CollisionWorld, problem: DropProblem, rng: np.random.Generator
    ) -> None:
        self._world = world
        self._problem = problem
        self._rng = rng
        self._takings = TakingSearch(world, problem.p_WPs)
        self._rejected: Counter[str] = self._takings.rejected

    def first_plan(self) -> DropPlan | PlanFailure:
        order = np.array(self._problem.tried_order)
        X_WGs = self._problem.grasps.X_WPs[order]
        modes = distinct_modes(X_WGs, MAX_GRASPS, GRASP.symmetry)
        turned = with_half_turns(X_WGs[modes])
        solutions = solve_ik(turned)
        for number, mode in enumerate(modes):
            for index in (number, number + len(modes)):
                for taking in self._takings.find(turned[index], solutions.of(index, Q_HOME)):
                    segments = self._segments(taking)
                    if segments is not None:
                        return DropPlan(int(order[mode]), turned[index], segments)
        counts = ", ".join(f"{name} {count}" for name, count in self._rejected.most_common())
        reason = f"none of {len(modes)} distinct grasps is feasible (rejected by: {counts})"
        return PlanFailure(Stage.PLANNING, reason, dict(self._rejected))

    def _segments(self, taking: Taking) -> tuple[Segment, ...] | None:
        """Return all segments, or None where a free motion is missing."""
        transit = self._motion(self._problem.q_start, taking.approach_qs[0], taking.before)
        if transit is None:
            return None
        for q_drop in self._drops(taking):
            transfer = self._motion(taking.lift_qs[-1], q_drop, taking.carrying)
            if transfer is None:
                continue
            home = self._motion(q_drop, self._world.layout.q_home, taking.emptied)
            if home is not None:
                return self._timed(taking, transit, transfer, home)
        self._rejected["no way to the bin"] += 1
        return None

    def _drops(self, taking: Taking) -> Iterator[Array]:
        """Yield configurations (7,) above the bin, the nearest to the lift's end first."""
        held = taking.carrying.p_GHeld
        assert held is not None  # that is what is carried
        height = np.array([0.0, 0.0, ABOVE_RIM_M + max(0.0, float(held[:, 2].max()))])
        p_WG = np.array(self._problem.bin.p_WRim) + height
        R_WGs = [rotation_x(np.pi) @ rotation_z(yaw) for yaw in YAWS_RAD]
        qs = solve_ik(np.stack([make_pose(R_WG, p_WG) for R_WG in R_WGs])).qs
        nearest = np.argsort(np.abs(qs - taking.lift_qs[-1]).max(axis=1), kind="stable")
        free = (q for q in qs[nearest] if self._world.free(q[None], taking.carrying)[0])
        yield from islice(free, DROPS)

    def _motion(self, q_start: Array, q_goal: Array, situation: Situation) -> Array | None:
        found = free_motion(MotionQuery(self._world, q_start, q_goal, situation), self._rng)
        if isinstance(found, NoMotion):
            self._rejected[found.reason] += 1
            return None
        return found

    def _timed(
        self, taking: Taking, transit: Array, transfer: Array, home: Array
    ) -> tuple[Segment, ...]:
        grip, fingers = SegmentBuilder(self._world), taking.grasping.allowed
        width_m, q_grasp = taking.carrying.opening_m, taking.approach_qs[-1]
        return (
            settled(grip.empty(SegmentName.TRANSIT, transit, FREE, taking.before)),
            grip.empty(
                SegmentName.APPROACH, taking.approach_qs, FEELING, taking.grasping, feel=True
            ),
            closing_segment(q_grasp, MAX_OPENING_M, width_m, fingers),
            grip.loaded(SegmentName.LIFT, taking.lift_qs, LOADED, taking.lifting),
            grip.loaded(SegmentName.TRANSFER, transfer, LOADED, taking.carrying),
            opening_segment(transfer[-1], MAX_OPENING_M, width_m, fingers),
            grip.empty(SegmentName.TRANSIT, home, FREE, taking.emptied),
        )
