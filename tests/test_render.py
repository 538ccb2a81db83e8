"""The training renderer against exact geometry, and resting poses."""

import numpy as np
import pytest
import trimesh

from split_drake.camera import Intrinsics, look_at
from split_drake.data.mugs import load_mug
from split_drake.data.placements import UPSIDE_DOWN_COS, PlacementConfig, RestingPoses
from split_drake.data.render import DepthRenderer, RayCaster, table_depth
from split_drake.layout import CameraPlacement, Layout
from split_drake.poses import make_pose, transform_points
from split_drake.scene import Scene, Workspace

CAMERAS = Layout().cameras


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_table_lies_at_z_0(camera: CameraPlacement) -> None:
    corner = trimesh.creation.box((0.01, 0.01, 0.01))
    view = DepthRenderer(corner).render(make_pose(p=(0.5, 0.0, -0.1)), camera)
    assert np.array_equal(view.depth_m, table_depth(camera))
    assert np.abs(view.points()[:, 2]).max() < 1e-5


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_sphere_is_seen_where_it_is(camera: CameraPlacement) -> None:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.04)
    center = np.array([0.53, -0.04, 0.06])
    points = DepthRenderer(sphere).render(make_pose(p=center), camera).points(0.001)
    assert len(points) > 3000
    assert np.abs(np.linalg.norm(points - center, axis=1) - 0.04).max() < 2e-4


def test_nearer_surfaces_hide_the_table() -> None:
    camera = CAMERAS[0]
    box = trimesh.creation.box((0.06, 0.06, 0.08))
    depth = DepthRenderer(box).render(make_pose(p=(0.5, 0.0, 0.04)), camera).depth_m
    assert depth[240, 320] == pytest.approx(0.6 - 0.08, abs=1e-5)
    assert depth[10, 10] == pytest.approx(0.6, abs=1e-5)


def test_objects_partly_outside_the_image_are_cut() -> None:
    camera = CAMERAS[0]
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    depth = DepthRenderer(box).render(make_pose(p=(0.5, 0.36, 0.05)), camera).depth_m
    near = depth < 0.55
    assert near.any()
    assert near[:, 0].any() or near[:, -1].any()
    beyond = DepthRenderer(box).render(make_pose(p=(0.5, 3.0, 0.05)), camera).depth_m
    assert np.array_equal(beyond, table_depth(camera))


def test_objects_behind_the_camera_are_refused() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    with pytest.raises(ValueError, match="behind the camera"):
        DepthRenderer(box).render(make_pose(p=(0.5, 0.0, 0.7)), CAMERAS[0])


def test_cameras_above_the_horizon_see_no_table_there() -> None:
    X_WC = look_at((0.0, 0.0, 0.5), (1.0, 0.0, 0.5))
    camera = CameraPlacement("level", Intrinsics.centered(40, 30, 30.0), X_WC)
    depth = table_depth(camera)
    assert np.isinf(depth[:15]).all()
    assert np.isfinite(depth[15:]).all()


def test_rays_report_the_first_face() -> None:
    caster = RayCaster(trimesh.creation.box((1.0, 1.0, 1.0)))
    distances, faces = caster.cast([[2.0, 0.1, 0.2], [2.0, 2.0, 0.0]], [[-2.0, 0, 0], [-1.0, 0, 0]])
    assert distances[0] == pytest.approx(0.75)
    assert np.isinf(distances[1])
    assert faces[1] == -1


@pytest.fixture(scope="module")
def resting() -> RestingPoses:
    body = load_mug("train_002").body
    return RestingPoses(body.mesh, body.p_OCom, Workspace())


def test_resting_mugs_lie_on_the_table_in_the_workspace(resting: RestingPoses) -> None:
    mesh, rng = load_mug("train_002").body.mesh, np.random.default_rng(0)
    half = Workspace().edge_m / 2.0
    for _ in range(60):
        X_WO = resting.sample(rng)
        p_Ws = transform_points(X_WO, mesh.vertices)
        assert p_Ws[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        assert np.abs(p_Ws[:, :2] - (0.5, 0.0)).max() < half


def test_mugs_stand_lie_and_are_never_upside_down(resting: RestingPoses) -> None:
    rng = np.random.default_rng(1)
    cosines = np.array([resting.sample(rng)[2, 2] for _ in range(400)])
    tilt = 5.0 * PlacementConfig().tilt_rad
    assert cosines.min() > UPSIDE_DOWN_COS - tilt
    assert 0.2 < (cosines > 0.9).mean() < 0.6
    assert (np.abs(cosines) < 0.5).mean() > 0.3


def test_draws_follow_the_seed(resting: RestingPoses) -> None:
    first = resting.sample(np.random.default_rng(5))
    assert np.array_equal(first, resting.sample(np.random.default_rng(5)))


def test_large_objects_and_wrong_shares_are_refused() -> None:
    plate = trimesh.creation.box((0.4, 0.4, 0.01))
    resting = RestingPoses(plate, np.zeros(3), Workspace())
    with pytest.raises(ValueError, match="does not fit the workspace"):
        resting.sample(np.random.default_rng(0))
    with pytest.raises(ValueError, match="add up to 1"):
        PlacementConfig(upright_share=0.8, rare_share=0.3)


def test_scenes_from_rendered_views_lie_on_the_mug() -> None:
    mug = load_mug("train_002")
    X_WO = make_pose(p=(0.52, 0.03, 0.0))
    renderer = DepthRenderer(mug.body.mesh)
    scene = Scene.from_views([renderer.render(X_WO, camera) for camera in CAMERAS])
    lower, upper = mug.body.mesh.bounds + X_WO[:3, 3]
    assert scene.p_WSs.shape == (2000, 3)
    assert (scene.p_WSs > lower - 1e-4).all()
    assert (scene.p_WSs < upper + 1e-4).all()
