"""Objects of a scene."""

import numpy as np
import pytest

from split_drake.objects_in_view import (
    ObjectInView,
    objects_in_view,
    owners,
    scenes_of_objects,
)
from split_drake.poses import Array, make_pose
from split_drake.scene import Scene, Workspace
from tests.helpers.clutter import box_cloud

LEFT, RIGHT = (0.45, 0.05), (0.55, -0.05)


def two_boxes() -> Array:
    """Return the cloud of a large box on the left and of a smaller one on the right."""
    left, right = box_cloud(LEFT, (0.06, 0.06, 0.10)), box_cloud(RIGHT, (0.04, 0.04, 0.05))
    return np.concatenate([right, left])


def test_objects_that_stand_apart_are_told_apart() -> None:
    cloud = two_boxes()
    large, small = objects_in_view(cloud)
    assert len(large.p_WPs) > len(small.p_WPs)
    assert len(large.p_WPs) + len(small.p_WPs) == len(cloud)
    np.testing.assert_array_equal(cloud[large.points], large.p_WPs)
    assert np.abs(large.p_WPs[:, :2] - LEFT).max() < 0.031
    assert np.abs(small.p_WPs[:, :2] - RIGHT).max() < 0.021


def test_what_an_object_hides_of_itself_does_not_part_it() -> None:
    cloud = box_cloud(LEFT, (0.06, 0.06, 0.10))
    gap = np.abs(cloud[:, 2] - 0.05) < 0.005
    assert len(objects_in_view(cloud[~gap])) == 1
    wide = np.abs(cloud[:, 2] - 0.05) < 0.02
    assert len(objects_in_view(cloud[~wide])) == 2


def test_a_fragment_near_an_object_is_part_of_it() -> None:
    cloud = box_cloud(LEFT, (0.06, 0.06, 0.10))
    handle = box_cloud((LEFT[0] - 0.055, LEFT[1]), (0.006, 0.012, 0.02))
    far = box_cloud((LEFT[0] - 0.10, LEFT[1]), (0.006, 0.012, 0.02))
    assert len(objects_in_view(np.concatenate([handle, cloud]))) == 1
    assert len(objects_in_view(np.concatenate([far, cloud]))) == 2


@pytest.mark.parametrize(("beside_m", "objects"), [(0.0, 1), (0.006, 1), (0.012, 2)])
def test_a_handle_below_what_hides_it_is_part_of_it(beside_m: float, objects: int) -> None:
    body = np.add(box_cloud(LEFT, (0.08, 0.08, 0.06)), (0.0, 0.0, 0.045))
    edge = LEFT[0] - 0.04 - beside_m
    handle = box_cloud((edge - 0.015, LEFT[1]), (0.03, 0.05, 0.015))
    assert len(objects_in_view(np.concatenate([body, handle]))) == objects
    # As large as that, it is another object.
    large = box_cloud((edge - 0.06, LEFT[1]), (0.12, 0.12, 0.015))
    assert len(objects_in_view(np.concatenate([body, large]))) == 2


def test_a_fragment_of_a_fragment_is_part_of_the_whole() -> None:
    cloud = box_cloud(LEFT, (0.06, 0.06, 0.10))
    handle = box_cloud((LEFT[0] - 0.055, LEFT[1]), (0.006, 0.012, 0.02))
    tip = box_cloud((LEFT[0] - 0.085, LEFT[1]), (0.006, 0.012, 0.012))
    assert len(objects_in_view(np.concatenate([cloud, tip]))) == 2
    assert len(objects_in_view(np.concatenate([cloud, handle, tip]))) == 1


def test_specks_and_flying_points_are_no_objects() -> None:
    dense = np.repeat(two_boxes(), 8, axis=0)
    between = np.linspace((*LEFT, 0.02), (*RIGHT, 0.02), 40)
    noise = np.random.default_rng(0).uniform(-0.004, 0.004, (80, 3))
    speck = np.add(noise, (0.5, 0.1, 0.1))
    cloud = np.concatenate([dense, between, speck])
    assert len(objects_in_view(cloud)) == 2
    assert objects_in_view(np.empty((0, 3))) == []


def test_poses_belong_to_the_object_that_they_are_at() -> None:
    objects = objects_in_view(two_boxes())
    at = [(*LEFT, 0.09), (*RIGHT, 0.03), (LEFT[0], LEFT[1] - 0.04, 0.05), (*RIGHT, 0.07)]
    X_WPs = make_pose(p=np.array(at))
    assert owners(X_WPs, objects).tolist() == [0, 1, 0, 1]
    assert owners(np.empty((0, 4, 4)), objects).tolist() == []


def test_what_is_flat_has_poses_too() -> None:
    flat = np.zeros((100, 3))
    flat[:, :2] = np.random.default_rng(0).uniform(0.0, 0.05, (100, 2))
    sheet = ObjectInView(np.ones(100, dtype=bool), flat)
    far = ObjectInView(np.ones(100, dtype=bool), np.add(flat, (0.2, 0.0, 0.0)))
    assert owners(make_pose(p=np.array([[0.02, 0.02, 0.01]])), [far, sheet]).tolist() == [1]


def test_without_objects_there_is_no_owner() -> None:
    with pytest.raises(ValueError, match="no object for poses to belong to"):
        owners(make_pose()[None], [])


def test_each_object_has_a_scene_of_its_own() -> None:
    cloud = two_boxes()
    both = Scene(cloud, cloud[:2000], Workspace())
    large, small = scenes_of_objects(both)
    assert len(large.p_WPs) + len(small.p_WPs) == len(cloud)
    for scene, middle in ((large, LEFT), (small, RIGHT)):
        assert scene.p_WSs.shape == (2000, 3)
        assert np.abs(scene.p_WSs[:, :2] - middle).max() < 0.031
        assert scene.workspace == both.workspace
    assert scenes_of_objects(large) == [large]


@pytest.mark.parametrize(("edge_m", "count"), [(0.052, 1), (0.080, 2)])
def test_what_lies_below_an_edge_is_of_what_hides_it_unless_it_is_large(
    edge_m: float, count: int
) -> None:
    def plate(x_m: float, size_m: float, z_m: float) -> Array:
        steps = np.arange(0.0, size_m, 0.002)
        x, y = np.meshgrid(x_m + steps, steps)
        return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z_m)])

    above, below = plate(0.0, 0.112, 0.06), plate(0.11, edge_m, 0.03)
    assert len(objects_in_view(np.concatenate([above, below]))) == count
