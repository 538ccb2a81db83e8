"""Rounds of clutter removal."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scenarios.clutter import rounds
from scenarios.clutter.clearing import HandClearing
from scenarios.clutter.detection import ranked
from scenarios.clutter.detectors import oracle
from scenarios.clutter.records import BROKEN, EMPTIED, ERROR, NO_GRASP, TWO_FAILURES
from scenarios.clutter.rounds import run_round
from scenarios.clutter.spec import RoundSpec, drawn_objects, object_source
from scenarios.clutter_removal import ClutterOptions, main, missing_rounds
from split_drake.pose_set import PoseSet
from split_drake.poses import make_pose, rotation_x
from split_drake.scene import Scene
from split_drake.station.config import StationConfig

DOWN = rotation_x(np.pi)


def spec_of(folder: Path, **options: Any) -> RoundSpec:
    asked = ClutterOptions("packed", 1, 1, 48, "oracle", objects="procedural-train", noise="none")
    return replace(missing_rounds(asked, folder, ())[0], **options)


def detecting(monkeypatch: pytest.MonkeyPatch, detect: Callable[[Scene], PoseSet]) -> None:
    """Have the oracle find what a function says."""
    finds = SimpleNamespace(detect=lambda scene, rng: detect(scene))
    monkeypatch.setattr(oracle, "TrueGrasps", lambda clearing, rng: finds)


def test_true_grasps_clear_a_table(tmp_path: Path) -> None:
    record = run_round(spec_of(tmp_path))
    assert record.ended in (EMPTIED, NO_GRASP)
    assert len(record.objects) >= 3
    assert record.successes >= 2
    taken = [name for grasp in record.grasps for name in grasp.taken]
    assert len(taken) == record.successes
    assert set(taken) <= set(record.objects)


def test_a_round_without_grasps_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    detecting(monkeypatch, lambda scene: ranked(np.empty((0, 4, 4)), ()))
    record = run_round(spec_of(tmp_path))
    assert (record.ended, record.grasps) == (NO_GRASP, ())


def test_rounds_have_the_physics_that_runs_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frictions = list[float]()

    def find(clearing: HandClearing, rng: np.random.Generator) -> object:
        frictions.append(clearing._station.config.friction)
        return SimpleNamespace(detect=lambda scene, rng: ranked(np.empty((0, 4, 4)), ()))

    monkeypatch.setattr(oracle, "TrueGrasps", find)
    monkeypatch.setattr(rounds, "round_station", lambda layout: StationConfig(layout, friction=0.5))
    run_round(spec_of(tmp_path))
    assert frictions == [0.5]


def test_two_failures_in_a_row_end_a_round(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    in_the_air = make_pose(DOWN, (0.5, 0.0, 0.3))[None]
    detecting(monkeypatch, lambda scene: ranked(in_the_air, [0.5]))
    record = run_round(spec_of(tmp_path))
    assert record.ended == TWO_FAILURES
    assert [grasp.reason for grasp in record.grasps] == ["the hand holds nothing"] * 2


def test_a_simulation_that_fails_is_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(scene: Scene) -> PoseSet:
        raise RuntimeError("the solver did not converge")

    detecting(monkeypatch, fail)
    record = run_round(spec_of(tmp_path))
    assert (record.ended, record.detail) == (BROKEN, "the solver did not converge")
    assert record.objects


def test_all_detectors_meet_the_same_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[np.ndarray] = []

    def look(scene: Scene) -> PoseSet:
        seen.append(scene.p_WPs)
        return ranked(np.empty((0, 4, 4)), ())

    detecting(monkeypatch, look)
    first = run_round(spec_of(tmp_path))
    second = run_round(spec_of(tmp_path, noise="gaussian", select="random"))
    other = run_round(spec_of(tmp_path, index=1))
    assert first.objects == second.objects != other.objects
    np.testing.assert_array_equal(seen[0], seen[1])


def test_objects_are_scaled_and_have_names_of_their_own(tmp_path: Path) -> None:
    bodies = drawn_objects(spec_of(tmp_path), np.random.default_rng(0))
    assert len({body.name for body in bodies}) == len(bodies) == 12
    source = object_source("procedural-train", tmp_path)
    for body in bodies[:4]:
        whole = source.load(body.name.partition("#")[0]).body
        ratio = body.mesh.extents / whole.mesh.extents
        assert 0.7 <= ratio.min() <= ratio.max() <= 0.9
        assert body.mass_kg == pytest.approx(whole.mass_kg * ratio[0] ** 3)


def test_a_run_goes_on_where_it_stopped(tmp_path: Path) -> None:
    options = ClutterOptions(
        "pile", 1, 1, 3, "oracle", objects="procedural-train", noise="none", workers=1, out=tmp_path
    )
    main(options)
    first = (tmp_path / "rounds.jsonl").read_text()
    main(replace(options, rounds=2))
    both = (tmp_path / "rounds.jsonl").read_text()
    assert both.startswith(first)
    assert both.count("\n") == 2
    assert "gsr_interval" in (tmp_path / "summary.json").read_text()
    main(options)
    assert (tmp_path / "rounds.jsonl").read_text() == both


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rounds": 0}, "--rounds is 0; expected 1 or more"),
        ({"first_seed": -1}, "--first-seed is -1; .*0 or more"),
        ({"detector": "split"}, "--detector split needs --checkpoint"),
        ({"detector": "split", "checkpoint": Path("none")}, "there is no file none"),
        (
            {"detector": "vng"},
            "--detector is 'vng'; expected one of giga, oracle, se3dif, se3dif_segments, split",
        ),
    ],
)
def test_bad_options_are_named(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ClutterOptions("pile", **{"detector": "oracle", **options})  # type: ignore[arg-type]


def test_a_folder_that_is_none_is_named(tmp_path: Path) -> None:
    options = ClutterOptions("pile", detector="oracle", objects=str(tmp_path / "none"))
    with pytest.raises(SystemExit, match=r"--objects: .*none is no folder"):
        main(options)


def test_an_error_ends_a_round_and_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(scene: Scene) -> PoseSet:
        raise KeyError("box")

    detecting(monkeypatch, fail)
    record = run_round(spec_of(tmp_path))
    assert (record.ended, record.detail) == (ERROR, "KeyError: 'box'")
    assert record.failed_to_run
