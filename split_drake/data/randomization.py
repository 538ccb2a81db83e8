"""Domain randomisation of training scenes: how they differ from the nominal station."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from split_drake.bad_input import require_numbers
from split_drake.data.placements import PlacementConfig
from split_drake.data.render import RayImage
from split_drake.poses import Array, make_pose
from split_drake.station.layout import CameraPlacement


@dataclass(frozen=True)
class DomainRandomization:
    """What is drawn anew for each scene.  The points' noise is drawn in training, not here.

    Attributes:
        placement: how the object lies.
        camera_turn_rad, camera_shift_m: standard deviations, about and along each axis of C, of
            where a camera stands about its nominal pose.  The pose is known: it moves the view.
        calibration_turn_rad, calibration_shift_m: the same of the error of the pose that depth is
            turned into points with.  It bends the cloud, and sets two views apart.
        table_height_m: standard deviation of the height of the table, objects on it, about the one
            that the workspace is cropped at.
        grazing_rad: rays further than this from the normal of the surface they meet may miss it.
        grazing_loss: upper bound of the share of those that do; drawn uniformly for each view.
        edge_step_m: pixels whose depth differs by more than this from a neighbour's may be missing.
        edge_loss: upper bound of the share of those that are; drawn uniformly for each view.
        single_view_share: share of the scenes that one of the cameras sees alone.
        hidden_share: share of those scenes with the feature out of sight as far as possible: of
            `hidden_draws` poses the one is taken that shows least of it.
        hidden_draws: see above.

    Raises ValueError where a share leaves [0, 1], `hidden_draws` is less than 1, or another number
    is negative.
    """

    placement: PlacementConfig = field(default_factory=PlacementConfig)
    camera_turn_rad: float = 0.017
    camera_shift_m: float = 0.005
    calibration_turn_rad: float = 0.0015
    calibration_shift_m: float = 0.001
    table_height_m: float = 0.002
    grazing_rad: float = 1.34
    grazing_loss: float = 0.8
    edge_step_m: float = 0.01
    edge_loss: float = 0.8
    single_view_share: float = 0.22
    hidden_share: float = 0.6
    hidden_draws: int = 12

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("grazing_loss", "edge_loss", "single_view_share", "hidden_share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected 0 to 1")
        if self.hidden_draws < 1:
            raise ValueError(f"hidden_draws is {self.hidden_draws}; expected at least 1")
        for name in (item.name for item in fields(self) if item.name != "placement"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 0")

    def draw_cameras(
        self, nominal: Sequence[CameraPlacement], rng: np.random.Generator
    ) -> tuple[CameraPlacement, ...]:
        """Return the cameras that see a scene, where they really stand."""
        alone = rng.random() < self.single_view_share
        seeing = [nominal[int(rng.integers(len(nominal)))]] if alone else nominal
        return tuple(
            CameraPlacement(
                camera.name,
                camera.intrinsics,
                camera.X_WC @ _displacement(self.camera_turn_rad, self.camera_shift_m, rng),
            )
            for camera in seeing
        )

    def miscalibrate(self, X_WC: Array, rng: np.random.Generator) -> Array:
        """Return what a camera's pose X_WC (4, 4) is taken for."""
        return X_WC @ _displacement(self.calibration_turn_rad, self.calibration_shift_m, rng)

    def draw_table_z_m(self, assumed_z_m: float, rng: np.random.Generator) -> float:
        """Return the height of the table in W where it is assumed at `assumed_z_m`."""
        return assumed_z_m + float(rng.normal(0.0, self.table_height_m))

    def missing(self, image: RayImage, rng: np.random.Generator) -> NDArray[np.bool_]:
        """Return (H, W): which pixels of a view the camera has no depth for."""
        grazing = image.cosines < np.cos(self.grazing_rad)
        edges = depth_edges(image.depth_m, self.edge_step_m)
        missing = np.zeros(image.depth_m.shape, dtype=bool)
        for doubtful, most in ((grazing, self.grazing_loss), (edges, self.edge_loss)):
            share = rng.uniform(0.0, most)
            missing[doubtful] |= rng.random(int(doubtful.sum())) < share
        return missing


def depth_edges(depth_m: NDArray[np.float32], step_m: float) -> NDArray[np.bool_]:
    """Return (H, W): pixels next to one, above, below or beside, whose depth differs by a step."""
    edges = np.zeros(depth_m.shape, dtype=bool)
    rows = np.abs(np.diff(depth_m, axis=0)) > step_m
    columns = np.abs(np.diff(depth_m, axis=1)) > step_m
    edges[1:] |= rows
    edges[:-1] |= rows
    edges[:, 1:] |= columns
    edges[:, :-1] |= columns
    return edges


def _displacement(turn_rad: float, shift_m: float, rng: np.random.Generator) -> Array:
    """Return a small pose (4, 4), each component normal with these standard deviations."""
    turn = Rotation.from_rotvec(rng.normal(0.0, turn_rad, 3)).as_matrix()
    return make_pose(turn, rng.normal(0.0, shift_m, 3))
