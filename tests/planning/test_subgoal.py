"""Subgoals are found by name, and a new one is data: it is planned for, checked and kept."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planning import subgoal
from planning.checking import goal_checks
from planning.checking.goal_checks import GoalCheck, goal_check, register_goal_check
from planning.checking.goals.hang import off_peg
from planning.checking.goals.reorient import off_table
from planning.checking.plan_contract import contract_violations
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.goals.upright import upright_placements
from planning.planner import make_planner
from planning.problem import Plan, PlanningProblem
from planning.problem_files import load_problems, save_problems
from planning.subgoal import Subgoal, find_subgoal, register_subgoal, subgoals
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT, PoseTask, Symmetry
from split_drake.poses import make_pose, rotation_z
from tests.helpers.planning import LYING, mug_problem

AXIS = PoseTask("axis", Symmetry.any_turn("z"), "an object that stands: z up")
SET_ASIDE = Subgoal(name="set aside", task=AXIS, placements=upright_placements)


@pytest.fixture(autouse=True)
def _registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget after each test what it has registered."""
    monkeypatch.setattr(subgoal, "_REGISTERED", {})
    monkeypatch.setattr(goal_checks, "_REGISTERED", {})


def aside_problem() -> PlanningProblem:
    """Return the problem of a lying mug of which only grasps and the axis are known."""
    known = mug_problem(REORIENT, LYING)
    axis = PoseSet(AXIS, LYING[None], np.ones(1))
    return replace(
        known, subgoal=SET_ASIDE, pose_sets={"grasp": known.pose_sets["grasp"], "axis": axis}
    )


def test_subgoals_are_found_by_name() -> None:
    assert find_subgoal("hang") == HANG and find_subgoal("reorient") == REORIENT
    with pytest.raises(
        ValueError, match=r"unknown subgoal 'throw'; expected one of hang, .*reorient"
    ):
        find_subgoal("throw")


def test_a_registered_subgoal_is_found_and_its_name_taken() -> None:
    assert register_subgoal(SET_ASIDE) == find_subgoal("set aside") == SET_ASIDE
    assert {"hang", "reorient", "set aside"} <= set(subgoals())
    for taken in (SET_ASIDE, replace(SET_ASIDE, name="hang")):
        with pytest.raises(ValueError, match=f"'{taken}' is registered already"):
            register_subgoal(taken)


def test_a_subgoal_asks_for_what_it_and_the_one_before_it_need() -> None:
    assert HANG.tasks == (GRASP, HANDLE)
    assert HANG.perceived_tasks == (GRASP, HANDLE, UPRIGHT)
    assert REORIENT.perceived_tasks == REORIENT.tasks == (GRASP, UPRIGHT)
    assert replace(SET_ASIDE, first=HANG).perceived_tasks == (GRASP, AXIS, HANDLE, UPRIGHT)


def test_a_chain_of_subgoals_has_each_name_once() -> None:
    aside = replace(SET_ASIDE, first=HANG)
    assert aside.chain == (aside, HANG, REORIENT)
    with pytest.raises(ValueError, match="reorient -> set aside -> hang -> reorient"):
        replace(REORIENT, first=aside)


def test_a_problem_without_the_subgoals_pose_sets_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"set aside needs .*missing \['axis'\]"):
        replace(mug_problem(REORIENT, LYING), subgoal=SET_ASIDE)


def test_a_subgoal_of_ones_own_is_planned_for_and_checked() -> None:
    problem = aside_problem()
    plan = make_planner("default").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan), plan
    with pytest.raises(ValueError, match="nothing says where plans to set aside must end"):
        contract_violations(plan, problem)
    register_goal_check(GoalCheck("set aside", off_table))
    assert goal_check("set aside").off_goal is off_table
    assert contract_violations(plan, problem) == []
    turn = make_pose(rotation_z(2.0))
    turned = replace(plan, X_WObject=plan.X_WObject @ turn, X_WGoal=plan.X_WGoal @ turn)
    assert contract_violations(turned, problem) == [], "any turn about the axis means the same"


def test_the_checks_that_ship_are_found_by_their_subgoals() -> None:
    assert goal_check("hang").off_goal is off_peg
    assert goal_check("reorient").off_goal is off_table


def test_where_plans_to_a_subgoal_must_end_is_said_once() -> None:
    with pytest.raises(ValueError, match="a check of where plans to hang end already"):
        register_goal_check(GoalCheck("hang", off_table))
    register_goal_check(GoalCheck("set aside", off_table))
    with pytest.raises(ValueError, match="a check of where plans to set aside end already"):
        register_goal_check(GoalCheck("set aside", off_table))


def test_problems_of_a_registered_subgoal_come_back_from_disk(tmp_path: Path) -> None:
    register_subgoal(SET_ASIDE)
    save_problems(tmp_path / "p.npz", {"aside": aside_problem()})
    loaded = load_problems(tmp_path / "p.npz")["aside"]
    assert loaded.subgoal == SET_ASIDE and loaded.pose_sets["axis"].task == AXIS


def test_subgoals_are_the_same_in_another_process() -> None:
    for goal in (HANG, REORIENT):
        again = pickle.loads(pickle.dumps(goal))
        assert again == goal
        assert hash(again) == hash(goal)
