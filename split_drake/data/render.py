"""Depth images of one mesh on the table, by ray casting: what the training scenes are made of."""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from split_drake.camera import DepthView, Intrinsics, pixel_rays
from split_drake.objects.ray_caster import RayCaster
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.station.layout import CameraPlacement


def table_depth(d_Cs: NDArray[np.float32], X_WC: Array, table_z_m: float) -> NDArray[np.float32]:
    """Return (H, W) how far along rays `d_Cs` (H, W, 3) a plane z = `table_z_m` of W lies.

    The camera is at X_WC (4, 4); inf where a ray doesn't meet the plane.
    """
    descent = d_Cs @ -X_WC[2, :3].astype(np.float32)
    height_m = np.float32(X_WC[2, 3] - table_z_m)
    with np.errstate(divide="ignore"):
        return np.where(descent > 0.0, height_m / descent, np.float32(np.inf))


@dataclass(frozen=True)
class RayImage:
    """What the rays through a camera's pixels meet, or those of a rectangle of its image.

    Attributes:
        depth_m: (H, W) along z_C; inf where a ray meets nothing.
        cosines: (H, W) of the angle between a ray and the normal of the object's surface where it
            meets that; 1 elsewhere.
        intrinsics: of these pixels.
    """

    depth_m: NDArray[np.float32]
    cosines: NDArray[np.float32]
    intrinsics: Intrinsics


class DepthRenderer:
    """Renders one rigid mesh standing on an infinite table."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._caster = RayCaster(mesh)
        self._normals_O = np.asarray(mesh.face_normals, dtype=np.float32)
        self._p_OCorners = trimesh.bounds.corners(mesh.bounds)

    def render(self, X_WO: Array, camera: CameraPlacement) -> DepthView:
        """Return the depth image (no noise) of the mesh at X_WO as `camera` sees it."""
        image = self.trace(X_WO, camera)
        return DepthView(image.depth_m, image.intrinsics, camera.X_WC)

    def trace(
        self,
        X_WO: Array,
        camera: CameraPlacement,
        table_z_m: float = 0.0,
        p_WShowns: Array | None = None,
    ) -> RayImage:
        """Return what `camera` sees of the mesh at X_WO and of a table at height `table_z_m` in W.

        Given points `p_WShowns` (N, 3), only the rectangle of the image that holds them and the
        mesh is traced.

        Raises ValueError where the mesh or one of the points lies behind the camera.
        """
        X_CW = invert_pose(camera.X_WC)
        p_CCorners = transform_points(X_CW @ X_WO, self._p_OCorners)
        window = camera.intrinsics.window(p_CCorners)
        shown = (slice(0, camera.intrinsics.height), slice(0, camera.intrinsics.width))
        if p_WShowns is not None:
            p_CShowns = transform_points(X_CW, p_WShowns)
            shown = camera.intrinsics.window(np.vstack([p_CCorners, p_CShowns]))
        rays = pixel_rays(camera.intrinsics)
        depth = table_depth(rays[shown], camera.X_WC, table_z_m)
        cosines = np.ones_like(depth)
        inner = tuple(
            slice(part.start - whole.start, part.stop - whole.start)
            for part, whole in zip(window, shown, strict=True)
        )
        distances, angles = self._meet(X_CW @ X_WO, rays[window])
        nearer = distances < depth[inner]
        depth[inner][nearer] = distances[nearer]
        cosines[inner][nearer] = angles[nearer]
        return RayImage(depth, cosines, camera.intrinsics.cropped(shown))

    def _meet(
        self, X_CO: Array, d_Cs: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (H, W) distances along rays (H, W, 3) to the mesh, and the cosines there."""
        d_Os = d_Cs.reshape(-1, 3) @ X_CO[:3, :3].astype(np.float32)
        distances, faces = self._caster.cast(invert_pose(X_CO)[:3, 3], d_Os)
        cosines = np.abs(np.einsum("ni,ni->n", self._normals_O[faces], d_Os))
        cosines /= np.linalg.norm(d_Os, axis=1)
        return distances.reshape(d_Cs.shape[:2]), cosines.reshape(d_Cs.shape[:2])
