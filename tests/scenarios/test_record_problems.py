"""Recorded problems are those that a trial's planner is asked; regions grow from their plans."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planning.collision.world import CollisionWorld, Situation
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.motion.regions import load_regions
from planning.problem import PlanningProblem
from planning.problem_files import SHIPPED_PROBLEMS, load_problems, save_problems
from scenarios import record_problems
from scenarios.bench.recorded import Recorded
from scenarios.making import grow_regions
from scenarios.making.grow_regions import GrowOptions
from scenarios.record_problems import (
    MAX_POSES,
    RecordOptions,
    Starts,
    main,
    record_problem,
    specs_of,
)
from scenarios.trials.mug_check import MugCheck
from scenarios.trials.spec import TrialSpec
from split_drake.bad_input import BadInputError
from split_drake.experiments.pool import InThisProcess
from split_drake.experiments.run import NoResultsError
from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import make_pose
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.posture import Q_HOME
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from tests.helpers.planning import STANDING, mug_problem

HANG_PROBLEM = "hang-oracle-test-0"


def _in_this_process(
    scheduler: str, workers: int, work: Callable[[TrialSpec], Recorded], *_: object, **__: object
) -> InThisProcess[TrialSpec, Recorded]:
    return InThisProcess(work)


def record_by(
    work: Callable[[Starts, TrialSpec], Recorded], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Have starts recorded by `work`, in this process."""
    monkeypatch.setattr(record_problems, "record_problem", work)
    monkeypatch.setattr(record_problems, "make_pool", _in_this_process)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("problems") / "p.npz"
    return main(RecordOptions(count=2, detectors=("oracle",), workers=1, out=out))


def test_tasks_take_turns_and_the_same_seed_gives_the_same_problem(file: Path) -> None:
    found = load_problems(file)
    assert list(found) == [HANG_PROBLEM, "reorient-oracle-test-0"]
    assert [p.subgoal for p in found.values()] == [HANG, REORIENT]
    spec = specs_of(RecordOptions(count=1, detectors=("oracle",)))[0]
    again = record_problem("home", spec).problem
    assert isinstance(again, PlanningProblem)
    np.testing.assert_allclose(found[HANG_PROBLEM].p_WPs, again.p_WPs, atol=1e-4)
    assert len(found[HANG_PROBLEM].pose_sets["grasp"]) <= MAX_POSES["grasp"]
    np.testing.assert_allclose(again.q_start, Q_HOME, atol=0.01)


def test_an_interrupted_recording_goes_on(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[int] = []

    def interrupting(starts: Starts, spec: TrialSpec) -> Recorded:
        started.append(spec.index)
        if spec.index == 1 and started.count(1) == 1:
            raise KeyboardInterrupt
        return record_problem(starts, spec)

    record_by(interrupting, monkeypatch)
    options = RecordOptions(count=2, detectors=("oracle",), out=tmp_path / "p.npz")
    with pytest.raises(SystemExit, match="the same command goes on"):
        main(options)
    assert not options.out.exists()
    main(replace(options, workers=1))
    assert started == [0, 1, 1]
    found, whole = load_problems(options.out), load_problems(file)
    assert list(found) == list(whole)
    for name, problem in whole.items():
        np.testing.assert_array_equal(found[name].p_WPs, problem.p_WPs)
        for task, poses in problem.pose_sets.items():
            np.testing.assert_array_equal(found[name].pose_sets[task].X_WPs, poses.X_WPs)
    assert list(tmp_path.iterdir()) == [options.out]


def test_a_start_without_a_problem_is_told_and_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refusing(starts: Starts, spec: TrialSpec) -> Recorded:
        if spec.index == 0:
            return Recorded(0, "first", None, "nothing was seen")
        return record_problem(starts, spec)

    record_by(refusing, monkeypatch)
    options = RecordOptions(count=2, detectors=("oracle",), out=tmp_path / "p.npz")
    assert len(load_problems(main(options))) == 1
    assert "first: left out: nothing was seen" in capsys.readouterr().out
    with pytest.raises(NoResultsError, match="none of 1 starts gave a problem"):
        main(replace(options, count=1, out=tmp_path / "none.npz"))
    assert list(tmp_path.iterdir()) == [options.out]


def test_what_crashed_is_tried_again(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[int] = []

    def crashing(starts: Starts, spec: TrialSpec) -> Recorded:
        started.append(spec.index)
        if spec.index == 0 and started.count(0) == 1:
            return Recorded(0, "seed 0", None, "the worker died", crashed=True)
        if spec.index == 2:
            return Recorded(2, "third", None, "nothing was seen")
        return record_problem(starts, spec)

    record_by(crashing, monkeypatch)
    options = RecordOptions(count=3, detectors=("oracle",), out=tmp_path / "p.npz")
    assert len(load_problems(main(options))) == 1
    assert list(load_problems(main(options))) == list(load_problems(file))
    assert started == [0, 1, 2, 0]
    assert list(tmp_path.iterdir()) == [options.out]


def test_problems_of_own_mugs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    load_mug("test_004").body.mesh.export(folder / "cup.stl")
    (folder / "broken.stl").write_text("solid")
    out = tmp_path / "problems" / "p.npz"
    main(RecordOptions(1, detectors=("oracle",), mugs=str(folder), workers=1, out=out))
    assert list(load_problems(out)) == ["hang-oracle-mine-0"]
    assert capsys.readouterr().out.count("left out: ") == 1
    assert list(out.parent.iterdir()) == [out]
    with pytest.raises(BadInputError, match=r"'nowhere'.*folder of mesh files"):
        RecordOptions(mugs="nowhere")


def test_meshes_are_checked_at_the_station_that_problems_are_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class CheckedError(Exception):
        """Ends the command where its station is known."""

    def check(station: StationConfig, scratch: Path | None, folder: Path) -> MugCheck:
        raise CheckedError(station.layout.table_z_m)

    monkeypatch.setattr(record_problems, "MugCheck", check)
    file = MODELS_FOLDER / "stations" / "high_table.yaml"
    with pytest.raises(CheckedError, match=r"^0\.1$"):
        main(RecordOptions(1, detectors=("oracle",), station=(file,), out=tmp_path / "p.npz"))


def test_regions_grow_from_plans(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "r.npz"
    grow_regions.main(GrowOptions(problems=file, plans=1, max_regions=2, out=out))
    regions = load_regions(out)
    assert len(regions) == 2
    assert regions.covers(Q_HOME[None]).all()


def test_regions_do_not_grow_from_problems_of_another_station(tmp_path: Path) -> None:
    here = mug_problem(HANG, STANDING)
    moved = replace(here, layout=Layout(X_WK=make_pose(p=(0.4, -0.38, 0.40))))
    elsewhere = tmp_path / "elsewhere.npz"
    save_problems(elsewhere, {"here": here, "moved": moved})
    options = GrowOptions(problems=elsewhere, plans=1, max_regions=1, out=tmp_path / "r.npz")
    with pytest.raises(ValueError, match=r"elsewhere\.npz.*'moved'.*record_problems"):
        grow_regions.main(options)
    assert not options.out.exists()


def test_shipped_problems_are_500_of_both_tasks() -> None:
    problems = load_problems(SHIPPED_PROBLEMS)
    assert len(problems) == 500
    assert {problem.subgoal for problem in problems.values()} == {HANG, REORIENT}
    assert SHIPPED_PROBLEMS.stat().st_size < 5e6


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"count": 0}, "count is 0"),
        ({"tasks": ()}, "at least one"),
        ({"tasks": ("hang", "hang")}, "tasks names one twice.*hang"),
        ({"detectors": ("oracle", "oracle")}, "detectors names one twice.*oracle"),
        ({"seed": -1}, "seed is -1"),
        ({"noise_m": -0.001}, "noise-m is -0.001"),
        ({"noise_m": float("nan")}, "noise-m is nan"),
        ({"workers": 0}, "workers is 0"),
    ],
)
def test_options_that_make_no_sense_are_errors(options: dict, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        RecordOptions(**options)


def test_growing_needs_a_plan() -> None:
    with pytest.raises(ValueError, match="plans is 0"):
        GrowOptions(plans=0)


def test_problems_differ_in_station_start_and_what_is_in_the_way(tmp_path: Path) -> None:
    files = tuple(MODELS_FOLDER / "stations" / f"{name}.yaml" for name in ("default", "left_hook"))
    options = RecordOptions(
        count=2,
        seed=3,
        tasks=("hang",),
        detectors=("oracle",),
        station=files,
        objects=2,
        starts="any",
        workers=1,
        out=tmp_path / "p.npz",
    )
    found = list(load_problems(main(options)).values())
    assert [problem.layout.X_WK[1, 3] for problem in found] == pytest.approx([-0.38, 0.38])
    for problem in found:
        assert len(problem.p_WObstacles) > 50
        assert np.abs(problem.q_start - Q_HOME).max() > 0.1
        situation = Situation(0.08, p_WStanding=problem.p_WPs)
        world = CollisionWorld(problem.layout).among(problem.p_WObstacles)
        assert world.free(problem.q_start[None], situation).all()
        assert gripper_pose(problem.q_start)[2, 2] < -0.5
    with pytest.raises(BadInputError, match=r"--objects is -1; expected a whole number, 0"):
        replace(options, objects=-1)
