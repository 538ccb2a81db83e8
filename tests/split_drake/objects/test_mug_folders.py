"""Runs on mugs from mesh files: names, checks before the first trial, and a whole trial."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from rich.console import Console

from planning.goals.hang import SUBGOAL as HANG
from scenarios.mug_hang import MugHangOptions, main, run_config, specs_of
from scenarios.trials.mug_check import MugCheck, read_grasps
from scenarios.trials.records import trial_run
from split_drake.experiments.provenance import file_sha256
from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.scanned.usable import usable_mugs
from split_drake.poses import make_pose, rotation_z
from tests.helpers.stations import STATION


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of one mug, turned and shifted, in a folder of its own."""
    folder = tmp_path_factory.mktemp("mugs")
    mesh = load_mug("test_004").body.mesh.copy()
    mesh.apply_transform(make_pose(rotation_z(1.0), (0.2, 0.1, 0.05)))
    (folder / "cup").mkdir()
    mesh.export(folder / "cup" / "mug.stl")
    return folder


def test_sources_are_a_split_or_a_folder(folder: Path, tmp_path: Path) -> None:
    assert MugSource(str(folder)).names() == ("cup",)
    assert len(MugSource("test").names()) == 40
    assert MugSource("test").mesh_sha256("test_000") is None
    with pytest.raises(ValueError, match=r"'nowhere'.*test.*folder of mesh files"):
        MugHangOptions(mugs="nowhere")
    with pytest.raises(FileNotFoundError, match="holds no mesh file"):
        MugSource(str(tmp_path)).names()


def test_a_mug_may_be_made_heavier(folder: Path, tmp_path: Path) -> None:
    spec = specs_of(MugHangOptions(mugs=str(folder)), tmp_path, ())[0]
    light, heavy = spec.load_mug("cup").body, replace(spec, mass_kg=0.5).load_mug("cup").body
    assert (light.mass_kg, heavy.mass_kg) == (0.3, 0.5)
    assert np.allclose(heavy.inertia_kg_m2 / 0.5, light.inertia_kg_m2 / 0.3)
    assert spec.task == HANG


def damaged_folder(folder: Path) -> Path:
    """Return a folder of a brick and of an empty file."""
    folder.mkdir()
    trimesh.creation.box((0.08, 0.08, 0.1)).export(folder / "brick.stl")
    (folder / "blank.obj").write_text("")
    return folder


def test_a_run_without_a_usable_mug_ends_before_any_trial(tmp_path: Path) -> None:
    bad, out = damaged_folder(tmp_path / "bad"), tmp_path / "out"
    with pytest.raises(InvalidMugError) as caught:
        main(MugHangOptions(mugs=str(bad), detector="oracle", workers=1, out=out))
    faults = str(caught.value).splitlines()[1:]
    assert len(faults) == 2
    assert "blank.obj is an empty file" in faults[0]
    assert "brick.stl: no upright round body" in faults[1]
    assert not trial_run(out).records()


def test_a_bad_mesh_costs_one_line(tmp_path: Path) -> None:
    bad = damaged_folder(tmp_path / "mixed")
    load_mug("test_004").body.mesh.export(bad / "good.stl")
    console = Console(width=40)
    with console.capture() as told:
        found = usable_mugs(MugSource(str(bad)), 1, console)
    lines = [line for line in told.get().splitlines() if "left out" in line]
    assert len(lines) == len(found.refused) == 2
    assert "brick.stl: no upright round body" in lines[1]
    assert found.source.names() == ("good",)
    assert set(MugSource(str(bad)).names()) == {"good", "brick", "blank"}
    options = MugHangOptions(mugs=str(bad))
    config = run_config(options, found)
    assert list(config["refused_meshes"]) == ["blank", "brick"]
    assert list(config["mesh_sha256"]) == ["good"]
    (spec, *_) = specs_of(options, tmp_path, (), found.source)
    assert spec.mug_names() == ("good",)


def test_bodies_that_the_station_has_already_are_refused(tmp_path: Path) -> None:
    load_mug("test_004").body.mesh.export(tmp_path / "table.stl")
    trial = MugCheck(STATION, None, tmp_path / "out")
    with pytest.raises(InvalidMugError, match=r"table.*expected one that is not taken"):
        usable_mugs(MugSource(str(tmp_path)), 1, Console(quiet=True), trial)


def test_a_trial_with_a_mug_from_a_file(folder: Path, tmp_path: Path) -> None:
    options = MugHangOptions(
        trials=1, mugs=str(folder), detector="oracle", workers=1, record="none", out=tmp_path
    )
    main(options)
    (record,) = trial_run(tmp_path).records()
    assert record.traceback is None, record.traceback
    assert record.succeeded, record.reason
    sha256 = file_sha256(folder / "cup" / "mug.stl")
    assert record.mesh_sha256 == sha256
    assert run_config(options)["mesh_sha256"] == {"cup": sha256}
    labels = read_grasps(tmp_path, "cup")
    assert len(labels.X_OGs) == len(labels.openings_m) > 100
    # The robot moved, and kept within its limits.
    assert 0.1 < record.peaks["velocity_share"] <= 1.0
    assert 0.1 < record.peaks["torque_share"] <= 1.0
    assert 0.0 < record.peaks["pad_depth_m"] <= 0.002
    assert record.exceeded == ()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["worst_peaks"] == record.peaks
