"""The problems that ship for planners."""

import numpy as np

from planning.problem_files import load_problems
from split_drake.models_folder import MODELS_FOLDER


def test_varied_problems_differ_in_station_start_and_obstacles() -> None:
    problems = load_problems(MODELS_FOLDER / "problems" / "varied.npz")
    assert len(problems) == 116
    layouts = [problem.layout for problem in problems.values()]
    assert {layout.table_z_m for layout in layouts} == {0.0, 0.1}
    assert len({tuple(np.round(layout.X_WK[:3, 3], 3)) for layout in layouts}) == 3
    # Each start serves both tasks and both sources of poses.
    starts = {tuple(np.round(problem.q_start, 3)) for problem in problems.values()}
    assert len(starts) == 29
    assert all(
        problem.p_WObstacles is not None and len(problem.p_WObstacles) > 0
        for problem in problems.values()
    )
    assert {problem.subgoal.name for problem in problems.values()} == {"hang", "reorient"}
