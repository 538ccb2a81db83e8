"""Properties of thinned and completed clouds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from planning.geometry.perceived import (
    DETAIL_VOXEL_M,
    OBSTACLE_VOXEL_M,
    PerceivedObject,
    centre_of_mass,
    revolved_body,
    voxel_centroids,
)
from split_drake.poses import Array, invert_pose, make_pose, transform_points
from tests.helpers.planning import HEIGHT_M, LYING, RADIUS_M, STANDING, mug_cloud

seeds = st.integers(0, 2**32 - 1)


def cloud(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return rng.normal(scale=0.02, size=(rng.integers(1, 300), 3))


@given(seeds, st.floats(0.002, 0.1))
def test_every_point_is_near_the_centroid_of_its_voxel(seed: int, edge_m: float) -> None:
    points = cloud(seed)
    centroids = voxel_centroids(points, edge_m)
    cells = np.floor(points / edge_m).astype(int)
    assert len(centroids) == len(np.unique(cells, axis=0))
    assert np.max(KDTree(centroids).query(points)[0]) <= np.sqrt(3.0) * edge_m
    shuffled = np.random.default_rng(seed).permutation(points)
    np.testing.assert_allclose(voxel_centroids(shuffled, edge_m), centroids, atol=1e-12)


def test_one_voxel_is_the_mean_and_none_is_nothing() -> None:
    points = np.random.default_rng(0).uniform(0.0, 0.01, (50, 3))
    np.testing.assert_allclose(voxel_centroids(points, 1.0), [points.mean(axis=0)])
    assert voxel_centroids(np.empty((0, 3)), 0.01).shape == (0, 3)


@given(seeds)
def test_a_body_is_completed_within_what_was_seen_of_it(seed: int) -> None:
    """Rings about the axis reach no further out, up or down than points do away from the handle."""
    rng = np.random.default_rng(seed)
    X_WU = make_pose(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))
    toward = rng.normal(size=2)
    p_UPs = mug_cloud()[::7]
    seen = p_UPs[p_UPs[:, :2] @ toward > 0.0]
    p_UBody = transform_points(invert_pose(X_WU), revolved_body(transform_points(X_WU, seen), X_WU))
    assert np.hypot(p_UBody[:, 0], p_UBody[:, 1]).max() <= RADIUS_M + 1e-9
    assert p_UBody[:, 2].min() >= -1e-9 and p_UBody[:, 2].max() <= HEIGHT_M + 1e-9
    azimuths = np.sort(np.arctan2(*p_UBody[np.hypot(*p_UBody[:, :2].T) > 0.03].T[:2]))
    assert np.diff(azimuths).max() < 2.0 * OBSTACLE_VOXEL_M / 0.03, "all around"


def test_where_only_the_handles_side_is_seen_nothing_is_completed() -> None:
    p_UPs = mug_cloud()
    front = p_UPs[(p_UPs[:, 0] > 0.01) & (np.abs(p_UPs[:, 1]) < 0.9 * p_UPs[:, 0])]
    assert revolved_body(front, np.eye(4)).shape == (0, 3)
    target = PerceivedObject.from_cloud(front, np.eye(4), 0.0)
    np.testing.assert_array_equal(target.p_WSurface, target.p_WDetails)


@pytest.mark.parametrize("X_WO", [STANDING, LYING], ids=["standing", "lying"])
def test_what_is_completed_comes_after_what_was_seen_and_above_the_table(X_WO: Array) -> None:
    p_WPs = transform_points(X_WO, mug_cloud()[mug_cloud()[:, 1] > 0.0])
    # A pose detected 5 mm too low completes the body into the table.
    low = make_pose(p=(0.0, 0.0, -0.005)) @ X_WO
    target = PerceivedObject.from_cloud(p_WPs, low, 0.0)
    seen = len(target.p_WDetails)
    np.testing.assert_array_equal(target.p_WSurface[:seen], voxel_centroids(p_WPs, DETAIL_VOXEL_M))
    assert len(target.p_WSurface) > seen and target.p_WSurface[seen:, 2].min() > 0.0
    np.testing.assert_array_equal(target.p_WCom, centre_of_mass(target.p_WObstacles, low))


@pytest.mark.parametrize("X_WO", [STANDING, LYING], ids=["standing", "lying"])
def test_a_base_that_no_camera_sees_counts_in_the_centre_of_mass(X_WO: Array) -> None:
    """A cup of thin walls: 2 pi r h of wall with its middle at h / 2, pi r^2 of base at 0."""
    radius, height = 0.04, 0.09
    angles, heights = np.meshgrid(np.arange(0.0, 2.0 * np.pi, 0.1), np.arange(0.002, height, 0.004))
    walls = [
        np.column_stack([r * np.cos(angles.ravel()), r * np.sin(angles.ravel()), heights.ravel()])
        for r in (radius, radius - 0.003)
    ]
    seen = transform_points(X_WO, np.concatenate(walls))
    target = PerceivedObject.from_cloud(seen, X_WO, seen[:, 2].min() - 0.01)
    p_OCom = transform_points(invert_pose(X_WO), target.p_WCom[None])[0]
    true_m = height**2 / (2.0 * height + radius)
    np.testing.assert_allclose(p_OCom, [0.0, 0.0, true_m], atol=0.004)
    assert abs(p_OCom[2] - true_m) < 0.5 * (height / 2.0 - true_m), "nearer than the walls' middle"


def test_without_an_upright_pose_the_object_is_what_was_seen() -> None:
    p_WPs = transform_points(STANDING, mug_cloud())
    target = PerceivedObject.from_cloud(p_WPs, None, 0.0)
    np.testing.assert_array_equal(target.p_WSurface, target.p_WDetails)
    assert len(target.p_WObstacles) < len(target.p_WDetails) < len(p_WPs)
