"""Distances to boxes and cylinders, held against points on their surfaces."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from planning.collision.distances import distance_to_solid
from split_drake.objects.rigid import Primitive
from split_drake.poses import invert_pose, make_pose, rotation_x, transform_points

X_WS = make_pose(rotation_x(0.7), (0.3, -0.1, 0.2))
BOX = Primitive("box", (0.1, 0.06, 0.2), X_WS)
CYLINDER = Primitive("cylinder", (0.04, 0.15), X_WS)


@pytest.mark.parametrize("solid", [BOX, CYLINDER], ids=["box", "cylinder"])
def test_distances_are_those_to_the_nearest_point_of_the_solid(solid: Primitive) -> None:
    rng = np.random.default_rng(0)
    inside = rng.uniform(-0.11, 0.11, size=(400_000, 3))
    if solid.kind == "box":
        inside = inside[np.all(np.abs(inside) <= np.array(solid.size) / 2.0, axis=1)]
    else:
        radius, length = solid.size
        within = (np.hypot(inside[:, 0], inside[:, 1]) <= radius) & (
            np.abs(inside[:, 2]) <= length / 2.0
        )
        inside = inside[within]
    points = transform_points(X_WS, rng.uniform(-0.25, 0.25, size=(300, 3)))
    nearest = np.asarray(cKDTree(inside).query(transform_points(invert_pose(X_WS), points))[0])
    found = distance_to_solid(points, solid)
    np.testing.assert_allclose(found[nearest > 0.01], nearest[nearest > 0.01], atol=4e-3)
    assert np.all(found[nearest < 1e-3] < 1e-3)
    batched = distance_to_solid(points.reshape(3, 100, 3), solid)
    np.testing.assert_array_equal(batched.ravel(), found)


def test_other_shapes_are_refused() -> None:
    with pytest.raises(ValueError, match="is a sphere; expected a box or a cylinder"):
        distance_to_solid(np.zeros((1, 3)), Primitive("sphere", (0.1,), X_WS))
