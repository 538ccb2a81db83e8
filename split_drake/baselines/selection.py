"""Which of a volume's voxels are grasps, as VGN and GIGA choose them.

VGN: arXiv 2101.01132, section IV-C.  GIGA's public code adds that nothing is taken near the cube's
border, and that the best grasp is taken where none is very good.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from split_drake.baselines.palm_frame import grippers_of_palms
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import make_pose
from split_drake.scene import Workspace

Volume = NDArray[np.float32]

# Voxels between this and free space are within an object.
WITHIN = 1e-3
SMOOTHING_VOXELS = 1.0
# Grasps lie at most so far beyond free space.
DILATIONS = 2
WIDTHS_VOXELS = (1.33, 9.33)
PEAK_VOXELS = 4


@dataclass(frozen=True)
class SelectionConfig:
    """How grasps are chosen; the defaults are VGN's own.

    Attributes:
        threshold: the least quality that is accepted.
        fallback_threshold: where no voxel reaches `threshold`, the best one is taken if it reaches
            this; None to take none then.
        free: fields above this are free space.
        border_m: no palm is nearer to the cube's sides.
        lowest_m: no palm is lower above the cube's bottom.
    """

    threshold: float = 0.90
    fallback_threshold: float | None = None
    free: float = 0.5
    border_m: float = 0.0
    lowest_m: float = 0.0

    @property
    def least(self) -> float:
        """The least quality that can be accepted at all."""
        return self.threshold if self.fallback_threshold is None else self.fallback_threshold


class VolumeGrasps(NamedTuple):
    """A palm's pose for each voxel of a field.

    Attributes:
        quality: (r, r, r) in [0, 1].
        quaternion_xyzw: (r, r, r, 4) of unit length, in the volume's frame V.
        width_voxels: (r, r, r) opening.
    """

    quality: Volume
    quaternion_xyzw: Volume
    width_voxels: Volume


def chosen_grasps(
    field: Volume, grasps: VolumeGrasps, workspace: Workspace, config: SelectionConfig
) -> PoseSet:
    """Return the grippers' poses of those voxels that are grasps; a voxel's corner is its place."""
    masked = masked_quality(field, grasps.quality, grasps.width_voxels, config.free)
    voxel_m = workspace.edge_m / len(field)
    masked = _inside(masked, round(config.border_m / voxel_m), int(config.lowest_m / voxel_m))
    voxels = peaks(masked, config.threshold)
    if not len(voxels) and config.fallback_threshold is not None:
        found = peaks(masked, config.fallback_threshold)
        voxels = found[np.argsort(-masked[tuple(found.T)], kind="stable")][:1]
    x, y, z = voxels.T
    R_VTs = Rotation.from_quat(grasps.quaternion_xyzw[x, y, z]).as_matrix()
    X_WTs = make_pose(R_VTs.reshape(-1, 3, 3), voxels * voxel_m + workspace.p_WV)
    return PoseSet.ranked(GRASP, grippers_of_palms(X_WTs), masked[x, y, z].astype(float))


def masked_quality(tsdf: Volume, quality: Volume, width_voxels: Volume, free: float) -> Volume:
    """Return the smoothed quality (r, r, r), 0 where no grasp can be.

    Args:
        tsdf: (r, r, r) in [0, 1].
        quality: (r, r, r) of each voxel's grasp.
        width_voxels: (r, r, r) its opening.
        free: fields above this are free space.
    """
    smooth = ndimage.gaussian_filter(quality, sigma=SMOOTHING_VOXELS, mode="nearest")
    within = (tsdf > WITHIN) & (tsdf < free)
    near_free = ndimage.binary_dilation(tsdf > free, iterations=DILATIONS, mask=~within)
    narrowest, widest = WIDTHS_VOXELS
    fits = (width_voxels >= narrowest) & (width_voxels <= widest)
    return np.where(near_free & fits, smooth, np.float32(0.0))


def _inside(quality: Volume, border: int, lowest: int) -> Volume:
    """Return the quality, 0 within so many voxels of the cube's sides and bottom."""
    inner = np.zeros_like(quality)
    kept = slice(border, len(quality) - border)
    inner[kept, kept, lowest:] = quality[kept, kept, lowest:]
    return inner


def peaks(quality: Volume, threshold: float) -> NDArray[np.intp]:
    """Return indices (N, 3) of voxels that are highest around them and reach a threshold."""
    high = np.where(quality >= threshold, quality, np.float32(0.0))
    highest = ndimage.maximum_filter(high, size=PEAK_VOXELS)
    return np.argwhere((high == highest) & (high > 0.0))
