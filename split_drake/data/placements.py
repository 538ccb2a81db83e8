"""Resting poses on the table, drawn as the scenarios' starts come out."""

from dataclasses import dataclass

import numpy as np
import trimesh

from split_drake.poses import Array, make_pose, rotation_z, transform_points
from split_drake.scene import Workspace

# A mug that rests with its axis further down than this counts as upside down (paper section VI-B).
UPSIDE_DOWN_COS = -0.5


@dataclass(frozen=True)
class PlacementConfig:
    """How resting poses are drawn.

    Attributes:
        upright_share: share of draws that stand upright, as after a reorientation.
        rare_share: share of draws for which every stable pose weighs the square root of its
            probability after a random drop, so that rare ones appear.  All other draws weigh it
            as it is.
        tilt_rad: standard deviation of the tilt about x and about y of W.
        offset_m: how far the bounding box's centre lies from the workspace's, along x and y.
        margin_m: room left between the mug and the workspace's faces.
    """

    upright_share: float = 0.15
    rare_share: float = 0.3
    tilt_rad: float = 0.026
    offset_m: float = 0.06
    margin_m: float = 0.005

    def __post_init__(self) -> None:
        if (
            min(self.upright_share, self.rare_share) < 0.0
            or self.upright_share + self.rare_share > 1
        ):
            raise ValueError(
                f"upright_share {self.upright_share} and rare_share {self.rare_share}; expected "
                "shares that add up to 1 at most"
            )


class RestingPoses:
    """The stable poses of a mesh on a plane, not upside down."""

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        p_OCom: Array,
        workspace: Workspace,
        config: PlacementConfig | None = None,
    ) -> None:
        self._config = config or PlacementConfig()
        self._workspace = workspace
        hull = mesh.convex_hull
        poses, probabilities = trimesh.poses.compute_stable_poses(
            hull, center_mass=p_OCom, sigma=0.0, n_samples=1, threshold=0.0
        )
        kept = poses[:, 2, 2] >= UPSIDE_DOWN_COS
        self.R_WOs: Array = poses[kept, :3, :3]
        self.probabilities: Array = probabilities[kept] / probabilities[kept].sum()
        self._p_OHulls: Array = np.asarray(hull.vertices)

    def _weights(self, draw: float) -> Array:
        """Return the probabilities (N,) of the stable poses, `draw` in [0, 1) choosing the kind."""
        if draw < self._config.upright_share:
            return np.eye(len(self.R_WOs))[self.R_WOs[:, 2, 2].argmax()]
        if draw < self._config.upright_share + self._config.rare_share:
            return np.sqrt(self.probabilities) / np.sqrt(self.probabilities).sum()
        return self.probabilities

    def sample(self, rng: np.random.Generator) -> Array:
        """Return a resting pose X_WO (4, 4), tilted a little, its lowest point at z = 0."""
        R_WO = self.R_WOs[rng.choice(len(self.R_WOs), p=self._weights(rng.random()))]
        tilt = trimesh.transformations.euler_matrix(*rng.normal(0.0, self._config.tilt_rad, 2), 0)
        R_WO = rotation_z(rng.uniform(0.0, 2.0 * np.pi)) @ tilt[:3, :3] @ R_WO
        p_Ws = transform_points(make_pose(R_WO), self._p_OHulls)
        lower, upper = p_Ws.min(axis=0), p_Ws.max(axis=0)
        room = (self._workspace.edge_m - (upper - lower)[:2]) / 2.0 - self._config.margin_m
        if room.min() < 0.0:
            raise ValueError(
                f"an object of {(upper - lower)[:2]} m does not fit the workspace of "
                f"{self._workspace.edge_m} m with {self._config.margin_m} m around it"
            )
        offset = rng.uniform(-1.0, 1.0, 2) * np.minimum(room, self._config.offset_m)
        xy = np.array(self._workspace.p_WCenter[:2]) + offset - (lower + upper)[:2] / 2.0
        return make_pose(R_WO, (*xy, -lower[2]))
