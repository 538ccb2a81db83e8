"""Scenes of one object on the table, as depth cameras see it: as in a trial, or randomised."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from split_drake.camera import DepthView
from split_drake.data.placements import Placements
from split_drake.data.randomization import DomainRandomization
from split_drake.data.render import DepthRenderer
from split_drake.data.rests import Rests
from split_drake.objects.task_object import TaskObject
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.station.layout import CameraPlacement, Layout

# Points on the feature of an object that has none.
NO_FEATURE = -1
# A feature counts as visible from so many of a scene's 2000 points on.
VISIBLE_POINTS = 30


@dataclass(frozen=True)
class ObjectScene:
    """What is seen of an object, without noise.

    Attributes:
        X_WO: (4, 4) pose of the object.
        p_WPs: (N, 3) all points seen in the workspace, metres in W.
        p_WSs: (2000, 3) the points sampled from them.
        feature_points: how many of the sampled points lie on the part that poses are told by;
            `NO_FEATURE` where there is none.
        views: number of cameras.
        p_WC: (3,) where the (first) camera stands.
        table_z_m: true height of the table in W.
    """

    X_WO: Array
    p_WPs: Array
    p_WSs: Array
    feature_points: int
    views: int
    p_WC: Array
    table_z_m: float


def feature_visible(points: ArrayLike) -> NDArray[np.bool_]:
    """Return whether a feature shows by its numbers of points (...); what has none always does."""
    counts = np.asarray(points)
    return (counts == NO_FEATURE) | (counts >= VISIBLE_POINTS)


class ObjectScenes:
    """Draws scenes of one object.

    Attributes:
        name: of the object.

    Args:
        subject: the object.
        rests: how it comes to rest on the table.
        layout: the cameras and the workspace.
        randomization: what varies; None for the start of a trial as the station's cameras see it.
    """

    def __init__(
        self,
        subject: TaskObject,
        rests: Rests,
        layout: Layout,
        randomization: DomainRandomization | None,
    ) -> None:
        self.name = subject.name
        self._layout = layout
        self._randomization = randomization
        self._placements = Placements(subject.body, rests, layout.workspace)
        self._renderer = DepthRenderer(subject.body.mesh)
        self._feature = subject.feature()
        self._p_WFootprint = _footprint(layout.workspace)

    def draw(self, rng: np.random.Generator) -> ObjectScene:
        """Return one scene."""
        if self._randomization is None:
            X_WO, table_z_m = self._placements.draw_start(rng), self._layout.table_z_m
            views = [self._view(X_WO, camera) for camera in self._layout.cameras]
        else:
            X_WO, table_z_m, views = self._draw_varied(self._randomization, rng)
        scene = Scene.from_views(views, self._layout.workspace)
        points = NO_FEATURE
        if self._feature is not None:
            points = self._feature.count(X_WO, scene.p_WSs)
        p_WC = views[0].X_WC[:3, 3]
        return ObjectScene(X_WO, scene.p_WPs, scene.p_WSs, points, len(views), p_WC, table_z_m)

    def _view(self, X_WO: Array, camera: CameraPlacement) -> DepthView:
        image = self._renderer.trace(X_WO, camera, self._layout.table_z_m, self._p_WFootprint)
        return DepthView(image.depth_m, image.intrinsics, camera.X_WC)

    def _draw_varied(
        self, random: DomainRandomization, rng: np.random.Generator
    ) -> tuple[Array, float, list[DepthView]]:
        """Return X_WO, the table's height, and views with missing pixels from about C."""
        table_z_m = random.draw_table_z_m(self._layout.table_z_m, rng)
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
        """Return X_WO; in some single views the one of several that shows least of the feature."""
        feature = self._feature
        hide = len(cameras) == 1 and rng.random() < random.hidden_share
        draws = random.hidden_draws if hide else 1
        X_WOs = [
            self._placements.draw_varied(random.placement, table_z_m, rng) for _ in range(draws)
        ]
        if draws == 1 or feature is None:
            return X_WOs[0]
        p_WC = cameras[0].X_WC[:3, 3]
        seen = [feature.seen_share(X_WO, p_WC) for X_WO in X_WOs]
        return X_WOs[int(np.argmin(seen))]


def _footprint(workspace: Workspace) -> Array:
    """Return (4, 3) the corners of the workspace's square on the table, metres in W."""
    half = workspace.edge_m / 2.0
    corners = np.array(
        [(-half, -half, 0.0), (-half, half, 0.0), (half, -half, 0.0), (half, half, 0.0)]
    )
    return corners + workspace.p_WCenter
