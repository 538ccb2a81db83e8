"""Depth images of one mesh on the table, by ray casting: what the training scenes are made of."""

from functools import lru_cache

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import ArrayLike, NDArray

from split_drake.camera import DepthView, Intrinsics, pixel_rays
from split_drake.layout import CameraPlacement
from split_drake.poses import Array, invert_pose, transform_points


@lru_cache(maxsize=8)
def _table_depth(
    intrinsics: Intrinsics, down_C: tuple[float, float, float], height_m: float
) -> NDArray[np.float32]:
    """Return (H, W) depth of the plane z = 0 of W, inf where a ray doesn't meet it.

    `down_C` is -z_W in C, `height_m` the camera's height above the plane.
    """
    descent = pixel_rays(intrinsics) @ np.array(down_C, dtype=np.float32)
    with np.errstate(divide="ignore"):
        depth = np.where(descent > 0.0, height_m / descent, np.inf).astype(np.float32)
    depth.setflags(write=False)
    return depth


def table_depth(camera: CameraPlacement) -> NDArray[np.float32]:
    """Return (H, W) depth in metres of the empty table, an infinite plane; read-only."""
    x, y, z = (float(value) for value in -camera.X_WC[2, :3])
    return _table_depth(camera.intrinsics, (x, y, z), float(camera.X_WC[2, 3]))


class RayCaster:
    """Finds where rays in the mesh's frame O first meet it."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._scene = EmbreeScene()
        self._triangles = TriangleMesh(
            self._scene, np.ascontiguousarray(mesh.triangles, dtype=np.float32)
        )

    def cast(
        self, p_OAs: ArrayLike, d_Os: ArrayLike
    ) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        """Return (N,) distances in lengths of `d_Os` (inf: a miss), and the faces met (-1: none).

        Rays start at `p_OAs` (N, 3) or (3,) and run along `d_Os` (N, 3).
        """
        directions = np.ascontiguousarray(d_Os, dtype=np.float32)
        origins = np.broadcast_to(np.asarray(p_OAs, dtype=np.float32), directions.shape)
        hits = self._scene.run(np.ascontiguousarray(origins), directions, output=1)
        faces = hits["primID"].astype(np.int32)
        return np.where(faces >= 0, hits["tfar"], np.inf).astype(np.float32), faces


class DepthRenderer:
    """Renders one rigid mesh standing on an infinite table."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._caster = RayCaster(mesh)
        self._p_OCorners = trimesh.bounds.corners(mesh.bounds)

    def render(self, X_WO: Array, camera: CameraPlacement) -> DepthView:
        """Return the depth image (no noise) of the mesh at X_WO as `camera` sees it."""
        X_CO = invert_pose(camera.X_WC) @ X_WO
        depth = table_depth(camera).copy()
        window = self._window(X_CO, camera.intrinsics)
        d_Cs = pixel_rays(camera.intrinsics)[window]
        R_CO = X_CO[:3, :3].astype(np.float32)
        distances, _ = self._caster.cast(invert_pose(X_CO)[:3, 3], d_Cs.reshape(-1, 3) @ R_CO)
        depth[window] = np.minimum(depth[window], distances.reshape(d_Cs.shape[:2]))
        return DepthView(depth, camera.intrinsics, camera.X_WC)

    def _window(self, X_CO: Array, intrinsics: Intrinsics) -> tuple[slice, slice]:
        """Return the rows and columns that the mesh's bounding box covers.

        Raises ValueError where the box reaches behind the camera.
        """
        x, y, z = transform_points(X_CO, self._p_OCorners).T
        if z.min() <= 0.0:
            raise ValueError(f"the object reaches {z.min():.3f} m behind the camera")
        u = x / z * intrinsics.fx + intrinsics.cx
        v = y / z * intrinsics.fy + intrinsics.cy
        rows = np.clip([np.floor(v.min()), np.ceil(v.max()) + 1], 0, intrinsics.height)
        columns = np.clip([np.floor(u.min()), np.ceil(u.max()) + 1], 0, intrinsics.width)
        return slice(*rows.astype(int)), slice(*columns.astype(int))
