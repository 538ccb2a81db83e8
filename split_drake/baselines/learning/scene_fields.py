"""What VGN and GIGA learn of one scene of clutter, beside its labels: fields, occupancy, widths."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from split_drake.baselines.tsdf import fused_tsdf
from split_drake.data.clutter.scenes import ClutterScene
from split_drake.data.clutter.views import merged_mesh
from split_drake.depth_noise import with_normal_noise
from split_drake.objects.ray_caster import RayCaster
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M

# A field of each scene for each of these noises of the depth image: without, and, drawn twice, as
# much as SPLIT's points have in the paper.
NOISES_M = (0.0, 0.005, 0.005)
# The largest value of a field as it is kept.
LEVELS = 255
# Pads reach 11 mm ahead of their middles; what lies flat is pinched there.
AHEAD_M = (0.0, 0.005, 0.01)
# A ray's direction, along no edge of a shape that stands.
_UPWARDS = np.array([0.031, 0.017, 1.0], dtype=np.float32)


def noisy_fields(each: ClutterScene, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return a TSDF (V, r, r, r) in `LEVELS` for each of `NOISES_M`."""
    fields = []
    for std_m in NOISES_M:
        views = [
            replace(view, depth_m=with_normal_noise(view.depth_m, std_m, rng))
            for view in each.scene.views
        ]
        field = fused_tsdf(views, each.scene.workspace)
        # What is nearly 0, behind the surface, must not become what was not seen.
        fields.append(np.where(field > 0.0, np.maximum(np.rint(LEVELS * field), 1.0), 0.0))
    return np.stack(fields).astype(np.uint8)


class SceneSolid:
    """What lies in a scene, as one mesh that rays are cast at.

    Args:
        each: the scene; its meshes are closed, their normals point outwards.
    """

    def __init__(self, each: ClutterScene) -> None:
        mesh = merged_mesh(each.objects, each.X_WOs)
        self._caster = RayCaster(mesh)
        self._normals = np.asarray(mesh.face_normals, dtype=np.float32)

    def holds(self, p_WPs: Array) -> NDArray[np.bool_]:
        """Return (P,): which points (P, 3) lie within an object.

        From within, a ray first meets a face from behind.
        """
        rays = np.broadcast_to(_UPWARDS, p_WPs.shape)
        _, faces = self._caster.cast(p_WPs, rays)
        return np.asarray((faces >= 0) & (self._normals[faces] @ _UPWARDS > 0.0))

    def widths(self, X_WGs: Array) -> NDArray[np.float32]:
        """Return (T,) how wide what each grasp (T, 4, 4) pinches is, metres.

        That is the gap between what rays from wide-open pads meet, the widest of those at the
        pads' middles and ahead of them; a ray that meets nothing ends halfway.
        """
        gaps = []
        for ahead_m in AHEAD_M:
            p_WQs = X_WGs[:, :3, 3] + ahead_m * X_WGs[:, :3, 2]
            ways = [self._reach(p_WQs, side * X_WGs[:, :3, 1]) for side in (1.0, -1.0)]
            gaps.append(MAX_OPENING_M - ways[0] - ways[1])
        return np.asarray(np.max(gaps, axis=0), dtype=np.float32)

    def _reach(self, p_WQs: Array, inwards: Array) -> NDArray[np.float32]:
        """Return how far pads come that close along `inwards` (T, 3) to the middles (T, 3)."""
        half_m = MAX_OPENING_M / 2.0
        reached, _ = self._caster.cast(p_WQs - half_m * inwards, inwards)
        return np.minimum(reached, np.float32(half_m))
