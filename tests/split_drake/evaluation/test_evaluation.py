"""Evaluations as a whole: records, figures, tables, pictures, and going on after a kill."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from split_drake.evaluation import evaluation
from split_drake.evaluation.evaluation import evaluate, evaluation_run
from split_drake.evaluation.examiner import Examiner
from split_drake.evaluation.record import SceneRecord
from split_drake.evaluation.scenes import EvalMug, EvalOptions
from split_drake.evaluation.summary import (
    calibration_table,
    metrics_table,
    mugs_table,
    pooled,
    share,
    summarize,
)
from split_drake.experiments.run import AnotherRunError, json_line
from split_drake.pose_task import PoseTask
from split_drake.poses import make_pose
from split_drake.scene import Scene
from split_drake.split.detector import SamplerConfig, ScoredSamples
from tests.helpers.evaluation import scene_record, standing_mug

QUIET = Console(quiet=True)


class GuessingDetector:
    """Draws poses near the points; keeps the scenes that it was shown."""

    def __init__(self) -> None:
        self.config = SamplerConfig(samples=5)
        self.seen: list[Scene] = []

    def sample(
        self, scene: Scene, tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, ScoredSamples]:
        """Return poses at random points of the scene."""
        self.seen.append(scene)
        return {
            task: ScoredSamples(
                make_pose(p=rng.choice(scene.p_WSs, self.config.samples)),
                rng.random(self.config.samples),
            )
            for task in tasks
        }


class OneMug:
    """The same mug in all scenes."""

    def __init__(self) -> None:
        self._mug = standing_mug()

    def of_scene(self, index: int) -> EvalMug:
        return self._mug


def without_time(record: SceneRecord) -> dict[str, Any]:
    return {key: value for key, value in asdict(record).items() if key != "detect_s"}


def test_a_scene_depends_on_seed_and_number_alone() -> None:
    mugs, options = OneMug(), EvalOptions(seed=3)
    first, second = GuessingDetector(), GuessingDetector()
    some = Examiner(first, mugs, options)  # type: ignore[arg-type]
    other = Examiner(second, mugs, options)  # type: ignore[arg-type]
    records = [some.examine(0), some.examine(1)]
    assert without_time(other.examine(1)) == without_time(records[1])
    assert (first.seen[1].p_WSs == second.seen[0].p_WSs).all()
    assert without_time(records[0]) != without_time(records[1]) | {"index": 0}
    assert records[0].tasks[PoseTask.GRASP].tried is None


def test_records_survive_their_file_but_for_a_line_that_was_cut_off(tmp_path: Path) -> None:
    folder = evaluation_run(tmp_path)
    assert folder.records() == []
    folder.claim({})
    written = [scene_record(0), scene_record(1, good=False)]
    for record in written:
        folder.append(record)
    text = folder.log.read_text()
    folder.log.write_text(text + json_line(scene_record(2))[:-5])
    assert folder.records() == written
    folder.claim({})
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
    records = [scene_record(0), scene_record(1, good=False), scene_record(2, handle_points=29)]
    metrics = summarize(records)
    assert metrics["scenes"] == {"all": 3, "visible": 2, "hidden": 1}
    for task in PoseTask:
        shares = {group: f["share"] for group, f in metrics[task]["top_good"].items()}
        assert shares == {"all": pytest.approx(2 / 3), "visible": 0.5, "hidden": 1.0}
        assert metrics[task]["median_position_mm"] == {"all": 2.0, "visible": 1.5, "hidden": 3.0}
        assert metrics[task]["samples_good"]["all"] == {"share": 1 / 3, "hits": 2, "of": 6}
        assert metrics[task]["calibration"]["samples"] == 6
        assert metrics[task]["calibration"]["auc"] == pytest.approx(7 / 8)
        assert metrics[task]["calibration_in_physics"] is None
    assert metrics["by_mug"]["mug_0"]["handle"]["top_good"]["all"]["scenes"] == 2
    assert json.loads(json.dumps(metrics)) == metrics


def test_groups_without_scenes_have_no_figures() -> None:
    metrics = summarize([scene_record(0)])
    assert metrics["handle"]["top_good"]["hidden"] is None
    assert metrics["handle"]["median_position_mm"]["hidden"] is None
    assert metrics_table(metrics).row_count == 3 * 5
    assert calibration_table(metrics).row_count == 3


class KilledError(Exception):
    """Stands for what ends an evaluation."""


def examine_by_hand(stop_before: int) -> Any:
    """Return a stand-in for the worker processes, which ends before scene `stop_before`."""

    def examine_all(_: Any, __: Any, indices: Sequence[int], ___: int) -> Iterator[SceneRecord]:
        for index in indices:
            if index == stop_before:
                raise KilledError
            yield scene_record(index)

    return examine_all


def run(out: Path, scenes: int = 4, detector: str = "guess", seed: int = 0) -> dict[str, Any]:
    options = EvalOptions(scenes=scenes, seed=seed)
    return evaluate(GuessingDetector, {"name": detector}, options, out, 1, QUIET)


def test_an_evaluation_goes_on_where_it_was_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation, "_examine_all", examine_by_hand(stop_before=2))
    with pytest.raises(KilledError):
        run(tmp_path / "killed")
    assert not (tmp_path / "killed/metrics.json").exists()
    scenes = tmp_path / "killed/scenes.jsonl"
    kept = scenes.read_text()
    assert len(kept.splitlines()) == 2
    scenes.write_text(kept + '{"index":2,"mu')

    monkeypatch.setattr(evaluation, "_examine_all", examine_by_hand(stop_before=-1))
    resumed, whole = run(tmp_path / "killed"), run(tmp_path / "whole")
    assert resumed == whole == json.loads((tmp_path / "whole/metrics.json").read_text())
    assert scenes.read_text() == (tmp_path / "whole/scenes.jsonl").read_text()
    for picture in ("reliability.png", "errors.png"):
        assert (tmp_path / "whole" / picture).read_bytes().startswith(b"\x89PNG")


def test_more_scenes_add_to_those_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation, "_examine_all", examine_by_hand(stop_before=-1))
    run(tmp_path, scenes=3)
    monkeypatch.setattr(evaluation, "_examine_all", examine_by_hand(stop_before=0))
    assert run(tmp_path, scenes=5)["scenes"]["all"] == 5
    assert run(tmp_path, scenes=2)["scenes"]["all"] == 2


def test_figures_of_other_detectors_or_scenes_are_not_mixed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation, "_examine_all", examine_by_hand(stop_before=-1))
    run(tmp_path)
    with pytest.raises(AnotherRunError, match="another run \\(detector was"):
        run(tmp_path, detector="other")
    with pytest.raises(AnotherRunError, match="another run \\(seed was 0, is 1"):
        run(tmp_path, seed=1)


def test_workers_change_nothing(tmp_path: Path) -> None:
    options = EvalOptions(scenes=2)
    evaluate(GuessingDetector, {"name": "guess"}, options, tmp_path, 2, QUIET)
    (first, second) = sorted(evaluation_run(tmp_path).records(), key=lambda r: r.index)
    examiner = Examiner(GuessingDetector(), evaluation.EvalMugs(options), options)
    assert without_time(examiner.examine(1)) == without_time(second)
    assert without_time(examiner.examine(0)) == without_time(first)


def test_the_main_figures_of_each_mug_have_a_table() -> None:
    metrics = summarize([scene_record(0)])
    checks = ("top_good", "peg_clear_axis", "axis_good")
    for figures in metrics["by_mug"]["mug_0"].values():
        figures.update(dict.fromkeys(checks, figures["top_good"]))
    assert mugs_table(metrics).row_count == 1
