"""Poses that no arm reaches are skipped before the search, and the reason says how far they are."""

from dataclasses import replace

import numpy as np
import pytest

from planning.goals.hang import SUBGOAL as HANG
from planning.pick_place.reach import within_reach
from planning.planner import make_planner
from planning.problem import Plan, PlanFailure, PlanningProblem, Stage
from split_drake.pose_set import PoseSet
from split_drake.poses import make_pose
from split_drake.robot.kinematics import REACH_M, gripper_poses, shoulder_distances
from split_drake.robot.panda import arm_limits
from tests.helpers.planning import STANDING, mug_problem

FAR = make_pose(p=(100.0, 0.0, 0.0))


def moved(problem: PlanningProblem, *names: str) -> PlanningProblem:
    """Return the problem with all poses of these tasks 100 m off."""
    sets = {n: s.moved(FAR) if n in names else s for n, s in problem.pose_sets.items()}
    return replace(problem, pose_sets=sets)


def test_no_configuration_reaches_further() -> None:
    limits, rng = arm_limits(), np.random.default_rng(0)
    qs = rng.uniform(limits.q_lower, limits.q_upper, (20_000, 7))
    distances = shoulder_distances(gripper_poses(qs)[:, :3, 3])
    assert 0.8 * REACH_M < distances.max() <= REACH_M


@pytest.mark.parametrize(
    ("names", "told"), [(("grasp", "handle", "upright"), "grasp"), (("handle",), "handle")]
)
def test_far_poses_are_told_with_their_distance(names: tuple[str, ...], told: str) -> None:
    problem = moved(mug_problem(HANG, STANDING), *names)
    outcome = make_planner("default").plan(problem, np.random.default_rng(0))
    assert isinstance(outcome, PlanFailure)
    assert outcome.stage is Stage.PLANNING
    count = len(problem.pose_sets[told])
    assert f"all {count} {told} poses are out of the arm's reach: the nearest is 100." in (
        outcome.reason
    )
    assert f"the arm reaches {REACH_M:.2f} m" in outcome.reason
    assert not outcome.statistics, "nothing was searched"


def test_poses_within_reach_are_planned_with_as_if_there_were_no_others() -> None:
    problem = mug_problem(HANG, STANDING)
    sets = {
        name: PoseSet(
            found.task,
            np.concatenate([found.X_WPs, FAR @ found.X_WPs]),
            np.concatenate([found.scores, np.full(len(found), found.scores.min(initial=1.0))]),
        )
        for name, found in problem.pose_sets.items()
    }
    plans = [
        make_planner("default").plan(each, np.random.default_rng(0))
        for each in (problem, replace(problem, pose_sets=sets))
    ]
    alone, among = plans
    assert isinstance(alone, Plan) and isinstance(among, Plan)
    np.testing.assert_array_equal(alone.X_WGrasp, among.X_WGrasp)
    np.testing.assert_array_equal(alone.X_WGplace, among.X_WGplace)


def test_a_problem_within_reach_is_left_as_it_is() -> None:
    problem = mug_problem(HANG, STANDING)
    near = within_reach(problem)
    assert isinstance(near, PlanningProblem)
    assert all(near.pose_sets[name] is found for name, found in problem.pose_sets.items())
