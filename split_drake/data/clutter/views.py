"""One view of a clutter scene from a random side, by ray casting."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import trimesh

from split_drake.bad_input import require_numbers
from split_drake.camera import DepthView, Intrinsics, look_at
from split_drake.data.clutter.library import ClutterObject
from split_drake.data.randomization import DomainRandomization
from split_drake.data.render import DepthRenderer
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.station.layout import CameraPlacement

# Half of the resolution of rounds: 2000 of a view's points are used.
COARSE = Intrinsics.centered(320, 240, focal_px=270.0)
# That of GIGA's side view.
FINE = Intrinsics.centered(640, 480, focal_px=540.0)


@dataclass(frozen=True)
class ViewRandomization:
    """From where clutter is seen; the ranges are those of GIGA's training views.

    Attributes:
        distance_m: of the camera from the target.
        polar_deg: angle of the view from the vertical.
        target_height_m: of what the camera looks at, above the middle of the table.
        target_shift_m: standard deviation of that point.
        missing: which pixels have no depth, and how well the camera's pose is known.
        intrinsics: of the camera.
    """

    distance_m: tuple[float, float] = (0.48, 0.72)
    polar_deg: tuple[float, float] = (45.0, 75.0)
    target_height_m: float = 0.05
    target_shift_m: float = 0.005
    missing: DomainRandomization = field(default_factory=DomainRandomization)
    intrinsics: Intrinsics = COARSE

    def __post_init__(self) -> None:
        require_numbers(self)

    def draw_camera(self, workspace: Workspace, rng: np.random.Generator) -> CameraPlacement:
        """Return a camera, the azimuth uniform."""
        distance_m = rng.uniform(*self.distance_m)
        polar, azimuth = np.radians(rng.uniform(*self.polar_deg)), rng.uniform(0.0, 2.0 * np.pi)
        direction = np.array(
            [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
        )
        target = np.array(workspace.p_WCenter) + rng.normal(0.0, self.target_shift_m, 3)
        target[2] += self.target_height_m
        X_WC = look_at(target + distance_m * direction, target)
        return CameraPlacement("side", self.intrinsics, X_WC)


def merged_mesh(objects: Sequence[ClutterObject], X_WOs: Array) -> trimesh.Trimesh:
    """Return one mesh in W of objects at X_WOs (K, 4, 4)."""
    parts = [
        each.triangles_O @ X_WO[:3, :3].T + X_WO[:3, 3]
        for each, X_WO in zip(objects, X_WOs, strict=True)
    ]
    vertices = np.concatenate(parts).reshape(-1, 3)
    return trimesh.Trimesh(vertices, np.arange(len(vertices)).reshape(-1, 3), process=False)


def see(
    objects: Sequence[ClutterObject],
    X_WOs: Array,
    workspace: Workspace,
    config: ViewRandomization,
    rng: np.random.Generator,
) -> tuple[Scene, Array]:
    """Return what a random camera sees of objects at X_WOs (K, 4, 4), and where it stands (3,).

    Raises EmptySceneError where it sees nothing of them in the workspace.
    """
    camera = config.draw_camera(workspace, rng)
    renderer = DepthRenderer(merged_mesh(objects, X_WOs))
    half = workspace.edge_m / 2.0
    corners = np.array([(x, y, 0.0) for x in (-half, half) for y in (-half, half)])
    table_z_m = config.missing.draw_table_z_m(workspace.p_WCenter[2], rng)
    image = renderer.trace(np.eye(4), camera, table_z_m, corners + workspace.p_WCenter)
    lost = config.missing.missing(image, rng)
    depth_m = np.where(lost, np.float32(0.0), image.depth_m)
    X_WC = config.missing.miscalibrate(camera.X_WC, rng)
    scene = Scene.from_views([DepthView(depth_m, image.intrinsics, X_WC)], workspace)
    return scene, X_WC[:3, 3]
