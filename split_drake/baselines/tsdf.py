"""A truncated signed distance field of depth views, as VGN and GIGA take it.

Curless and Levoy, "A volumetric method for building complex models from range images", 1996.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from split_drake.camera import DepthView, project
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.scene import Workspace

RESOLUTION = 40
# The field is cut off at so many voxels from the surface.
TRUNCATION_VOXELS = 4.0
# Where nothing was seen, and in free space: voxels are kept where the distance is less than this
# share of the truncation, as by Open3D's `extract_voxel_point_cloud`, which VGN and GIGA read.
# With free space at 1, the authors' weights find next to nothing.
UNSEEN = 0.0
KEPT_SHARE = 0.98


def fused_tsdf(
    views: Sequence[DepthView], workspace: Workspace, resolution: int = RESOLUTION
) -> NDArray[np.float32]:
    """Return the field (r, r, r) of a workspace's cube, indexed [x, y, z] from V, in [0, 1].

    A voxel near the surface, which is at 0.5, has the mean over the views that see it, of the
    distance along the ray from its middle to the surface: 1 at the truncation before the surface
    and 0 behind it.  All other voxels have `UNSEEN`.

    Raises ValueError where there is no view.
    """
    if not views:
        raise ValueError("the scene has no depth views; expected one at least, to make a TSDF of")
    voxel_m = workspace.edge_m / resolution
    steps = (np.arange(resolution) + 0.5) * voxel_m
    p_VPs = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    p_WPs = p_VPs + workspace.p_WV
    sums, counts = np.zeros(len(p_WPs)), np.zeros(len(p_WPs))
    for view in views:
        distances, seen = _signed_distances(view, p_WPs, TRUNCATION_VOXELS * voxel_m)
        sums[seen] += distances[seen]
        counts += seen
    means = sums / np.maximum(counts, 1.0)
    kept = (counts > 0.0) & (np.abs(means) < KEPT_SHARE)
    field = np.where(kept, (means + 1.0) / 2.0, UNSEEN)
    return field.reshape((resolution,) * 3).astype(np.float32)


def _signed_distances(
    view: DepthView, p_WPs: Array, truncation_m: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Return (N,) distances of points (N, 3) before the surface, in truncations, and which count.

    A pixel that saw nothing says nothing of its ray.
    """
    p_CPs = transform_points(invert_pose(view.X_WC), p_WPs)
    before = p_CPs[:, 2] > 1e-6
    depth_m, inside = np.zeros(len(p_WPs)), np.zeros(len(p_WPs), dtype=bool)
    pixels = np.round(project(p_WPs[before], view.intrinsics, view.X_WC)).astype(int)
    within = np.all((pixels >= 0) & (pixels < view.depth_m.shape[::-1]), axis=1)
    inside[np.flatnonzero(before)[within]] = True
    u, v = pixels[within].T
    depth_m[inside] = view.depth_m[v, u]
    measured = inside & (depth_m > 0.0) & np.isfinite(depth_m)
    safe_z = np.where(before, p_CPs[:, 2], 1.0)
    along_ray = np.linalg.norm(p_CPs, axis=1) / safe_z
    ahead = np.where(measured, (depth_m - p_CPs[:, 2]) * along_ray / truncation_m, -np.inf)
    return np.clip(ahead, -1.0, 1.0), measured & (ahead >= -1.0)
