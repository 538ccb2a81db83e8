"""The planner bench: small problems from file to table, what is refused, and what is measured."""

import json
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from planning import subgoal
from planning.checking import goal_checks
from planning.checking.goal_checks import goal_check, register_goal_check
from planning.collision.world import static_checker
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.motion.timing import rest
from planning.planner import Planner, make_planner
from planning.problem import (
    JointTrajectory,
    Plan,
    PlanFailure,
    PlanningProblem,
    Segment,
    SegmentName,
    Stage,
)
from planning.problem_files import save_problems
from planning.subgoal import register_subgoal
from scenarios.bench import records as bench_records
from scenarios.bench.plan_measures import FARTHEST_M, PlanMeter, rms_jerk
from scenarios.bench.records import (
    ERROR,
    REFUSED,
    BenchTask,
    bench_run,
    run_planner,
    run_task,
)
from scenarios.planner_bench import BenchOptions, main, subgoals_of
from split_drake.experiments.run import json_line
from split_drake.poses import Array, make_pose, rotation_x
from split_drake.robot.kinematics import closed_form_ik
from split_drake.robot.panda import panda_positions
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout
from tests.helpers.planning import LYING, STANDING, mug_problem

SEED = (0, 0)


class Fixed:
    """A planner with one answer."""

    def __init__(self, answer: Plan | PlanFailure | Exception) -> None:
        self._answer = answer

    def plan(self, problem: PlanningProblem, rng: np.random.Generator) -> Plan | PlanFailure:
        if isinstance(self._answer, Exception):
            raise self._answer
        return self._answer


def resting(q: Array) -> Plan:
    """Return a plan that only stays at `q` (7,), far from any object."""
    transit = Segment(SegmentName.TRANSIT, rest(q, 0.1), 0.04, 0.04, 20.0, holding=False)
    return Plan(HANG, (transit,), *np.eye(4)[None].repeat(4, axis=0))


def test_three_problems_from_file_to_table_and_on(tmp_path: Path) -> None:
    far = make_pose(p=(1.4, 0.0, 0.0))
    problems = {
        "hang": mug_problem(HANG, STANDING),
        "reorient": mug_problem(REORIENT, LYING),
        "far": mug_problem(HANG, far),
    }
    file, out = tmp_path / "problems.npz", tmp_path / "run"
    save_problems(file, problems)
    main(BenchOptions(planner=("rrt",), problems=file, limit=1, out=out))
    with (out / "results.jsonl").open("a") as log:
        log.write('{"problem":"cut o')
    main(BenchOptions(planner=("rrt", "gcs"), problems=file, out=out))
    records = bench_run(out).records()
    found = {(r.problem, r.planner): r.outcome for r in records}
    assert len(records) == len(found) == 6
    assert {outcome for (name, _), outcome in found.items() if name != "far"} == {"solved"}
    assert found["far", "rrt"] == found["far", "gcs"] == "planning"
    summary = json.loads((out / "summary.json").read_text())
    assert 'id="problem-' in (out / "index.html").read_text()
    assert summary["planners"]["rrt"]["solved"] == {"successes": 2, "trials": 3}
    assert summary["planners"]["gcs"]["failures"] == {"planning": 1}
    assert summary["planners"]["gcs"]["groups"] == {
        "hang-unnumbered": {"successes": 1, "trials": 2},
        "reorient-unnumbered": {"successes": 1, "trials": 1},
    }
    assert summary["pairs"][0]["mcnemar_p"] == 1.0
    main(BenchOptions(planner=("rrt",), problems=file, limit=1, out=out))
    limited = json.loads((out / "summary.json").read_text())
    assert {name: s["solved"]["trials"] for name, s in limited["planners"].items()} == {"rrt": 1}
    assert len(bench_run(out).records()) == 6
    with pytest.raises(ValueError, match="seed was 0, is 1"):
        main(BenchOptions(problems=file, seed=1, out=out))


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"planner": ("fancy",)}, "fancy.*default"),
        ({"planner": ("rrt", "rrt")}, "twice"),
        ({"limit": 0}, "limit is 0"),
        ({"workers": 0}, "workers is 0"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_options_that_make_no_sense_are_errors(options: dict, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        BenchOptions(**options)


def test_problems_whose_plans_nothing_checks_are_refused_up_front(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subgoal, "_REGISTERED", {})
    monkeypatch.setattr(goal_checks, "_REGISTERED", {})
    throw = register_subgoal(replace(HANG, name="throw"))
    # Worker processes would not know of it.
    register_goal_check(replace(goal_check("hang"), subgoal="throw"))
    file, out = tmp_path / "problems.npz", tmp_path / "run"
    problems = {"one-0": mug_problem(HANG, STANDING), "one-1": mug_problem(throw, STANDING)}
    save_problems(file, problems)
    with pytest.raises(SystemExit, match="nothing says where plans to throw must end") as refusal:
        main(BenchOptions(problems=file, out=out))
    assert "planning/checking/goals" in str(refusal.value) and "\n" not in str(refusal.value)
    assert not out.exists()
    assert subgoals_of(BenchOptions(problems=file, limit=1)) == {"one-0": "hang"}


def test_a_plan_that_collides_is_refused_and_a_raise_is_an_error() -> None:
    problem = mug_problem(HANG, STANDING)
    plan = make_planner("rrt").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan)
    jumping = replace(plan.segments[1], trajectory=rest(Q_HOME + 0.2, 0.1))
    broken = replace(plan, segments=(plan.segments[0], jumping, *plan.segments[2:]))
    refused = run_planner(lambda: Fixed(broken), "fixed", problem, "hang", SEED)
    assert refused.outcome == REFUSED
    assert "starts" in refused.reason
    assert refused.measures is None
    raised = run_planner(lambda: Fixed(RuntimeError("boom")), "fixed", problem, "hang", SEED)
    assert raised.outcome == ERROR
    assert "boom" in raised.reason


def test_no_plan_at_all_is_an_error_and_one_that_only_rests_is_refused() -> None:
    problem = mug_problem(HANG, STANDING)
    nothing = cast(Plan, None)  # what no planner may return
    record = run_planner(lambda: Fixed(nothing), "fixed", problem, "hang", SEED)
    assert record.outcome == ERROR
    assert "Traceback" in record.reason
    assert "NoneType" in record.reason
    record = run_planner(lambda: Fixed(resting(Q_HOME)), "fixed", problem, "hang", SEED)
    assert record.outcome == REFUSED
    assert "has the segments transit" in record.reason


def test_counts_of_any_number_type_can_be_written() -> None:
    problem = mug_problem(HANG, STANDING)
    count = cast(float, np.int64(7))
    failure = PlanFailure(Stage.PLANNING, "no way", {"samples": count})
    record = run_planner(lambda: Fixed(failure), "fixed", problem, "hang", SEED)
    assert json.loads(json_line(record))["search"] == {"samples": 7.0}


def test_a_planner_that_cannot_be_made_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(name: str) -> Planner:
        raise FileNotFoundError(f"no regions for {name}")

    file = tmp_path / "problems.npz"
    save_problems(file, {"hang": mug_problem(HANG, STANDING)})
    monkeypatch.setattr(bench_records, "make_planner", fail)
    record = run_task(BenchTask(file, "hang", "hang", "unmade", SEED))
    assert (record.problem, record.planner, record.outcome) == ("hang", "unmade", ERROR)
    assert "no regions for unmade" in record.reason
    assert record.planning_s is None


def test_measures_grow_with_what_they_measure() -> None:
    problem = mug_problem(HANG, STANDING)
    plan = make_planner("rrt").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan)
    meter = PlanMeter(Layout())
    measures = meter.measure(plan, problem.p_WPs)
    qs = np.concatenate([segment.trajectory.qs for segment in plan.segments])
    steps = np.linalg.norm(np.diff(qs, axis=0), axis=1).sum()
    assert measures.path_length_rad == pytest.approx(steps, abs=1e-4)
    assert 0.0 < measures.clearance_m <= 0.1
    beside_path = meter.measure(plan, np.concatenate([problem.p_WPs, [plan.X_WGrasp[:3, 3]]]))
    assert beside_path.clearance_m <= measures.clearance_m


def test_clearance_is_of_the_surroundings_and_not_of_the_robot_itself() -> None:
    folded = np.array([0.0, -1.7, 0.0, -3.05, 0.0, 0.0, 0.78])
    checker = static_checker(Layout(), hook_margin_m=0.0, table_margin_m=0.0)
    itself = checker.CalcRobotClearance(panda_positions(folded, 0.04), FARTHEST_M)
    assert min(itself.distances()) < 0.01
    meter, far = PlanMeter(Layout()), np.array([[1.4, 0.0, 0.0]])
    assert meter.measure(resting(folded), far).clearance_m == FARTHEST_M
    above = [make_pose(rotation_x(np.pi), (0.5, 0.0, z)) for z in (0.05, 0.07)]
    qs = [closed_form_ik([X_WG], [np.pi / 4.0])[0][0] for X_WG in above]
    low, high = (meter.measure(resting(q), far).clearance_m for q in qs)
    assert high - low == pytest.approx(0.02, abs=1e-4)


def test_jerk_is_counted_where_a_motion_starts_turns_and_stops() -> None:
    ramp = np.arange(11) * 0.01
    tent = np.concatenate([ramp, ramp[-2::-1]])  # accelerates at 1 rad/s^2, then brakes
    once = motion(tent)
    assert rms_jerk([once]) == pytest.approx(np.sqrt((1.0 + 4.0 + 1.0) * 1e4 / (len(tent) + 2)))
    twice = motion(np.concatenate([tent, tent]))
    assert rms_jerk([twice]) == pytest.approx(rms_jerk([once, once]), rel=0.05)
    still = replace(once, vs=np.zeros_like(once.vs))
    assert rms_jerk([still]) == rms_jerk([once])
    assert rms_jerk([rest(Q_HOME, 0.5)]) == 0.0


def motion(speeds: Array) -> JointTrajectory:
    """Return one in which all joints move at each of these speeds (T,), rad/s, for 10 ms."""
    angles = 0.01 * np.cumsum(np.concatenate([[0.0], speeds]))
    joints = np.ones(7)
    times_s = np.linspace(0.0, 0.01 * len(speeds), len(angles))
    return JointTrajectory(times_s, np.outer(angles, joints), np.outer([*speeds, 0.0], joints))
