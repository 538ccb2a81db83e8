"""Whether a parallel gripper could hold a shape at all, by rays through its mesh."""

import numpy as np
import trimesh

from split_drake.objects.ray_caster import RayCaster

MAX_WIDTH_M = 0.076
MIN_WIDTH_M = 0.003
# Pads with friction 0.5 hold faces this far from parallel.
_MAX_ANGLE_RAD = np.arctan(0.5)
# A finger beside a face takes this much room.
_FINGER_M = 0.015
# Rays start off the face that they leave.
_STEP_M = 1e-5


def antipodal_share(
    mesh: trimesh.Trimesh, max_width_m: float = MAX_WIDTH_M, count: int = 500, seed: int = 0
) -> float:
    """Return the share of surface points at which two opposite pads could hold the closed mesh.

    The faces on either side of the material are parallel within the cone of friction and at most
    `max_width_m` apart, and a finger has room beside both.  Nothing is said of where the hand is.
    """
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=seed)
    normals, caster = mesh.face_normals[faces], RayCaster(mesh)
    width_m, opposite = caster.cast(points - _STEP_M * normals, -normals)
    hits = opposite >= 0
    points, normals = points[hits], normals[hits]
    width_m, far_normals = width_m[hits], mesh.face_normals[opposite[hits]]
    far_points = points - width_m[:, None] * normals
    near_room_m, _ = caster.cast(points + _STEP_M * normals, normals)
    far_room_m, _ = caster.cast(far_points - 3.0 * _STEP_M * normals, -normals)
    parallel = np.einsum("ni,ni->n", normals, far_normals) < -np.cos(_MAX_ANGLE_RAD)
    thin = (width_m > MIN_WIDTH_M) & (width_m < max_width_m)
    room = np.minimum(near_room_m, far_room_m) > _FINGER_M
    return float((parallel & thin & room).sum() / count)
