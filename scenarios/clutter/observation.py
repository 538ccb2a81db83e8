"""What the detectors of clutter removal see: one view from the side, with the noise asked for."""

from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.ndimage import zoom

from split_drake.camera import DepthView, Intrinsics, look_at
from split_drake.depth_noise import with_normal_noise
from split_drake.scene import Scene, Workspace
from split_drake.station.layout import CameraPlacement
from split_drake.table_fit import TableFit

Noise = Literal["none", "gaussian", "dex"]

# GIGA's side view (arXiv 2104.01542), azimuth apart: the robot's base is at -x of the cube.
DISTANCE_M, POLAR_RAD, AZIMUTH_RAD = 0.6, np.radians(60.0), -np.pi / 2.0
TARGET_HEIGHT_M = 0.05
# Of the sampled points, the paper's (section V).
GAUSSIAN_M = 0.005
# "dex": a factor of the whole image, and in half of all images a smooth error.
GAMMA_SHAPE = 1000.0
SMOOTH_SHARE, SMOOTH_M, SMOOTH_PIXELS = 0.5, 0.005, 4


def side_camera(workspace: Workspace) -> CameraPlacement:
    """Return the camera that looks at the workspace from the side."""
    target = np.array(workspace.p_WCenter) + np.array([0.0, 0.0, TARGET_HEIGHT_M])
    direction = np.array(
        [
            np.sin(POLAR_RAD) * np.cos(AZIMUTH_RAD),
            np.sin(POLAR_RAD) * np.sin(AZIMUTH_RAD),
            np.cos(POLAR_RAD),
        ]
    )
    intrinsics = Intrinsics.centered(640, 480, focal_px=540.0)
    return CameraPlacement("side", intrinsics, look_at(target + DISTANCE_M * direction, target))


def observe(
    view: DepthView,
    workspace: Workspace,
    noise: Noise,
    rng: np.random.Generator,
    fit_table: bool = False,
) -> Scene:
    """Return the scene that a view shows.

    Args:
        fit_table: put the depth image's scale right by the table that it shows.  The cloud is then
            of what stands clear of the table by its own noise; the image still shows the table,
            which methods that read images are trained to see.

    Raises EmptySceneError where it shows nothing of the workspace, or no table to fit.
    """
    if noise == "dex":
        view = replace(view, depth_m=dex_noise(view.depth_m, rng))
    above = view
    if fit_table:
        fit = TableFit.of(view, workspace.p_WCenter[2])
        view = fit.rescaled(view)
        above = fit.above_table(view, workspace.p_WCenter[2])
    scene = replace(Scene.from_views([above], workspace), views=(view,))
    if noise != "gaussian":
        return scene
    (view_rng,) = rng.spawn(1)  # so that the points' noise is the same whatever the image has
    # What makes a TSDF of views is so shown as much noise as what samples points.
    noisy = replace(view, depth_m=with_normal_noise(view.depth_m, GAUSSIAN_M, view_rng))
    return replace(scene.with_noise(GAUSSIAN_M, rng), views=(noisy,))


def dex_noise(depth_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a depth image (H, W) with VGN's noise: 0 stays 0, where nothing was measured.

    All of it is multiplied by one draw of Gamma(1000, 0.001): 19 mm (standard deviation) at 0.6 m.
    In half of all images normal noise of 5 mm is added, drawn at a quarter of the resolution.
    """
    noisy = depth_m * rng.gamma(GAMMA_SHAPE, 1.0 / GAMMA_SHAPE)
    if rng.random() < SMOOTH_SHARE:
        height, width = depth_m.shape
        coarse = rng.normal(
            0.0, SMOOTH_M, (-(-height // SMOOTH_PIXELS), -(-width // SMOOTH_PIXELS))
        )
        noisy = noisy + zoom(coarse, SMOOTH_PIXELS, order=1)[:height, :width]
    return np.where(depth_m > 0.0, np.maximum(noisy, 0.0), 0.0).astype(np.float32)
