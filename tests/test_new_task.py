"""A task and a family of objects that no file of the packages knows, all the way to a plan.

The task is a bowl's rim, the same after any turn about its axis; the subgoal puts the bowl down
where its rim is to be.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from planning import subgoal
from planning.checking import goal_checks
from planning.checking.checked_planner import PlanChecker
from planning.checking.goal_checks import GoalCheck, register_goal_check
from planning.planner import make_planner
from planning.problem import Plan, PlanningProblem
from planning.problem_files import load_problems, save_problems
from planning.subgoal import (
    AllowedContact,
    Placement,
    PlacementQuery,
    Subgoal,
    register_subgoal,
)
from scenarios.view_poses import ViewOptions
from scenarios.view_poses import main as view_poses
from split_drake.data.dataset import SceneDataset
from split_drake.data.generate import DatasetRecipe, generate
from split_drake.evaluation.evaluation import Evaluation, evaluate
from split_drake.evaluation.scenes import EvalOptions
from split_drake.grasps.judge import feasible
from split_drake.grasps.sampling import sample_grasps
from split_drake.pose_set import PoseSet, load_pose_sets, save_pose_sets
from split_drake.pose_task import GRASP, UnknownTaskError
from split_drake.poses import make_pose, rotation_z
from split_drake.robot.posture import Q_HOME
from split_drake.scene import Scene
from split_drake.split.detector import SplitDetector
from split_drake.split.network_config import SplitConfig
from split_drake.station.layout import Layout
from split_drake.training.batches import BatchConfig
from split_drake.training.curves import CurvesConfig
from split_drake.training.curves import main as draw_curves
from split_drake.training.train import TrainConfig, train
from split_drake.training.trainer import OptimizerConfig
from tests.helpers.bowls import RIM, Bowls, rests_of

TRAINED, TESTED = Bowls((0, 1, 2, 3), Layout()), Bowls((10, 11), Layout())
SCENES_PER_BOWL, STEPS, EVAL_SCENES = 50, 300, 12
NETWORK = SplitConfig(channels=(8, 16, 24, 32, 48), width=96, layers=4)
OPTIMIZER = OptimizerConfig(learning_rate=2e-3, warmup_steps=20, average_decay=0.98)
YAWS_RAD = np.radians(np.arange(0.0, 360.0, 45.0))
P_W_GOAL = (0.45, 0.08)


def served(query: PlacementQuery) -> list[Placement]:
    """Return placements of the best rim, level and as high as it is, beside where it is."""
    X_WR, score = query.poses.X_WPs[0], float(query.poses.scores[0])
    return [
        Placement(
            X_WO=X_WR,
            X_WOgoal=make_pose(rotation_z(yaw), (*P_W_GOAL, X_WR[2, 3])),
            score=score,
            p_OEntries_W=np.array([[0.0, 0.0, 0.08]]),
            lower_from_m=0.015,
            lower_to_m=-0.006,
            insert_contacts=frozenset(),
            lower_contacts=frozenset({AllowedContact.HELD_TABLE}),
        )
        for yaw in YAWS_RAD
    ]


def beside_place(plan: Plan, problem: PlanningProblem) -> str:
    off_m = float(np.linalg.norm(plan.X_WGoal[:2, 3] - P_W_GOAL))
    return "" if off_m < 0.001 and plan.X_WGoal[2, 2] > 0.99 else f"{off_m:.3f} m beside its place"


SERVE = Subgoal("serve", RIM, served, goal_noun="places")


@pytest.fixture(autouse=True)
def _registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget after each test what it has registered."""
    for module in (subgoal, goal_checks):
        monkeypatch.setattr(module, "_REGISTERED", {})


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bowls")
    recipe = DatasetRecipe(
        TRAINED, (GRASP, RIM), Layout(), rests_of, scenes_per_object=SCENES_PER_BOWL
    )
    generate(recipe, folder, workers=1)
    return folder


@pytest.fixture(scope="module")
def run(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    config = TrainConfig(
        data=dataset,
        out=folder,
        steps=STEPS,
        network=NETWORK,
        batch=BatchConfig(poses_of=()),
        optimizer=OPTIMIZER,
        precision="float32",
    )
    train(config, Console(quiet=True))
    return folder


@pytest.fixture(scope="module")
def detector(run: Path) -> SplitDetector:
    return SplitDetector.from_checkpoint(run / "split.safetensors")


@pytest.fixture(scope="module")
def scene() -> Scene:
    drawn = TESTED.make(0, seed=0).draw(np.random.default_rng(5))
    return Scene(drawn.p_WPs, drawn.p_WSs, Layout().workspace)


def test_a_dataset_carries_tasks_labels_and_workspace(dataset: Path) -> None:
    scenes = SceneDataset.open(dataset)
    assert len(scenes) == SCENES_PER_BOWL * len(TRAINED.numbers) == 200
    assert scenes.tasks == (GRASP, RIM)
    assert scenes.workspace == Layout().workspace
    assert scenes.labels["rim"].X_OPs.shape == (4, 1, 4, 4)
    assert (scenes.labels["rim"].states == 1).all()
    assert (scenes.labels["grasp"].states == 2).any(axis=1).all()


def test_a_checkpoint_knows_its_tasks(
    detector: SplitDetector, scene: Scene, run: Path, tmp_path: Path
) -> None:
    assert detector.tasks == (GRASP, RIM)
    with pytest.raises(UnknownTaskError, match="no task 'handle'; it has grasp, rim"):
        detector.detect(scene, ["handle"], np.random.default_rng(0))
    draw_curves(CurvesConfig((run,), tmp_path / "curves.png"))
    assert (tmp_path / "curves.png").stat().st_size > 10_000


def test_pose_sets_of_the_task_survive_their_file_and_are_shown(
    detector: SplitDetector, scene: Scene, tmp_path: Path
) -> None:
    found = detector.detect(scene, ["rim"], np.random.default_rng(0))
    assert len(found["rim"])
    path = tmp_path / "rims.npz"
    save_pose_sets(path, found, scene.p_WPs)
    again, _ = load_pose_sets(path)
    assert again["rim"].task == RIM
    np.testing.assert_array_equal(again["rim"].X_WPs, found["rim"].X_WPs)
    assert "<html" in view_poses(ViewOptions(path, best=5)).read_text()


def test_unseen_bowls_show_where_their_rims_are(run: Path, tmp_path: Path) -> None:
    weights = run / "split.safetensors"
    evaluation = Evaluation(
        partial(SplitDetector.from_checkpoint, weights),
        {"weights": "of the test"},
        (GRASP, RIM),
        TESTED,
        EvalOptions(),
        EVAL_SCENES,
    )
    metrics = evaluate(evaluation, tmp_path, 2, Console(quiet=True))
    assert metrics["tasks"]["rim"]["median_position_mm"]["all"] < 10.0
    assert metrics["tasks"]["rim"]["median_rotation_deg"]["all"] < 10.0
    assert metrics["tasks"]["grasp"]["samples_good"]["all"]["share"] > 0.1
    assert (tmp_path / "errors.png").exists()


class TrueRims:
    """A detector that samples nothing: it returns the true pose, and grasps of no use."""

    def detect(self, scene: Scene, tasks: Any, rng: np.random.Generator) -> dict[str, PoseSet]:
        drawn = TESTED.make(0, seed=0).shape
        middle = np.append(scene.p_WSs[:, :2].mean(axis=0), 0.0)
        rim = make_pose(p=middle) @ drawn.poses_of(RIM)
        none = PoseSet(GRASP, np.empty((0, 4, 4)), np.empty(0))
        return {"rim": PoseSet(RIM, rim, np.ones(1)), "grasp": none}


def test_any_detector_is_evaluated_alike(tmp_path: Path) -> None:
    tasks, bowl = (GRASP, RIM), Bowls((10,), Layout())
    evaluation = Evaluation(TrueRims, {"name": "true"}, tasks, bowl, EvalOptions(), 4)
    metrics = evaluate(evaluation, tmp_path, 1, Console(quiet=True))
    assert metrics["tasks"]["rim"]["median_rotation_deg"]["all"] < 5.0
    assert metrics["tasks"]["grasp"]["top_good"]["all"]["hits"] == 0


@pytest.fixture(scope="module")
def problem() -> PlanningProblem:
    """A bowl that stands, with its true rim and grasps."""
    subject = TESTED.make(0, seed=0)
    drawn = subject.draw(np.random.default_rng(5))
    labels = sample_grasps(subject.shape.body, np.random.default_rng(0), positives=400)
    good = feasible(drawn.X_WO, labels.X_OGs, labels.openings_m, drawn.table_z_m)
    grasps = PoseSet.ranked(GRASP, drawn.X_WO @ labels.X_OGs[good], labels.qualities[good])
    rims = PoseSet(RIM, subject.shape.true_poses(RIM, drawn.X_WO), np.ones(1))
    return PlanningProblem(SERVE, {"grasp": grasps, "rim": rims}, drawn.p_WPs, Q_HOME, Layout())


def test_a_subgoal_of_ones_own_is_planned_for_and_checked(problem: PlanningProblem) -> None:
    plan = make_planner("default").plan(problem, np.random.default_rng(0))
    assert isinstance(plan, Plan), plan
    assert plan.subgoal == SERVE
    with pytest.raises(ValueError, match="nothing says where plans to serve must end"):
        PlanChecker(problem.layout).violations(plan, problem)
    register_goal_check(GoalCheck("serve", beside_place))
    assert PlanChecker(problem.layout).violations(plan, problem) == []


def test_problems_of_ones_own_survive_their_file(problem: PlanningProblem, tmp_path: Path) -> None:
    save_problems(tmp_path / "serve.npz", {"one": problem})
    with pytest.raises(ValueError, match="unknown subgoal 'serve'"):
        load_problems(tmp_path / "serve.npz")
    register_subgoal(SERVE)
    again = load_problems(tmp_path / "serve.npz")["one"]
    assert again.subgoal == SERVE
    assert again.pose_sets["rim"].task == RIM
    np.testing.assert_allclose(
        again.pose_sets["rim"].X_WPs, problem.pose_sets["rim"].X_WPs, atol=2e-4
    )
