"""What is said of a scene, and what looks wrong about it."""

import numpy as np
import pytest

from split_drake.camera import DepthView
from split_drake.data.render import DepthRenderer
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import Array, make_pose
from split_drake.scene import Scene, Workspace
from split_drake.sensing.scene_report import measured_points, report_of, table_height
from split_drake.station.layout import Layout

LAYOUT = Layout()
APART = np.array([0.05, 0.05, 0.0])


@pytest.fixture(scope="module")
def renderer() -> DepthRenderer:
    return DepthRenderer(load_mug("train_003").body.mesh)


def views(renderer: DepthRenderer, p: tuple[float, float, float]) -> list[DepthView]:
    return [renderer.render(make_pose(p=p), camera) for camera in LAYOUT.cameras]


def scene_and_points(
    shown: list[DepthView], workspace: Workspace = LAYOUT.workspace
) -> tuple[Scene, Array]:
    return Scene.from_views(shown, workspace), measured_points(shown)


def test_a_good_scene_has_numbers_and_no_warning(renderer: DepthRenderer) -> None:
    scene, points = scene_and_points(views(renderer, (0.5, 0.0, 0.0)))
    report = report_of(scene, points)
    assert report.warnings == ()
    assert report.objects == 1
    assert report.seen == len(points) > report.above_table == report.in_cube == len(scene.p_WPs)
    assert report.voxels == scene.grid().sum() > 100
    assert f"{report.voxels} voxels" in report.facts()[0]
    assert len(report.facts()) == 1


@pytest.mark.parametrize("error_m", [0.02, -0.02, 0.045])
def test_a_table_at_another_height_is_told(renderer: DepthRenderer, error_m: float) -> None:
    workspace = Workspace(p_WCenter=(0.5, 0.0, -error_m))
    scene, points = scene_and_points(views(renderer, (0.5, 0.0, 0.0)), workspace)
    assert table_height(points, workspace) == pytest.approx(0.0, abs=0.003)
    (warning,) = (w for w in report_of(scene, points).warnings if "table" in w)
    assert "the workspace has it at" in warning


def test_a_cloud_without_a_table_has_none(renderer: DepthRenderer) -> None:
    scene, _ = scene_and_points(views(renderer, (0.5, 0.0, 0.0)))
    assert table_height(scene.p_WPs, scene.workspace) is None
    assert table_height(np.empty((0, 3)), scene.workspace) is None


def test_what_goes_on_beyond_the_cube_is_told(renderer: DepthRenderer) -> None:
    scene, points = scene_and_points(views(renderer, (0.64, 0.0, 0.0)))
    assert any("beyond the cube's side +x" in w for w in report_of(scene, points).warnings)


def test_several_objects_few_points_and_blind_images_are_told(renderer: DepthRenderer) -> None:
    shown = views(renderer, (0.45, 0.0, 0.0))
    scene, points = scene_and_points(shown)
    both = np.concatenate([scene.p_WPs - APART, scene.p_WPs + 2.0 * APART])
    two = Scene.from_points(both, LAYOUT.workspace)
    assert "2 objects are in view; each is looked at alone" in report_of(two, both).warnings
    few = Scene.from_points(scene.p_WPs[::100], LAYOUT.workspace)
    assert any("points are in the cube: is the camera" in w for w in report_of(few, both).warnings)
    blind = shown[1].masked(np.ones_like(shown[1].depth_m, dtype=bool))
    half, _ = scene_and_points([shown[0], blind])
    assert "no pixel of image 2 shows anything" in report_of(half, points).warnings
