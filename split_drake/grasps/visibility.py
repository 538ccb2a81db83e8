"""Whether a scene shows where a grasp is (paper section V).

The paper asks how far the point where the grasp's approach vector meets the object's surface lies
from the scene's point cloud.  Here the ray runs from the middle of the palm along +z_G.  The hand
comes in along a free path, so nothing that it could grasp lies behind the palm.

Where that ray meets nothing as far as the pads' tips, as through a handle's opening or down into a
mug that is held across, what the hand closes on is elsewhere: then it is as good to see one of the
two places where the lines from the pads' centres along y_G meet the object.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from split_drake.objects.ray_caster import RayCaster
from split_drake.poses import Array, transform_points
from split_drake.robot.gripper import PAD_SIZE_M, PALM

VISIBLE_WITHIN_M = 0.005


class GraspVisibility:
    """Tells which of a set of grasps of one object a cloud shows.

    Args:
        mesh: of the object, in O.
        X_OGs: (N, 4, 4) grasps.
        openings_m: (N,) that the hand comes in with.
    """

    def __init__(self, mesh: trimesh.Trimesh, X_OGs: Array, openings_m: Array) -> None:
        caster = RayCaster(mesh)
        p_OApproaches, met, far = _approach_points(caster, X_OGs)
        points, grasps = [p_OApproaches[met]], [np.flatnonzero(met)]
        for side in (1.0, -1.0):
            p_OContacts, touched = _contact_points(caster, X_OGs, openings_m, side)
            points.append(p_OContacts[touched & far])
            grasps.append(np.flatnonzero(touched & far))
        self._count = len(X_OGs)
        self._p_OPoints = np.concatenate(points)
        self._grasps = np.concatenate(grasps)

    def visible(self, X_WO: Array, p_WPs: Array) -> NDArray[np.bool_]:
        """Return (N,): which grasps show, the object at X_WO and the cloud's points `p_WPs` (M, 3).

        The cloud is that without noise, before points are sampled from it.
        """
        tree = cKDTree(p_WPs, balanced_tree=False, compact_nodes=False)
        distances_m, _ = tree.query(
            transform_points(X_WO, self._p_OPoints), distance_upper_bound=VISIBLE_WITHIN_M
        )
        shown = np.zeros(self._count, dtype=bool)
        shown[self._grasps[np.isfinite(distances_m)]] = True
        return shown


def _approach_points(
    caster: RayCaster, X_OGs: Array
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where approaches meet the surface (N, 3), whether they do, and whether not in reach.

    Points of approaches that meet nothing are meaningless.
    """
    palm_z_m, tips_z_m = PALM.upper[2], PAD_SIZE_M[1] / 2.0
    z_OGs = X_OGs[:, :3, 2]
    p_OPalms = X_OGs[:, :3, 3] + palm_z_m * z_OGs
    distances_m, faces = caster.cast(p_OPalms, z_OGs)
    met = faces >= 0
    far = ~(distances_m < tips_z_m - palm_z_m)
    return p_OPalms + np.where(met, distances_m, 0.0)[:, None] * z_OGs, met, far


def _contact_points(
    caster: RayCaster, X_OGs: Array, openings_m: Array, side: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Return (N, 3) where the centre of the pad at y = side * opening / 2 touches, and if it does.

    Points of pads that touch nothing are meaningless.
    """
    outward = side * X_OGs[:, :3, 1]
    p_OPads = X_OGs[:, :3, 3] + openings_m[:, None] / 2.0 * outward
    distances_m, _ = caster.cast(p_OPads, -outward)
    touched = distances_m < openings_m
    return p_OPads - np.where(touched, distances_m, 0.0)[:, None] * outward, touched
