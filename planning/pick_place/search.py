"""The default planner: lazily searched pairs of picks and places, joined by free motions."""

from collections import Counter
from dataclasses import replace

import numpy as np

from planning.collision.exemptions import clear_of_palm
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.focus import filled_down
from planning.geometry.modes import away_from
from planning.geometry.perceived import PerceivedObject, best_upright
from planning.geometry.waypoints import (
    LINE_STEP_M,
    backed_off,
    place_grasp,
    shifted,
    straight_line,
)
from planning.motion.free import FreeMotion, MotionQuery, NoMotion, free_motion
from planning.motion.ik import DrakeIk, IkSolutions, follow, solve_ik
from planning.pick_place.candidates import Candidates
from planning.pick_place.pairs import BestPairs
from planning.pick_place.pick import Pick, PickSearch, held_pick
from planning.pick_place.place import Place, PlaceSearch
from planning.pick_place.reach import within_reach
from planning.pick_place.segments import Route, moves_after, plan_segments, shortened
from planning.pick_place.turned_grasps import turned_grasps
from planning.problem import Plan, PlanFailure, PlanningProblem, Stage
from planning.subgoal import Placement, PlacementQuery
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, Symmetry
from split_drake.poses import Array
from split_drake.robot.kinematics import gripper_pose
from split_drake.station.layout import Layout, same_fixtures

# Bounds of the search; the clock plays no part, so that the same seed gives the same plan.
MAX_PAIRS = 6000
MAX_PLACES = 1500
MAX_ROUTES = 12
# Configurations tried for one placement: many pairs are tried, but few with one object in the hand.
CONFIGURATIONS, HELD_CONFIGURATIONS = 3, 12
# How far the hand backs off further once the object hangs, as far as that is possible.
WITHDRAWALS_M = (0.15, 0.10, 0.05)


class PickPlacePlanner:
    """Plans a pick and place from pose sets, the cloud and the static layout.

    Args:
        motion: joins the straight lines of pick and place.
    """

    def __init__(self, motion: FreeMotion = free_motion) -> None:
        self._free_motion = motion
        self._ik = DrakeIk()
        self._world: CollisionWorld | None = None

    @property
    def motion(self) -> FreeMotion:
        """What joins its straight lines."""
        return self._free_motion

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        """Return a plan, or the counts of what candidates were rejected by."""
        if not len(problem.pose_sets[GRASP.name]):
            return PlanFailure(Stage.PERCEPTION, "no grasp was detected")
        near = within_reach(problem)
        return near if isinstance(near, PlanFailure) else self._plan_near(near, rng)

    def _plan_near(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        grasps = problem.pose_sets[GRASP.name]
        X_WU = best_upright(problem.pose_sets)
        table_z_m = problem.layout.table_z_m
        target = PerceivedObject.from_cloud(problem.p_WPs, X_WU, table_z_m)
        if problem.held_width_m is not None:
            off_palm = clear_of_palm(gripper_pose(problem.q_start), target.p_WObstacles)
            target = replace(target, p_WObstacles=target.p_WObstacles[off_palm])
        goals = problem.subgoal.placements(
            PlacementQuery(
                problem.pose_sets[problem.subgoal.task.name],
                target,
                problem.layout,
                in_hand=problem.held_width_m is not None,
            )
        )
        if not goals:
            return PlanFailure(Stage.PERCEPTION, f"no goal for {problem.subgoal} was detected")
        obstacles = filled_down(problem.p_WObstacles, table_z_m)
        world = self._world_of(problem.layout).among(obstacles)
        search = _Search(world, self._ik, self._free_motion, problem, target, goals, rng)
        if problem.held_width_m is not None:
            return search.place_held(problem.held_width_m)
        outcome = search.try_grasps(grasps, target.p_WDetails)
        if isinstance(outcome, Plan) or X_WU is None:
            return outcome
        more = turned_grasps(grasps, X_WU, target.p_WSurface, table_z_m)
        turned = search.try_grasps(more, target.p_WSurface)
        counts = Counter(outcome.statistics)
        counts.update(turned.statistics)
        if isinstance(turned, Plan):
            return replace(turned, statistics=dict(counts))
        reason = f"{outcome.reason}; turned about the axis, {turned.reason}"
        return replace(turned, reason=reason, statistics=dict(counts))

    def _world_of(self, layout: Layout) -> CollisionWorld:
        if self._world is None or not same_fixtures(layout, self._world.layout):
            self._world = CollisionWorld(layout)
        return self._world


class _Search:
    """One search, with its counts."""

    def __init__(
        self,
        world: CollisionWorld,
        ik: DrakeIk,
        motion: FreeMotion,
        problem: PlanningProblem,
        target: PerceivedObject,
        goals: list[Placement],
        rng: np.random.Generator,
    ) -> None:
        self._world = world
        self._free_motion = motion
        self._problem = problem
        self._target = target
        self._goals = goals
        self._rng = rng
        self._picks = PickSearch(world, target, ik)
        self._places = PlaceSearch(world, target)
        self._candidates: Candidates | None = None
        self._found: dict[int, tuple[Pick, IkSolutions]] = {}
        self._counts: Counter[str] = Counter()

    def place_held(self, held_width_m: float) -> Plan | PlanFailure:
        """Return a plan for an object that is in the hand already."""
        pick = held_pick(self._problem.q_start, held_width_m, self._target)
        self._found = {0: (pick, self._solve_goals(pick))}
        return self._first_plan(BestPairs([1.0], [goal.score for goal in self._goals]))

    def try_grasps(self, grasps: PoseSet, p_WSurface: Array) -> Plan | PlanFailure:
        """Return a plan with one of the grasps, fitted to the surface's points (M, 3)."""
        self._found, self._counts = {}, Counter()
        self._picks.rejected.clear()
        self._places.rejected.clear()
        untried = grasps.subset(away_from(grasps.X_WPs, self._problem.X_WGfailed, GRASP.symmetry))
        if not len(grasps):
            return PlanFailure(Stage.PLANNING, "no grasp is in reach")
        if not len(untried):
            return PlanFailure(Stage.PLANNING, "no grasp is left that is unlike those that failed")
        self._candidates = candidates = Candidates(untried, self._target, p_WSurface)
        goal_scores = [goal.score for goal in self._goals]
        return self._first_plan(BestPairs(candidates.bounds, goal_scores, candidates.score))

    def _first_plan(self, pairs: BestPairs) -> Plan | PlanFailure:
        for row, column in pairs:
            self._counts["pairs"] += 1
            if row not in self._found and not self._find_pick(row):
                pairs.drop_row(row)
                continue
            plan = self._try(row, column)
            if plan is not None:
                return plan
            if self._spent():
                break
        return PlanFailure(Stage.PLANNING, self._reason(), self._statistics())

    def _find_pick(self, row: int) -> bool:
        """Return whether a grasp can be picked by; what is in the hand is found from the start."""
        if self._candidates is None:
            return False
        self._counts["grasps"] += 1
        pick = self._picks.find(*self._candidates.at(row))
        if pick is not None:
            self._found[row] = (pick, self._solve_goals(pick))
        return pick is not None

    def _solve_goals(self, pick: Pick) -> IkSolutions:
        return solve_ik(
            np.stack([place_grasp(goal.X_WOgoal, goal.X_WO, pick.X_WG) for goal in self._goals])
        )

    def _try(self, row: int, column: int) -> Plan | None:
        pick, solutions = self._found[row]
        qs = solutions.of(column, pick.lift_qs[-1])
        self._counts["places"] += len(qs) > 0
        held = self._problem.held_width_m is not None
        qs = qs[: HELD_CONFIGURATIONS if held else CONFIGURATIONS]
        place = self._places.find(pick, self._goals[column], qs)
        if place is None or self._failed_before(place):
            return None
        self._counts["routes"] += 1
        goal = place.placement
        route = self._route(pick, place)
        if route is None:
            return None
        segments = plan_segments(self._world, self._target, pick, place, route)
        still_after_s = self._problem.subgoal.still_after_s
        if still_after_s is not None:
            segments = shortened(segments, still_after_s)
            if moves_after(segments, still_after_s):
                self._places.rejected["slow retreat"] += 1
                return None
        return Plan(
            subgoal=self._problem.subgoal,
            segments=segments,
            X_WGrasp=pick.X_WG,
            X_WGplace=place.X_WG,
            X_WObject=goal.X_WO,
            X_WGoal=shifted(goal.X_WOgoal, (0.0, 0.0, goal.lower_to_m)),
            statistics=self._statistics(),
        )

    def _failed_before(self, place: Place) -> bool:
        """Return whether an object in the hand was let go in vain where it would be again."""
        if self._problem.held_width_m is None:
            return False
        failed = not away_from(place.X_WG[None], self._problem.X_WGfailed, Symmetry()).all()
        self._places.rejected["failed before"] += failed
        return failed

    def _route(self, pick: Pick, place: Place) -> Route | None:
        """Return the motions between the straight lines, or None where one is missing."""
        held = Situation(pick.held_width_m, p_GHeld=pick.held(self._target.p_WObstacles))
        transfer = self._motion(pick.lift_qs[-1], place.insert_qs[0], held)
        if transfer is None:
            return None
        transit = None
        if self._problem.held_width_m is None:
            before = Situation(pick.opening_m, p_WStanding=self._target.p_WObstacles)
            transit = self._motion(self._problem.q_start, pick.approach_qs[0], before)
            if transit is None:
                return None
        after = Situation(pick.release_m, p_WStanding=place.p_WReleased)
        if not self._problem.subgoal.goes_home:
            return Route(transit, transfer, self._withdrawal(place.retreat_qs[-1], after))
        home = self._motion(place.retreat_qs[-1], self._world.layout.q_home, after)
        return None if home is None else Route(transit, transfer, home)

    def _withdrawal(self, q: Array, after: Situation) -> Array | None:
        """Return (N, 7) straight on back from the hook, out of reach of a swinging object."""
        X_WG = gripper_pose(q)
        for distance in WITHDRAWALS_M:
            back = follow(q, straight_line(X_WG, backed_off(X_WG, distance), LINE_STEP_M))
            if back is not None:
                path = np.concatenate([q[None], back])
                if self._world.path_free(path, after):
                    return path
        return None

    def _motion(self, q_start: Array, q_goal: Array, situation: Situation) -> Array | None:
        query = MotionQuery(self._world, q_start, q_goal, situation)
        path = self._free_motion(query, self._rng)
        if isinstance(path, NoMotion):
            self._places.rejected[path.reason] += 1
            return None
        return path

    def _spent(self) -> bool:
        return (
            self._counts["pairs"] >= MAX_PAIRS
            or self._counts["places"] >= MAX_PLACES
            or self._counts["routes"] >= MAX_ROUTES
        )

    def _statistics(self) -> dict[str, float]:
        return {name: float(count) for name, count in self._counts.items()}

    def _reason(self) -> str:
        kind = self._problem.subgoal.goal_noun
        if self._problem.held_width_m is not None:
            rejected = _listed(self._places.rejected)
            return f"none of {len(self._goals)} {kind} is feasible (rejected by: {rejected})"
        return (
            f"{len(self._found)} of {self._counts['grasps']} grasps feasible"
            f" (rejected by: {_listed(self._picks.rejected)}); {self._counts['pairs']} pairs with"
            f" {len(self._goals)} {kind} (rejected by: {_listed(self._places.rejected)})"
        )


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.most_common()) or "nothing"
