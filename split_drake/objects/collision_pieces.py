"""Collision pieces that bodies of revolution and handles are put together from."""

import numpy as np

from split_drake.objects.rigid import Primitive
from split_drake.poses import Array, make_pose


def ring_of_boxes(lower: Array, upper: Array, wall_m: float, count: int) -> list[Primitive]:
    """Return `count` boxes whose outer faces follow a wall from `lower` to `upper`.

    The ends (2,) are radius and height of O; the wall is `wall_m` thick, measured across it.  The
    polygon's faces lie half their sagitta inside the circle, its edges half outside.
    """
    fit = (1.0 + np.cos(np.pi / count)) / 2.0
    along = np.array([(upper[0] - lower[0]) * fit, upper[1] - lower[1]])
    length = float(np.linalg.norm(along))
    along /= length
    inward = np.array([-along[1], along[0]])
    middle = np.array([(lower[0] + upper[0]) / 2.0 * fit, (lower[1] + upper[1]) / 2.0])
    center = middle + inward * wall_m / 2.0
    width = 2.0 * float(np.tan(np.pi / count) * max(lower[0], upper[0]) * fit)
    boxes = []
    for angle in 2.0 * np.pi * np.arange(count) / count:
        radial = np.array([np.cos(angle), np.sin(angle), 0.0])
        x = -inward[0] * radial - (0.0, 0.0, inward[1])
        z = along[0] * radial + (0.0, 0.0, along[1])
        X_OP = make_pose(np.column_stack([x, np.cross(z, x), z]), center[0] * radial)
        X_OP[2, 3] = center[1]
        boxes.append(Primitive("box", (wall_m, width, length), X_OP))
    return boxes


def capsule(p_OA: Array, p_OB: Array, radius_m: float) -> Primitive:
    """Return a capsule around the segment from `p_OA` to `p_OB`, both (3,), which isn't along y."""
    z = p_OB - p_OA
    length = float(np.linalg.norm(z))
    z = z / length
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    R_OP = np.column_stack([x, np.cross(z, x), z])
    return Primitive("capsule", (radius_m, length), make_pose(R_OP, (p_OA + p_OB) / 2.0))
