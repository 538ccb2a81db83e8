"""Scenes of one mug on the table, as depth cameras see it: nominal as in a trial, or randomised."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from split_drake.camera import DepthView
from split_drake.data.handle_points import HandlePoints
from split_drake.data.placements import Placements
from split_drake.data.randomization import DomainRandomization
from split_drake.data.render import DepthRenderer
from split_drake.data.rests import Rests
from split_drake.objects.mug_shape import MugShape
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.station.layout import CameraPlacement, Layout


@dataclass(frozen=True)
class MugScene:
    """What is seen of a mug, without noise.

    Attributes:
        X_WO: (4, 4) pose of the mug.
        p_WPs: (N, 3) all points seen in the workspace, metres in W.
        p_WSs: (2000, 3) the points sampled from them.
        handle_points: how many of the sampled points lie on the handle.
        views: number of cameras.
        table_z_m: true height of the table in W.
    """

    X_WO: Array
    p_WPs: Array
    p_WSs: Array
    handle_points: int
    views: int
    table_z_m: float


class MugScenes:
    """Draws scenes of one mug.

    Args:
        mug: its shape.
        rests: how it comes to rest on the table.
        layout: the cameras and the workspace.
        randomization: what varies; None for the start of a trial as the station's cameras see it.
    """

    def __init__(
        self,
        mug: MugShape,
        rests: Rests,
        layout: Layout,
        randomization: DomainRandomization | None,
    ) -> None:
        self._layout = layout
        self._randomization = randomization
        self._placements = Placements(mug.body, rests, layout.workspace)
        self._renderer = DepthRenderer(mug.body.mesh)
        self._handle = HandlePoints(mug.body.mesh)
        self._p_WFootprint = _footprint(layout.workspace)

    def draw(self, rng: np.random.Generator) -> MugScene:
        """Return one scene."""
        if self._randomization is None:
            X_WO, table_z_m = self._placements.draw_start(rng), 0.0
            views = [self._view(X_WO, camera) for camera in self._layout.cameras]
        else:
            X_WO, table_z_m, views = self._draw_varied(self._randomization, rng)
        scene = Scene.from_views(views, self._layout.workspace)
        handle_points = self._handle.count(X_WO, scene.p_WSs)
        return MugScene(X_WO, scene.p_WPs, scene.p_WSs, handle_points, len(views), table_z_m)

    def _view(self, X_WO: Array, camera: CameraPlacement) -> DepthView:
        image = self._renderer.trace(X_WO, camera, 0.0, self._p_WFootprint)
        return DepthView(image.depth_m, image.intrinsics, camera.X_WC)

    def _draw_varied(
        self, random: DomainRandomization, rng: np.random.Generator
    ) -> tuple[Array, float, list[DepthView]]:
        """Return X_WO, the table's height, and views with missing pixels from about C."""
        table_z_m = random.draw_table_z_m(rng)
        cameras = random.draw_cameras(self._layout.cameras, rng)
        X_WO = self._pose(random, table_z_m, cameras, rng)
        views = []
        for camera in cameras:
            image = self._renderer.trace(X_WO, camera, table_z_m, self._p_WFootprint)
            depth_m = np.where(random.missing(image, rng), np.float32(0.0), image.depth_m)
            X_WC = random.miscalibrate(camera.X_WC, rng)
            views.append(DepthView(depth_m, image.intrinsics, X_WC))
        return X_WO, table_z_m, views

    def _pose(
        self,
        random: DomainRandomization,
        table_z_m: float,
        cameras: Sequence[CameraPlacement],
        rng: np.random.Generator,
    ) -> Array:
        """Return X_WO; in some single views the one of several that shows least of the handle."""
        hide = len(cameras) == 1 and rng.random() < random.hidden_share
        draws = random.hidden_draws if hide else 1
        X_WOs = [
            self._placements.draw_varied(random.placement, table_z_m, rng) for _ in range(draws)
        ]
        if draws == 1:
            return X_WOs[0]
        p_WC = cameras[0].X_WC[:3, 3]
        seen = [self._handle.seen_share(X_WO, p_WC) for X_WO in X_WOs]
        return X_WOs[int(np.argmin(seen))]


def _footprint(workspace: Workspace) -> Array:
    """Return (4, 3) the corners of the workspace's square on the table, metres in W."""
    half = workspace.edge_m / 2.0
    corners = np.array(
        [(-half, -half, 0.0), (-half, half, 0.0), (half, -half, 0.0), (half, half, 0.0)]
    )
    return corners + workspace.p_WCenter
