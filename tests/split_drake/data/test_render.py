"""The training renderer against exact geometry."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from split_drake.camera import DepthView, Intrinsics, look_at, pixel_rays
from split_drake.data.render import DepthRenderer, table_depth
from split_drake.objects.mugs.split import load_mug
from split_drake.objects.ray_caster import RayCaster
from split_drake.poses import make_pose
from split_drake.scene import Scene
from split_drake.station.layout import CameraPlacement, Layout

CAMERAS = Layout().cameras


def empty_table(camera: CameraPlacement) -> NDArray[np.float32]:
    return table_depth(pixel_rays(camera.intrinsics), camera.X_WC, 0.0)


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.name)
def test_table_lies_at_z_0(camera: CameraPlacement) -> None:
    corner = trimesh.creation.box((0.01, 0.01, 0.01))
    view = DepthRenderer(corner).render(make_pose(p=(0.5, 0.0, -0.1)), camera)
    assert np.array_equal(view.depth_m, empty_table(camera))
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
    assert np.array_equal(beyond, empty_table(camera))


def test_objects_behind_the_camera_are_refused() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    with pytest.raises(ValueError, match="behind the camera"):
        DepthRenderer(box).render(make_pose(p=(0.5, 0.0, 0.7)), CAMERAS[0])


def test_cameras_above_the_horizon_see_no_table_there() -> None:
    X_WC = look_at((0.0, 0.0, 0.5), (1.0, 0.0, 0.5))
    camera = CameraPlacement("level", Intrinsics.centered(40, 30, 30.0), X_WC)
    depth = empty_table(camera)
    assert np.isinf(depth[:15]).all()
    assert np.isfinite(depth[15:]).all()


def test_rays_report_the_first_face() -> None:
    caster = RayCaster(trimesh.creation.box((1.0, 1.0, 1.0)))
    distances, faces = caster.cast([[2.0, 0.1, 0.2], [2.0, 2.0, 0.0]], [[-2.0, 0, 0], [-1.0, 0, 0]])
    assert distances[0] == pytest.approx(0.75)
    assert np.isinf(distances[1])
    assert faces[1] == -1


def test_cosines_are_those_between_rays_and_surface() -> None:
    camera = CAMERAS[0]
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.04)
    X_WO = make_pose(p=(0.52, 0.03, 0.04))
    image = DepthRenderer(ball).trace(X_WO, camera)
    view = DepthView(image.depth_m, image.intrinsics, camera.X_WC)
    on_ball = image.depth_m < table_depth(pixel_rays(camera.intrinsics), camera.X_WC, 0.0)
    assert (image.cosines[~on_ball] == 1.0).all()
    p_WPs = view.points()[on_ball.ravel()]
    normals = (p_WPs - X_WO[:3, 3]) / 0.04
    rays = p_WPs - camera.X_WC[:3, 3]
    expected = -np.einsum("ni,ni->n", normals, rays) / np.linalg.norm(rays, axis=1)
    assert np.abs(image.cosines[on_ball] - expected).max() < 0.03
    assert image.cosines[on_ball].min() < 0.1


def test_a_rectangle_of_the_image_shows_the_same() -> None:
    camera, mug = CAMERAS[1], load_mug("train_002")
    X_WO, renderer = make_pose(p=(0.52, 0.03, 0.0)), DepthRenderer(mug.body.mesh)
    whole = renderer.render(X_WO, camera)
    part = renderer.trace(X_WO, camera, p_WShowns=np.array([[0.4, 0.0, 0.0]]))
    assert part.depth_m.size < whole.depth_m.size / 4
    cropped = DepthView(part.depth_m, part.intrinsics, camera.X_WC)
    assert np.allclose(cropped.points(0.001), whole.points(0.001), atol=1e-6)
    shown = cropped.points()
    assert np.linalg.norm(shown - (0.4, 0.0, 0.0), axis=1).min() < 0.002


def test_the_table_can_be_raised() -> None:
    camera = CAMERAS[1]
    box = trimesh.creation.box((0.01, 0.01, 0.01))
    image = DepthRenderer(box).trace(make_pose(p=(0.5, 0.0, -0.1)), camera, table_z_m=0.02)
    points = DepthView(image.depth_m, image.intrinsics, camera.X_WC).points()
    assert np.abs(points[:, 2] - 0.02).max() < 1e-5


def test_scenes_from_rendered_views_lie_on_the_mug() -> None:
    mug = load_mug("train_002")
    X_WO = make_pose(p=(0.52, 0.03, 0.0))
    renderer = DepthRenderer(mug.body.mesh)
    views = [renderer.render(X_WO, camera) for camera in CAMERAS]
    scene = Scene.from_views(views, Layout().workspace)
    lower, upper = mug.body.mesh.bounds + X_WO[:3, 3]
    assert scene.p_WSs.shape == (2000, 3)
    assert (scene.p_WSs > lower - 1e-4).all()
    assert (scene.p_WSs < upper + 1e-4).all()
