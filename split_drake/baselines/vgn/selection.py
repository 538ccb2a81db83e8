"""Which of VGN's voxels are grasps (arXiv 2101.01132, section IV-C, and its public code)."""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

# Voxels above the first are free; between it and the second they are within an object.
FREE, WITHIN = 0.5, 1e-3
SMOOTHING_VOXELS = 1.0
# Grasps lie at most so far beyond free space.
DILATIONS = 2
WIDTHS_VOXELS = (1.33, 9.33)
PEAK_VOXELS = 4


def masked_quality(
    tsdf: NDArray[np.float32], quality: NDArray[np.float32], width_voxels: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the smoothed quality (r, r, r), 0 where no grasp can be.

    Args:
        tsdf: (r, r, r) in [0, 1].
        quality: (r, r, r) of each voxel's grasp.
        width_voxels: (r, r, r) its opening.
    """
    smooth = ndimage.gaussian_filter(quality, sigma=SMOOTHING_VOXELS, mode="nearest")
    within = (tsdf > WITHIN) & (tsdf < FREE)
    near_free = ndimage.binary_dilation(tsdf > FREE, iterations=DILATIONS, mask=~within)
    narrowest, widest = WIDTHS_VOXELS
    fits = (width_voxels >= narrowest) & (width_voxels <= widest)
    return np.where(near_free & fits, smooth, np.float32(0.0))


def peaks(quality: NDArray[np.float32], threshold: float) -> NDArray[np.intp]:
    """Return indices (N, 3) of voxels that are highest around them and reach a threshold."""
    high = np.where(quality >= threshold, quality, np.float32(0.0))
    highest = ndimage.maximum_filter(high, size=PEAK_VOXELS)
    return np.argwhere((high == highest) & (high > 0.0))
