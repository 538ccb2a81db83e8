"""Walls around the workspace, which can be taken away."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody, SpatialInertia

from split_drake.objects.rigid import Primitive
from split_drake.poses import make_pose, rotation_z
from split_drake.scene import Workspace
from split_drake.station.fixtures import drake_shape

FENCE_BODY = "fence"

# Inner faces stand so far inside the cube (VGN's box stands at 0.02 m of a cube of 0.30 m), and
# reach as high as the cube is wide.  Walls are thick, so that nothing falls through them.
_INSET_M = 0.02
_THICKNESS_M = 0.05


def add_fence(plant: MultibodyPlant, workspace: Workspace) -> RigidBody:
    """Add four walls on one free body, whose frame is to be put at the workspace's centre."""
    fence = plant.AddRigidBody(
        FENCE_BODY, plant.AddModelInstance(FENCE_BODY), SpatialInertia.SolidSphereWithMass(1.0, 1.0)
    )
    for number, wall in enumerate(_walls(workspace)):
        plant.RegisterCollisionGeometry(
            fence,
            RigidTransform(wall.X_OP),
            drake_shape(wall),
            f"{FENCE_BODY}_{number}",
            CoulombFriction(1.0, 1.0),
        )
    return fence


def _walls(workspace: Workspace) -> tuple[Primitive, ...]:
    """Return the walls in the fence's frame."""
    inner_m, height_m = workspace.edge_m / 2.0 - _INSET_M, workspace.edge_m
    size = (_THICKNESS_M, 2.0 * (inner_m + _THICKNESS_M), height_m)
    X_FWall = make_pose(p=(inner_m + _THICKNESS_M / 2.0, 0.0, height_m / 2.0))
    quarters = np.arange(4) * np.pi / 2.0
    return tuple(Primitive("box", size, make_pose(rotation_z(a)) @ X_FWall) for a in quarters)
