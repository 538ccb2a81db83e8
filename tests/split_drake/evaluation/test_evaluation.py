"""Evaluations as a whole: records, figures, tables, pictures, and going on after a kill."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from split_drake.data.object_scenes import NO_FEATURE
from split_drake.evaluation import evaluation as evaluation_module
from split_drake.evaluation.evaluation import Evaluation, evaluate, evaluation_run
from split_drake.evaluation.examiner import Examiner
from split_drake.evaluation.record import SceneRecord, Scored, TaskRecord
from split_drake.evaluation.report.plots import plot_errors, plot_reliability
from split_drake.evaluation.report.summary import (
    calibration_table,
    metrics_table,
    pooled,
    share,
    subjects_table,
    summarize,
)
from split_drake.evaluation.scenes import EvalMugs, EvalOptions, EvalSubject
from split_drake.experiments.run import AnotherRunError, json_line
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.pose_set import Acceptance, PoseSet, ScoredPoses, accepted_poses
from split_drake.pose_task import (
    GRASP,
    HANDLE,
    MUG_TASKS,
    PoseTask,
    Symmetry,
    UnknownTaskError,
    find_tasks,
)
from split_drake.poses import make_pose
from split_drake.scene import Scene
from split_drake.station.layout import Layout
from tests.helpers.evaluation import scene_record, standing_mug

QUIET = Console(quiet=True)
NAMES = tuple(task.name for task in MUG_TASKS)
SAMPLES = 5


class GuessingDetector:
    """Draws poses near the points; keeps the scenes that it was shown."""

    acceptance = Acceptance(0.4, 0.4)

    def __init__(self) -> None:
        self.seen: list[Scene] = []

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, ScoredPoses]:
        """Return poses at random points of the scene."""
        self.seen.append(scene)
        return {
            str(task): ScoredPoses(
                make_pose(p=rng.choice(scene.p_WSs, SAMPLES)), rng.random(SAMPLES)
            )
            for task in tasks
        }

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return the accepted ones of them."""
        known = find_tasks(tasks, MUG_TASKS, "the guess")
        return accepted_poses(self.sample(scene, known, rng), known, self.acceptance)


class OneMug:
    """The same mug in all scenes; counts how often it was made."""

    def __init__(self) -> None:
        self.layout = Layout()
        self.made = 0
        self._mug = standing_mug()

    def names(self) -> Sequence[str]:
        return ("mug",)

    def make(self, number: int, seed: int) -> EvalSubject:
        self.made += 1
        return self._mug

    def config(self) -> dict[str, Any]:
        return {}


def without_time(record: SceneRecord) -> dict[str, Any]:
    return {key: value for key, value in asdict(record).items() if key != "detect_s"}


def test_a_scene_depends_on_seed_and_number_alone() -> None:
    mugs, options = OneMug(), EvalOptions(seed=3)
    first, second = GuessingDetector(), GuessingDetector()
    some = Examiner(first, MUG_TASKS, mugs, options)
    other = Examiner(second, MUG_TASKS, mugs, options)
    records = [some.examine(0), some.examine(1)]
    assert mugs.made == 1, "it is made once for all of its scenes"
    assert without_time(other.examine(1)) == without_time(records[1])
    assert (first.seen[1].p_WSs == second.seen[0].p_WSs).all()
    assert without_time(records[0]) != without_time(records[1]) | {"index": 0}
    assert records[0].tasks["grasp"].tried is None


class DetectingOnly:
    """Returns poses without samples, of scores below any threshold."""

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return two poses in the air for each of the tasks."""
        X_WPs = make_pose(p=np.array([[0.5, 0.0, 0.2], [0.5, 0.0, 0.25]]))
        known = find_tasks(tasks, MUG_TASKS, "the detector")
        return {task.name: PoseSet(task, X_WPs, np.array([0.1, 0.05])) for task in known}


def test_all_poses_of_a_detector_without_samples_count_as_accepted() -> None:
    record = Examiner(DetectingOnly(), (GRASP, HANDLE), OneMug(), EvalOptions()).examine(0)
    assert tuple(record.tasks) == ("grasp", "handle"), "no other tasks are asked for"
    for task in record.tasks.values():
        assert task.samples.scores == (0.1, 0.05)
        assert task.values["accepted"] == 2
        assert task.tallies["accepted_good"] == (0, 2)


def test_records_survive_their_file_but_for_a_line_that_was_cut_off(tmp_path: Path) -> None:
    folder = evaluation_run(tmp_path)
    assert folder.records() == []
    with folder.claim({}):
        pass
    written = [scene_record(0), scene_record(1, good=False)]
    for record in written:
        folder.append(record)
    text = folder.log.read_text()
    folder.log.write_text(text + json_line(scene_record(2))[:-5])
    assert folder.records() == written
    with folder.claim({}):
        pass
    assert folder.log.read_text() == text


def test_shares_come_with_counts_and_wilsons_interval() -> None:
    figures = share([True] * 8 + [False] * 2)
    assert figures == {
        "share": 0.8,
        "hits": 8,
        "scenes": 10,
        "wilson95": pytest.approx([0.4902, 0.9433], abs=1e-4),
    }
    assert share([]) is None
    assert pooled([(1, 2), (0, 0), (5, 6)]) == {"share": 0.75, "hits": 6, "of": 8}
    assert pooled([(0, 0)]) is None
    assert pooled([]) is None


def test_figures_are_split_by_whether_the_handle_shows() -> None:
    records = [scene_record(0), scene_record(1, good=False), scene_record(2, feature_points=29)]
    metrics = summarize(records, NAMES)
    assert metrics["scenes"] == {"all": 3, "visible": 2, "hidden": 1}
    for figures in (metrics["tasks"][name] for name in NAMES):
        shares = {group: f["share"] for group, f in figures["top_good"].items()}
        assert shares == {"all": pytest.approx(2 / 3), "visible": 0.5, "hidden": 1.0}
        assert figures["median_position_mm"] == {"all": 2.0, "visible": 1.5, "hidden": 3.0}
        assert figures["samples_good"]["all"] == {"share": 1 / 3, "hits": 2, "of": 6}
        assert figures["calibration"]["samples"] == 6
        assert figures["calibration"]["auc"] == pytest.approx(7 / 8)
        assert figures["calibration_in_physics"] is None
    assert metrics["by_subject"]["mug_0"]["handle"]["top_good"]["all"]["scenes"] == 2
    assert json.loads(json.dumps(metrics)) == metrics


def test_groups_without_scenes_have_no_figures() -> None:
    metrics = summarize([scene_record(0)], NAMES)
    assert metrics["tasks"]["handle"]["top_good"]["hidden"] is None
    assert metrics["tasks"]["handle"]["median_position_mm"]["hidden"] is None
    assert metrics_table(metrics, NAMES).row_count == 3 * 5
    assert calibration_table(metrics, NAMES).row_count == 3


def test_what_has_no_feature_never_hides_it() -> None:
    metrics = summarize([scene_record(0, feature_points=NO_FEATURE)], NAMES)
    assert metrics["scenes"] == {"all": 1, "visible": 1, "hidden": 0}


class KilledError(Exception):
    """Stands for what ends an evaluation."""


def examine_by_hand(stop_before: int) -> Any:
    """Return a stand-in for the worker processes, which ends before scene `stop_before`."""

    def examine_all(_: Evaluation, indices: Sequence[int], __: int) -> Iterator[SceneRecord]:
        for index in indices:
            if index == stop_before:
                raise KilledError
            yield scene_record(index)

    return examine_all


def evaluation_of(scenes: int, detector: str = "guess", seed: int = 0) -> Evaluation:
    """Return an evaluation on mugs of the test split."""
    mugs, options = EvalMugs(MugSource("test"), Layout()), EvalOptions(seed=seed)
    return Evaluation(GuessingDetector, {"name": detector}, MUG_TASKS, mugs, options, scenes)


def run(out: Path, scenes: int = 4, detector: str = "guess", seed: int = 0) -> dict[str, Any]:
    return evaluate(evaluation_of(scenes, detector, seed), out, 1, QUIET)


def test_an_evaluation_goes_on_where_it_was_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation_module, "_examine_all", examine_by_hand(stop_before=2))
    with pytest.raises(KilledError):
        run(tmp_path / "killed")
    assert not (tmp_path / "killed/metrics.json").exists()
    scenes = tmp_path / "killed/scenes.jsonl"
    kept = scenes.read_text()
    assert len(kept.splitlines()) == 2
    scenes.write_text(kept + '{"index":2,"su')

    monkeypatch.setattr(evaluation_module, "_examine_all", examine_by_hand(stop_before=-1))
    resumed, whole = run(tmp_path / "killed"), run(tmp_path / "whole")
    assert resumed == whole == json.loads((tmp_path / "whole/metrics.json").read_text())
    assert scenes.read_text() == (tmp_path / "whole/scenes.jsonl").read_text()
    for picture in ("reliability.png", "errors.png"):
        assert (tmp_path / "whole" / picture).read_bytes().startswith(b"\x89PNG")


def test_more_scenes_add_to_those_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation_module, "_examine_all", examine_by_hand(stop_before=-1))
    run(tmp_path, scenes=3)
    monkeypatch.setattr(evaluation_module, "_examine_all", examine_by_hand(stop_before=0))
    assert run(tmp_path, scenes=5)["scenes"]["all"] == 5
    assert run(tmp_path, scenes=2)["scenes"]["all"] == 2


def test_figures_of_other_detectors_or_scenes_are_not_mixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation_module, "_examine_all", examine_by_hand(stop_before=-1))
    run(tmp_path)
    with pytest.raises(AnotherRunError, match="another run \\(detector was"):
        run(tmp_path, detector="other")
    with pytest.raises(AnotherRunError, match="another run \\(seed was 0, is 1"):
        run(tmp_path, seed=1)
    handles = replace(evaluation_of(scenes=4), tasks=(HANDLE,))
    with pytest.raises(AnotherRunError, match="another run \\(tasks was"):
        evaluate(handles, tmp_path, 1, QUIET)


def test_workers_change_nothing(tmp_path: Path) -> None:
    evaluation = evaluation_of(scenes=2)
    evaluate(evaluation, tmp_path, 2, QUIET)
    (first, second) = sorted(evaluation_run(tmp_path).records(), key=lambda r: r.index)
    examiner = evaluation.examiner()
    assert without_time(examiner.examine(1)) == without_time(second)
    assert without_time(examiner.examine(0)) == without_time(first)


def test_the_main_figures_of_each_object_have_a_table() -> None:
    metrics = summarize([scene_record(0)], NAMES)
    checks = ("top_good", "peg_clear_axis", "axis_good")
    for figures in metrics["by_subject"]["mug_0"].values():
        figures.update(dict.fromkeys(checks, figures["top_good"]))
    table = subjects_table(metrics, MUG_TASKS)
    assert table.row_count == 1
    assert [column.header for column in table.columns] == [
        "object",
        "handle top_good, visible",
        "handle peg_clear_axis, visible",
        "upright axis_good, all",
        "grasp top_good, all",
    ]


def record_of(task: PoseTask) -> SceneRecord:
    """Return a record of one task alone."""
    return replace(scene_record(0), tasks={task.name: scene_record(0).tasks["grasp"]})


@pytest.mark.parametrize("task", [PoseTask("lid"), PoseTask("handle", Symmetry.any_turn("z"))])
def test_tasks_that_are_judged_by_nothing_else_have_their_good_poses_in_the_table(
    task: PoseTask,
) -> None:
    table = subjects_table(summarize([record_of(task)], (task.name,)), (task,))
    assert [column.header for column in table.columns] == ["object", f"{task} top_good, all"]


def test_what_an_object_is_not_judged_by_is_a_dash_in_the_table() -> None:
    table = subjects_table(summarize([record_of(HANDLE)], ("handle",)), (HANDLE,))
    good, clear = (str(cell) for column in table.columns[1:] for cell in column.cells)
    assert (good[:6], clear) == ("100.0%", "-")


NAMES_OF_FIGURES = ("scenes", "tasks", "seed", "detector", "noise_m", "by_subject", "question")


def test_tasks_may_be_called_as_figures_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks = tuple(map(PoseTask, NAMES_OF_FIGURES))
    record = replace(
        scene_record(0), tasks=dict.fromkeys(NAMES_OF_FIGURES, scene_record(0).tasks["grasp"])
    )
    monkeypatch.setattr(evaluation_module, "_examine_all", lambda *_: iter([record]))
    monkeypatch.setattr(Evaluation, "require_true_poses", lambda _: None)
    asked = replace(evaluation_of(scenes=1, seed=7), tasks=tasks)
    metrics = evaluate(asked, tmp_path, 1, QUIET)
    assert tuple(metrics["tasks"]) == NAMES_OF_FIGURES
    assert metrics["scenes"]["all"] == 1
    assert metrics["question"] == asked.question()
    assert metrics_table(metrics, NAMES_OF_FIGURES).row_count == 5 * len(tasks)
    assert calibration_table(metrics, NAMES_OF_FIGURES).row_count == len(tasks)


def test_objects_without_poses_of_a_task_are_refused_before_any_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation_module, "_examine_all", examine_by_hand(stop_before=0))
    asked = replace(evaluation_of(scenes=1), tasks=(GRASP, PoseTask("lid")))
    with pytest.raises(UnknownTaskError, match=r"^test_000 has no poses of 'lid'; it has .*handle"):
        evaluate(asked, tmp_path / "out", 1, QUIET)
    assert not (tmp_path / "out").exists()
    with pytest.raises(KilledError):
        evaluate(replace(asked, tasks=(GRASP,)), tmp_path / "out", 1, QUIET)


@pytest.mark.filterwarnings("error")
def test_nothing_found_is_drawn_without_a_warning(tmp_path: Path) -> None:
    nothing = TaskRecord({"top_good": False}, {"accepted": 0.0}, {}, Scored((), ""))
    record = replace(scene_record(0), tasks={"grasp": nothing})
    plot_reliability(summarize([record], ("grasp",)), ("grasp",), tmp_path / "reliability.png")
    plot_errors([record], ("grasp",), tmp_path / "errors.png")
    assert (tmp_path / "reliability.png").exists() and (tmp_path / "errors.png").exists()
