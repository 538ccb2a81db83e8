"""What geometry says of grasps by VGN's protocol (arXiv 2101.01132) in a scene of many objects.

The hand comes in wide open until it touches something or is there, and closes on whatever lies
between its pads then.  Nothing moves: what is pushed aside in physics stops the hand here.
"""

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from split_drake.grasps.judge import GraspJudge
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.open_hand import OPEN_HAND, lowest_heights

# Half-angle of the friction cone; physics has arctan(0.8) = 0.67 rad.
CONE_RAD = 0.45
# Of grasps from above on single objects, 192 of 201 with this quality held in the hand's station.
LEAST_QUALITY = 0.3
# The protocol counts a grasp whose pads end within 8 mm as failed.  What they hold turns, and gave
# way while contact was softer: of the failures of weights trained on 9 mm, 60% had closed too far.
LEAST_WIDTH_M = 0.0105
# The hand starts so far back.
PREGRASP_M = 0.05
# Surfaces are sampled so densely that a fingertip hardly fits between the points.
_AREA_PER_POINT_M2 = 9e-6
_LEAST_POINTS = 500
# So many grasps are compared with all points at a time.
_AT_ONCE = 32


@dataclass(frozen=True)
class ClutterCheck:
    """What geometry says of grasps (N).

    Attributes:
        short_m: (N,) how far before the grasp the hand stops; `PREGRASP_M` where it cannot start.
        qualities: (N,) in [0, 1] of the pinch where it stops, see `GraspJudge.qualities`.
        widths_m: (N,) between the pads when they have closed there.
    """

    short_m: Array
    qualities: Array
    widths_m: Array

    @property
    def good(self) -> NDArray[np.bool_]:
        """(N,): whether a grasp holds something."""
        pinches = (self.qualities >= LEAST_QUALITY) & (self.widths_m >= LEAST_WIDTH_M)
        return pinches & (self.short_m < PREGRASP_M)


class ClutterJudge:
    """Judges grasps in a scene.

    Args:
        mesh_W: of all objects in W.
        table_z_m: height of the table in W.
    """

    def __init__(self, mesh_W: trimesh.Trimesh, table_z_m: float) -> None:
        self._judge = GraspJudge(mesh_W, CONE_RAD)
        count = max(_LEAST_POINTS, int(mesh_W.area / _AREA_PER_POINT_M2))
        points, _ = trimesh.sample.sample_surface(mesh_W, count, seed=0)
        self._p_WPs = np.asarray(points, dtype=np.float32)
        self._table_z_m = table_z_m

    def check(self, X_WGs: Array) -> ClutterCheck:
        """Judge grasps (N, 4, 4)."""
        short_m = np.maximum(self._short_of_objects(X_WGs), self._short_of_table(X_WGs))
        stopped = np.array(X_WGs, dtype=float)
        stopped[:, :3, 3] -= short_m[:, None] * stopped[:, :3, 2]
        wide = np.full(len(stopped), MAX_OPENING_M)
        if not len(stopped):
            return ClutterCheck(wide, wide, wide)
        return ClutterCheck(
            short_m, self._judge.qualities(stopped, wide), self._judge.settled_widths(stopped, wide)
        )

    def _short_of_table(self, X_WGs: Array) -> Array:
        """Return (N,) how far before the grasps the hand's lowest corner meets the table."""
        lowest_m = lowest_heights(X_WGs) - self._table_z_m
        descent = -X_WGs[:, 2, 2]
        below_m = np.maximum(-lowest_m, 0.0)
        # Who comes from below, or level, and meets the table does so all the way.
        needed_m = np.where(descent > 1e-3, below_m / np.maximum(descent, 1e-3), PREGRASP_M)
        return np.where(below_m > 0.0, np.minimum(needed_m, PREGRASP_M), 0.0)

    def _short_of_objects(self, X_WGs: Array) -> Array:
        """Return (N,) how far before the grasps the hand meets a point of a surface."""
        parts = np.array_split(np.arange(len(X_WGs)), len(X_WGs) // _AT_ONCE + 1)
        return np.concatenate([self._first_contact(X_WGs[part]) for part in parts])

    def _first_contact(self, X_WGs: Array) -> Array:
        R_WGs = X_WGs[:, :3, :3].astype(np.float32)
        p_WGs = X_WGs[:, None, :3, 3].astype(np.float32)
        p_GPs = (self._p_WPs[None] - p_WGs) @ R_WGs
        x, y, z = np.abs(p_GPs[..., 0]), p_GPs[..., 1], p_GPs[..., 2]
        short_m = np.zeros(len(X_WGs))
        for box in OPEN_HAND:
            (_, y0, z0), (x1, y1, z1) = box.lower, box.upper
            meets = (x < x1) & (y > y0) & (y < y1) & (z > z0 - PREGRASP_M) & (z < z1)
            reach_m = np.where(meets, z1 - z, 0.0).max(axis=1)
            short_m = np.maximum(short_m, np.minimum(reach_m, PREGRASP_M))
        return short_m
