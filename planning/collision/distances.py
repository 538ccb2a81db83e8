"""Distances from points to the shapes that arm, hand and hook are made of, with numpy."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from pydrake.geometry import Capsule as DrakeCapsule
from pydrake.geometry import Role
from pydrake.planning import RobotDiagramBuilder

from split_drake.objects.rigid import Primitive
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.robot.gripper import Box
from split_drake.robot.panda import add_panda
from split_drake.station.fixtures import hook_primitives
from split_drake.station.layout import Layout


@dataclass(frozen=True)
class Capsule:
    """A capsule in its frame F.

    Attributes:
        p_FEnds: (2, 3) ends of its axis.
        radius_m: of the capsule.
    """

    p_FEnds: Array
    radius_m: float


def distance_to_segments(p_Ps: Array, p_As: Array, p_Bs: Array) -> Array:
    """Return distances (..., N) from points (..., N, 3) to segments from (..., 3) to (..., 3)."""
    along = p_Bs - p_As
    offsets = p_Ps - p_As[..., None, :]
    projected = (offsets @ along[..., None])[..., 0]
    squared = np.square(along).sum(axis=-1)[..., None]
    shares = np.clip(projected / np.maximum(squared, 1e-18), 0.0, 1.0)
    lengths = np.einsum("...j,...j->...", offsets, offsets)
    distances = lengths - shares * (2.0 * projected - shares * squared)
    return np.sqrt(np.maximum(distances, 0.0))


def distance_to_box(p_FPs: Array, box: Box) -> Array:
    """Return distances (...) from points (..., 3) to a box in the same frame; 0 inside."""
    outside = outside_box(p_FPs, box)
    return np.sqrt(np.einsum("...j,...j->...", outside, outside))


def outside_box(p_FPs: Array, box: Box) -> Array:
    """Return how far points (..., 3) are beyond a box's sides, (..., 3); 0 between them."""
    outside = np.abs(p_FPs - box.center)
    outside -= box.size / 2.0
    return np.maximum(outside, 0.0, out=outside)


def distance_to_solid(p_WPs: Array, solid: Primitive) -> Array:
    """Return distances (...) from points (..., 3) to a box or cylinder posed in W; 0 inside."""
    p_SPs = transform_points(invert_pose(solid.X_OP), p_WPs)
    if solid.kind == "box":
        half = np.asarray(solid.size) / 2.0
        return distance_to_box(p_SPs, Box(tuple(-half), tuple(half)))
    if solid.kind != "cylinder":
        raise ValueError(f"the solid is a {solid.kind}; expected a box or a cylinder")
    radius_m, length_m = solid.size
    beside = np.maximum(np.hypot(p_SPs[..., 0], p_SPs[..., 1]) - radius_m, 0.0)
    beyond = np.maximum(np.abs(p_SPs[..., 2]) - length_m / 2.0, 0.0)
    return np.asarray(np.hypot(beside, beyond))


@cache
def arm_capsules() -> tuple[tuple[int, Capsule], ...]:
    """Return the capsules of the arm's URDF with the number, 0 to 7, of the link each is fixed to.

    Raises ValueError where a link of the arm has a shape of another kind.
    """
    builder = RobotDiagramBuilder(time_step=0.001)
    add_panda(builder.plant())
    diagram = builder.Build()
    plant, inspector = diagram.plant(), diagram.scene_graph().model_inspector()
    found = []
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        body = plant.GetBodyFromFrameId(inspector.GetFrameId(geometry)).name()
        if not body.startswith("panda_link"):
            continue
        shape, X_LC = inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry)
        if not isinstance(shape, DrakeCapsule):
            raise ValueError(f"{body} has a collision shape {shape}; expected capsules")
        half = shape.length() / 2.0
        ends = transform_points(
            X_LC.GetAsMatrix4(), np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])
        )
        found.append((int(body.removeprefix("panda_link")), Capsule(ends, shape.radius())))
    return tuple(found)


def hook_capsules(layout: Layout) -> tuple[Capsule, Capsule]:
    """Return the peg and the post, both as capsules in W."""
    capsules = []
    for primitive in hook_primitives(layout):
        radius, length = primitive.size
        p_PEnds = np.array([[0.0, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0]])
        capsules.append(Capsule(transform_points(layout.X_WK @ primitive.X_OP, p_PEnds), radius))
    peg, post = capsules
    return peg, post
