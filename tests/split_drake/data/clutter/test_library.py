"""The grasps of objects of clutter."""

from pathlib import Path

import numpy as np
import pytest

from split_drake.data.clutter import library as library_module
from split_drake.data.clutter.labels import clears_table
from split_drake.data.clutter.library import (
    MAX_WIDTH_M,
    THIN_KEPT,
    ClutterObject,
    GraspLibrary,
    object_grasps,
)
from split_drake.grasps.clutter_judge import ClutterJudge
from split_drake.grasps.judge import GraspJudge
from split_drake.grasps.lying import resting_poses
from split_drake.robot.gripper import MAX_OPENING_M
from tests.helpers.damage import times_told
from tests.split_drake.data.clutter.conftest import BODIES, Blocks, write_library
from tests.split_drake.station.solids import solid_box


def test_a_wide_open_hand_can_take_every_grasp(library: GraspLibrary) -> None:
    for name in ("bar", "can"):
        grasps, judge = library.grasps[name], GraspJudge(BODIES[name].mesh)
        wide = np.full(len(grasps.X_OGs), MAX_OPENING_M)
        assert len(grasps.X_OGs) >= 50
        assert not judge.collides(grasps.X_OGs, wide).any()
        assert (grasps.weights > 0.0).all() and (grasps.weights <= 1.0).all()


def test_a_bar_is_pinched_across_what_is_narrow_enough(library: GraspLibrary) -> None:
    closing_O = np.abs(library.grasps["bar"].X_OGs[:, :3, 1])
    assert not (closing_O.argmax(axis=1) == 1).any(), "9 cm are wider than the hand"


def test_a_bar_that_lies_flat_is_taken_from_above(library: GraspLibrary) -> None:
    bar = BODIES["bar"]
    X_TO = resting_poses(bar.mesh, bar.p_OCom)[0]
    X_TGs = X_TO @ library.grasps["bar"].X_OGs
    straight_down = X_TGs[:, 2, 2] < -0.9
    assert straight_down.sum() > 20
    assert clears_table(X_TGs[straight_down], 0.0).mean() > 0.3


def test_what_is_too_wide_has_no_grasps(library: GraspLibrary) -> None:
    assert min(BODIES["slab"].mesh.extents) > MAX_WIDTH_M
    grasps = library.grasps["slab"]
    assert (len(grasps.X_OGs), len(grasps.weights), len(grasps.X_OFs)) == (0, 0, 0)


def test_walls_that_are_too_thin_are_false() -> None:
    sheet = solid_box("sheet", (0.004, 0.09, 0.09))
    grasps = object_grasps(sheet, np.random.default_rng(0))
    assert (len(grasps.X_OGs), len(grasps.weights)) == (0, 0)
    assert len(grasps.X_OFs) == THIN_KEPT
    closing_O = np.abs(grasps.X_OFs[:, :3, 1])
    assert (closing_O.argmax(axis=1) == 0).mean() > 0.8, "across the sheet"
    assert not ClutterJudge(sheet.mesh, -0.1).check(grasps.X_OFs).good.any()


def test_a_library_survives_its_file(library: GraspLibrary, tmp_path: Path) -> None:
    path = tmp_path / "library.npz"
    library.save(path)
    read = GraspLibrary.load(path, Blocks())
    assert list(read.grasps) == list(library.grasps)
    for name, grasps in library.grasps.items():
        np.testing.assert_allclose(read.grasps[name].X_OGs, grasps.X_OGs, atol=1e-6)
        np.testing.assert_allclose(read.grasps[name].weights, grasps.weights, atol=1e-6)
        np.testing.assert_allclose(read.grasps[name].X_OFs, grasps.X_OFs, atol=1e-6)


def test_missing_libraries_and_those_of_other_objects_are_refused(
    library: GraspLibrary, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=r"none\.npz does not exist; python -m .* makes it"):
        GraspLibrary.load(tmp_path / "none.npz", Blocks())
    path = tmp_path / "library.npz"
    GraspLibrary("cubes", library.grasps).save(path)
    with pytest.raises(ValueError, match="holds grasps of other objects"):
        GraspLibrary.load(path, Blocks())


def test_an_object_knows_what_it_covers(can: ClutterObject) -> None:
    assert can.footprint.area == pytest.approx(np.pi * 0.025**2, rel=0.02)
    assert can.lowest_m == 0.0
    radii = np.hypot(*can.p_OSurface[:, :2].T)
    assert radii.max() == pytest.approx(0.025, abs=1e-3)


def test_a_damaged_library_is_told_with_its_path(library: GraspLibrary, tmp_path: Path) -> None:
    path = tmp_path / "library.npz"
    library.save(path)
    assert times_told(path, lambda given: GraspLibrary.load(given, Blocks())) > 50


def test_objects_that_are_worked_out_are_not_worked_out_again(
    tmp_path: Path, library: GraspLibrary, monkeypatch: pytest.MonkeyPatch
) -> None:
    class CutShortError(Exception):
        """Ends the work at the last object."""

    def stop(source: Blocks, name: str) -> None:
        raise CutShortError

    file, work = tmp_path / "blocks.npz", library_module._grasps_of
    monkeypatch.setattr(
        library_module,
        "_grasps_of",
        lambda source, name: (stop if name == "slab" else work)(source, name),
    )
    with pytest.raises(CutShortError):
        write_library(Blocks(), file)
    assert not file.exists()
    monkeypatch.setattr(
        library_module,
        "_grasps_of",
        lambda source, name: (work if name == "slab" else stop)(source, name),
    )
    write_library(Blocks(), file)
    found = GraspLibrary.load(file, Blocks())
    assert list(found.grasps) == list(library.grasps)
    for name, grasps in library.grasps.items():
        np.testing.assert_array_equal(found.grasps[name].X_OGs, grasps.X_OGs)
    assert list(tmp_path.iterdir()) == [file]
