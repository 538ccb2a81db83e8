"""Where an object lies: as a trial's start leaves it, or varied for training."""

from dataclasses import dataclass

import numpy as np

from split_drake.bad_input import require_numbers
from split_drake.data.rests import Rests
from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array, make_pose, rotation_x, rotation_y, rotation_z, transform_points
from split_drake.scene import Workspace
from split_drake.truth.starts import SPREAD_M, outside_workspace

MAX_DRAWS = 200


@dataclass(frozen=True)
class PlacementConfig:
    """How poses for training are drawn.

    Attributes:
        upright_share: share of draws that stand upright, as after a reorientation; all others come
            from the rests.
        tilt_rad: standard deviation of the tilt about x and about y of W.
        offset_m: how far the bounding box's centre lies from the workspace's, along x and y.
        margin_m: room left between the object and the workspace's faces.
    """

    upright_share: float = 0.15
    tilt_rad: float = 0.026
    offset_m: float = 0.06
    margin_m: float = 0.005

    def __post_init__(self) -> None:
        require_numbers(self)
        if not 0.0 <= self.upright_share <= 1.0:
            raise ValueError(f"upright_share is {self.upright_share}; expected 0 to 1")
        for name in ("tilt_rad", "offset_m", "margin_m"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 0")


class Placements:
    """Draws poses X_WO of one object from the poses in which it came to rest."""

    def __init__(self, body: RigidObject, rests: Rests, workspace: Workspace) -> None:
        self._body = body
        self._rests = rests
        self._workspace = workspace
        self._p_OHulls: Array = np.asarray(body.mesh.convex_hull.vertices)

    def draw_start(self, rng: np.random.Generator) -> Array:
        """Return X_WO (4, 4) as `starts.draw_start` would leave the object on the table.

        The drop point lies within `SPREAD_M` of the workspace's centre.  Draws that come to rest
        partly beside the workspace are repeated; raises ValueError after `MAX_DRAWS` of them.
        """
        for _ in range(MAX_DRAWS):
            offset = np.append(rng.uniform(-SPREAD_M, SPREAD_M, size=2), 0.0)
            X_WT = make_pose(_any_yaw(rng), self._workspace.p_WCenter + offset)
            X_WO = X_WT @ self._any_rest(rng)
            if not outside_workspace(self._body, X_WO, self._workspace):
                return X_WO
        raise ValueError(
            f"{self._body.name} came to rest partly outside the workspace of "
            f"{self._workspace.edge_m} m in all of {MAX_DRAWS} draws"
        )

    def draw_varied(
        self, config: PlacementConfig, table_z_m: float, rng: np.random.Generator
    ) -> Array:
        """Return X_WO (4, 4) of the object, its lowest point on the table at `table_z_m` in W.

        Raises ValueError where the object doesn't fit the workspace.
        """
        upright = rng.random() < config.upright_share
        R_TO = np.eye(3) if upright else self._any_rest(rng)[:3, :3]
        tilt_x, tilt_y = rng.normal(0.0, config.tilt_rad, 2)
        R_WO = _any_yaw(rng) @ rotation_x(tilt_x) @ rotation_y(tilt_y) @ R_TO
        p_Ws = transform_points(make_pose(R_WO), self._p_OHulls)
        lower, upper = p_Ws.min(axis=0), p_Ws.max(axis=0)
        room = (self._workspace.edge_m - (upper - lower)[:2]) / 2.0 - config.margin_m
        if room.min() < 0.0:
            raise ValueError(
                f"an object of {(upper - lower)[:2]} m does not fit the workspace of "
                f"{self._workspace.edge_m} m with {config.margin_m} m around it"
            )
        offset = rng.uniform(-1.0, 1.0, 2) * np.minimum(room, config.offset_m)
        xy = np.array(self._workspace.p_WCenter[:2]) + offset - (lower + upper)[:2] / 2.0
        return make_pose(R_WO, (*xy, table_z_m - lower[2]))

    def _any_rest(self, rng: np.random.Generator) -> Array:
        return np.asarray(self._rests.X_TOs[rng.integers(len(self._rests.X_TOs))], dtype=float)


def _any_yaw(rng: np.random.Generator) -> Array:
    return rotation_z(rng.uniform(0.0, 2.0 * np.pi))
