"""What lies in a room is found as a file each: nothing is left out, and no name is taken twice."""

from collections.abc import Callable
from pathlib import Path

import pytest

from planning.checking.goal_checks import goal_check
from planning.planner import make_planner, planner_names
from planning.subgoal import find_subgoal
from tests.helpers.rooms import added_files

SUBGOAL = """
from planning.subgoal import Subgoal
from split_drake.pose_task import UPRIGHT
SUBGOAL = Subgoal("{name}", UPRIGHT, lambda query: [])
"""
CHECK = """
from planning.checking.goal_checks import GoalCheck
GOAL_CHECK = GoalCheck("{name}", lambda plan, problem: "elsewhere")
"""
PLANNER = """
from planning.planner import register_planner
@register_planner("{name}")
def planner(): return "{name}"
"""
ROOMS = {
    "planning.goals": (SUBGOAL, "hang", find_subgoal),
    "planning.checking.goals": (CHECK, "hang", goal_check),
    "planning.planners": (PLANNER, "rrt", make_planner),
}
Room = tuple[str, str, Callable[[str], object]]


@pytest.mark.parametrize("room", ROOMS)
def test_a_file_is_found_by_its_name_and_gone_after_the_test(room: str, tmp_path: Path) -> None:
    code, taken, find = ROOMS[room]
    with added_files(tmp_path, room, {"zz_throw": code.format(name="throw")}):
        assert "throw" in str(find("throw"))
        assert find(taken)
    with pytest.raises(ValueError, match="throw"):
        find("throw")


@pytest.mark.parametrize("room", ROOMS)
def test_a_file_without_what_the_room_is_of_is_an_error(room: str, tmp_path: Path) -> None:
    _, taken, find = ROOMS[room]
    with (
        added_files(tmp_path, room, {"zz_throw": "SUBGOALS = ()"}),
        pytest.raises(ValueError, match=r"zz_throw\.py (has no constant|registers no planner)"),
    ):
        find(taken)


@pytest.mark.parametrize("room", ROOMS)
def test_two_files_of_one_name_are_an_error_that_says_which(room: str, tmp_path: Path) -> None:
    code, taken, find = ROOMS[room]
    with (
        added_files(tmp_path, room, {"zz_again": code.format(name=taken)}),
        pytest.raises(ValueError, match=rf"{taken}.*zz_again"),
    ):
        find(taken)


def test_planners_of_any_make_are_registered(tmp_path: Path) -> None:
    code = """
from planning.pick_place.search import PickPlacePlanner
from planning.planner import register_planner
register_planner("elsewhere")(PickPlacePlanner)
"""
    with added_files(tmp_path, "planning.planners", {"zz_elsewhere": code}):
        assert "elsewhere" in planner_names()
