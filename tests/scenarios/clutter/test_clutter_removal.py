"""The command of clutter removal: what it asks for, what it keeps, what it reports."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

from scenarios import clutter_removal
from scenarios.clutter.records import CRASHED, EMPTIED, ERROR, TOO_LONG, RoundRecord
from scenarios.clutter.rounds import crashed_round
from scenarios.clutter.spec import object_source
from scenarios.clutter_removal import (
    ClutterOptions,
    asked_records,
    describe,
    layout_of,
    main,
    missing_rounds,
    run_config,
)
from split_drake.experiments.pool import InThisProcess
from split_drake.experiments.run import AnotherRunError, NoResultsError
from split_drake.objects.files.folder import ObjectFolder
from split_drake.pose_task import UPRIGHT, UnknownTaskError
from split_drake.scene import Workspace
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout
from tests.helpers.checkpoints import save_new_network
from tests.scenarios.clutter.test_records import of_round

ORACLE = ClutterOptions("packed", 2, 2, 5, "oracle", objects="procedural-train", noise="none")


def test_rounds_that_are_there_are_not_asked_for_again(tmp_path: Path) -> None:
    specs = missing_rounds(ORACLE, tmp_path, {(5, 1), (6, 0)})
    assert [(spec.seed, spec.index) for spec in specs] == [(5, 0), (6, 1)]
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.04, 0.05, 0.06)).export(tmp_path / "meshes" / "box.obj")
    own = replace(ORACLE, objects=str(tmp_path / "meshes"))
    assert {spec.objects for spec in missing_rounds(own, tmp_path, set())} == {
        ObjectFolder(tmp_path / "meshes", tmp_path / "decompositions")
    }


def test_the_workspace_is_the_one_that_the_model_was_trained_on(tmp_path: Path) -> None:
    path, workspace = tmp_path / "moved.safetensors", Workspace((0.55, 0.05, 0.0))
    save_new_network(path, workspace)
    options = ClutterOptions("pile", 1, 1, checkpoint=path)
    assert layout_of(options).workspace == workspace
    for detector in ("split_8", "split_16", "split_once"):
        assert layout_of(replace(options, detector=detector)).workspace == workspace
    (spec,) = missing_rounds(options, tmp_path, ())
    assert (spec.layout.workspace, spec.checkpoint) == (workspace, path)
    assert layout_of(ORACLE).workspace == Workspace()


def test_a_run_is_told_by_its_weights_and_objects(tmp_path: Path) -> None:
    path = tmp_path / "new.safetensors"
    save_new_network(path)
    config = run_config(ClutterOptions("pile", checkpoint=path))
    assert len(config["checkpoint_sha256"]) == 64
    assert config["objects_sha256"] == object_source("procedural", tmp_path).sha256()
    assert "checkpoint_sha256" not in run_config(ORACLE)
    assert config["objects_sha256"] != run_config(ORACLE)["objects_sha256"]
    assert config["physics"] == StationConfig(Layout()).physics()
    assert config["physics"]["near_rigid_threshold"] == 0.1


def test_only_what_is_asked_for_is_reported() -> None:
    records = [of_round(6, 1, ""), of_round(5, 2, ""), of_round(5, 0, ""), of_round(9, 0, "")]
    asked = asked_records(ORACLE, records)
    assert [(each.seed, each.index) for each in asked] == [(5, 0), (6, 1)]


def test_the_bar_tells_the_grasps_so_far() -> None:
    assert describe([of_round(0, 0, "", "missed"), of_round(0, 1, "")]) == "2/3 grasps"


def stand_in(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Have rounds succeed with two grasps without being run; return those that were asked for."""
    run: list[tuple[int, int]] = []

    def succeed(spec: clutter_removal.RoundSpec) -> RoundRecord:
        run.append((spec.seed, spec.index))
        return of_round(spec.seed, spec.index, "", "")

    monkeypatch.setattr(clutter_removal, "make_pool", lambda *_, **options: InThisProcess(succeed))
    return run


def test_the_summary_has_counts_rates_and_intervals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stand_in(monkeypatch)
    main(replace(ORACLE, out=tmp_path))
    summary = json.loads((tmp_path / "summary.json").read_text())
    wanted = {"scene": "packed", "detector": "oracle", "rounds": 4, "seeds": 2, "attempts": 8}
    wanted |= {"successes": 8, "objects": 8, "gsr": 1.0, "dr": 1.0, "failures": {}}
    assert wanted.items() <= summary.items()
    assert summary["gsr_interval"] == summary["dr_interval"] == [1.0, 1.0]
    assert summary["ended"] == {EMPTIED: 4}


def test_more_rounds_go_on_from_those_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = stand_in(monkeypatch)
    main(replace(ORACLE, rounds=1, out=tmp_path))
    main(replace(ORACLE, rounds=2, seeds=3, out=tmp_path))
    assert run == [(5, 0), (6, 0), (5, 1), (6, 1), (7, 0), (7, 1)]
    with pytest.raises(AnotherRunError, match="noise was 'none', is 'dex'"):
        main(replace(ORACLE, noise="dex", out=tmp_path))


def test_a_round_whose_process_died_is_counted(tmp_path: Path) -> None:
    spec = missing_rounds(ORACLE, tmp_path, ())[0]
    assert crashed_round(spec) == RoundRecord(5, 0, (), (), CRASHED)
    late = crashed_round(spec, "it took longer than 9 s")
    assert late == RoundRecord(5, 0, (), (), TOO_LONG, "it took longer than 9 s")
    assert late.failed_to_run and crashed_round(spec).failed_to_run


def test_rounds_that_all_end_in_errors_are_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(spec: clutter_removal.RoundSpec) -> RoundRecord:
        return RoundRecord(spec.seed, spec.index, (), (), ERROR, "KeyError: 'box'")

    monkeypatch.setattr(clutter_removal, "make_pool", lambda *_, **options: InThisProcess(fail))
    with pytest.raises(NoResultsError, match=r"all 4 ended in an error, the first in: KeyError"):
        main(replace(ORACLE, out=tmp_path))
    run = stand_in(monkeypatch)
    main(replace(ORACLE, out=tmp_path))
    assert len(run) == 4, "all are tried again"


def test_a_checkpoint_without_grasps_is_told_before_the_first_round(tmp_path: Path) -> None:
    path = tmp_path / "upright.safetensors"
    save_new_network(path, tasks=(UPRIGHT,))
    options = replace(ORACLE, detector="split", checkpoint=path, out=tmp_path / "run")
    with pytest.raises(UnknownTaskError, match=f"{path} has no task 'grasp'; it has upright"):
        main(options)
    assert not (tmp_path / "run").exists()


def test_objects_of_no_use_are_told_before_the_first_round(tmp_path: Path) -> None:
    objects = tmp_path / "objects"
    objects.mkdir()
    out = tmp_path / "out"
    with pytest.raises(SystemExit, match=f"^--objects: {objects} "):
        main(ClutterOptions("packed", 1, 1, 0, "oracle", objects=str(objects), out=out))
    assert not out.exists()
