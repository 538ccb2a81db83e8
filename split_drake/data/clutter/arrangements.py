"""How objects lie in scenes of clutter: packed, standing side by side, or dropped into a pile."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import affinity

from split_drake.data.clutter.library import ClutterObject
from split_drake.poses import Array, make_pose, rotation_z
from split_drake.scene import Workspace

# Objects stand within this distance of the workspace's middle, along x and y.
SPREAD_M = 0.07
ATTEMPTS = 12
# Between what stands side by side.
GAP_M = 0.001


@dataclass(frozen=True)
class Arrangement:
    """Objects where they lie.

    Attributes:
        numbers: (K,) which of the objects given they are.
        X_WOs: (K, 4, 4) their poses.
    """

    numbers: tuple[int, ...]
    X_WOs: Array


def packed(
    objects: Sequence[ClutterObject], workspace: Workspace, rng: np.random.Generator
) -> Arrangement:
    """Return objects standing (z of O up) beside each other, none touching another.

    As many of them as `ATTEMPTS` random places have room for, one object after the other.
    """
    covered: list[shapely.Geometry] = []
    numbers, poses = list[int](), list[Array]()
    center = np.array(workspace.p_WCenter)
    for _ in range(ATTEMPTS):
        if len(numbers) == len(objects):
            break
        number = len(numbers)
        yaw = rng.uniform(0.0, 2.0 * np.pi)
        x, y = center[:2] + rng.uniform(-SPREAD_M, SPREAD_M, 2)
        turned = affinity.rotate(objects[number].footprint, yaw, origin=(0, 0), use_radians=True)
        footprint = affinity.translate(turned, x, y).buffer(GAP_M)
        if any(footprint.intersects(other) for other in covered):
            continue
        covered.append(footprint)
        numbers.append(number)
        poses.append(make_pose(rotation_z(yaw), (x, y, center[2] - objects[number].lowest_m)))
    return Arrangement(tuple(numbers), np.reshape(poses, (-1, 4, 4)))


def subsets(arrangement: Arrangement) -> Iterator[Arrangement]:
    """Yield the arrangement as it was after each of its objects came, the first alone first."""
    for count in range(1, len(arrangement.numbers) + 1):
        yield Arrangement(arrangement.numbers[:count], arrangement.X_WOs[:count])
