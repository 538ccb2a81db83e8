"""Rays against one mesh."""

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import ArrayLike, NDArray


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
