"""What geometry says of grasps on a mesh: what the pads close on, and what the hand hits."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from split_drake.objects.ray_caster import RayCaster
from split_drake.poses import Array, invert_pose, make_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M, PAD_SIZE_M, Box, gripper_boxes

# Half-angle of the friction cone that contacts must lie in; physics has arctan(0.8) = 0.67 rad.
CONE_RAD = 0.3
# Room left between each pad and the object as the hand comes in.
SIDE_ROOM_M = 0.012
# A pinch 7 mm deep has this quality; shallower ones tilt in the hand.
MIN_QUALITY = 0.5
# Curved walls leave the corners of a pad free; this share of its face is as good as it gets.
FULL_SHARE = 0.7
BEARING_DEPTH_M = 0.002
SURFACE_POINTS = 2500
APPROACH_M = 0.06
TABLE_CLEARANCE_M = 0.002
# How far a detected grasp is off, along and about each axis, and how many such errors are tried.
ERROR_M = 0.0025
ERROR_RAD = np.radians(2.5)
ERRORS = 16
# Openings that are tried where the width of what lies between the pads isn't known; the first of
# equals counts.
TRIED_OPENINGS_M = (MAX_OPENING_M, 0.055, 0.04, 0.03)

# What is thinner than this may be too thin once it has turned between the pads, about x or z.
THICK_M = 0.02
_SETTLING = np.array(
    [
        make_pose(Rotation.from_rotvec(angle * np.array(axis)).as_matrix())
        for angle in np.radians(np.linspace(-24.0, 24.0, 13))
        for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    ]
)

_PAD_X, _PAD_Z = (
    grid.ravel()
    for grid in np.meshgrid(
        np.linspace(-0.4, 0.4, 5) * PAD_SIZE_M[0], np.linspace(-0.45, 0.45, 7) * PAD_SIZE_M[1]
    )
)


@dataclass(frozen=True)
class GraspCheck:
    """What geometry says of grasps (N).

    Attributes:
        qualities: (N,) in [0, 1], see `GraspJudge.qualities`.
        openings_m: (N,) that the hand comes in with.
        collides: (N,) whether the opened hand hits the object, at the grasp or on its way there.
    """

    qualities: Array
    openings_m: Array
    collides: NDArray[np.bool_]

    @property
    def good(self) -> NDArray[np.bool_]:
        """(N,): whether a grasp holds and can be reached."""
        return (self.qualities >= MIN_QUALITY) & ~self.collides


def opening_for(widths_m: Array) -> Array:
    """Return the openings (N,) for objects of these widths."""
    return np.clip(widths_m + 2.0 * SIDE_ROOM_M, 0.0, MAX_OPENING_M)


class GraspJudge:
    """Judges grasps of one mesh, given in its frame O.

    Args:
        mesh: of the object.
        cone_rad: half-angle of the friction cone that contacts must lie in.
    """

    def __init__(self, mesh: trimesh.Trimesh, cone_rad: float = CONE_RAD) -> None:
        self._mesh = mesh
        self._least_cosine = np.cos(cone_rad)
        self._caster = RayCaster(mesh)
        self._p_OSurface, _ = trimesh.sample.sample_surface(mesh, SURFACE_POINTS, seed=0)

    def check(self, X_OGs: Array) -> GraspCheck:
        """Judge grasps (N, 4, 4) with the best of the openings that are tried."""
        checks = [
            self.check_opened(X_OGs, np.full(len(X_OGs), opening)) for opening in TRIED_OPENINGS_M
        ]
        ranks = np.stack([check.qualities - check.collides for check in checks])
        best, each = ranks.argmax(axis=0), np.arange(len(X_OGs))
        return GraspCheck(
            np.stack([check.qualities for check in checks])[best, each],
            np.array(TRIED_OPENINGS_M)[best],
            np.stack([check.collides for check in checks])[best, each],
        )

    def check_opened(self, X_OGs: Array, openings_m: Array) -> GraspCheck:
        """Judge grasps (N, 4, 4) where the hand comes in opened by `openings_m` (N,)."""
        qualities = self.qualities(X_OGs, openings_m)
        return GraspCheck(qualities, openings_m, self.collides(X_OGs, openings_m))

    def steadiness(
        self,
        X_OGs: Array,
        openings_m: Array,
        rng: np.random.Generator,
        least_quality: float = MIN_QUALITY,
    ) -> Array:
        """Return (N,) in [0, 1]: how often grasps (N, 4, 4) stay good where they are a little off.

        That is the share of `ERRORS` normal errors of `ERROR_M` and `ERROR_RAD` an axis with which
        the hand, opened by `openings_m` (N,), still hits nothing and closes with `least_quality`.
        """
        count = len(X_OGs) * ERRORS
        turns = Rotation.from_rotvec(rng.normal(0.0, ERROR_RAD, (count, 3))).as_matrix()
        X_OGErrors = np.repeat(X_OGs, ERRORS, axis=0) @ make_pose(
            turns, rng.normal(0.0, ERROR_M, (count, 3))
        )
        check = self.check_opened(X_OGErrors, np.repeat(openings_m, ERRORS))
        good = (check.qualities >= least_quality) & ~check.collides
        return good.reshape(-1, ERRORS).mean(axis=1)

    def qualities(self, X_OGs: Array, openings_m: Array) -> Array:
        """Return (N,) how much of the pads bears, and how far they may slide and still do.

        Lines run from the opened pads' faces inwards.  A line bears where both pads meet material
        on it within the friction cone and within `BEARING_DEPTH_M` of where the flat pad stops.
        The quality is the mean of the share of lines that bear (over `FULL_SHARE`) and of the
        least slide along x or z that leaves all of them behind, over half the pad's size.
        """
        bears = self._bears(X_OGs, openings_m, 1.0) & self._bears(X_OGs, openings_m, -1.0)
        share = np.minimum(1.0, bears.mean(axis=1) / FULL_SHARE)
        slides = [
            _least_slide(bears, at, size_m / 2.0)
            for at, size_m in zip((_PAD_X, _PAD_Z), PAD_SIZE_M, strict=True)
        ]
        return np.where(bears.any(axis=1), (share + np.minimum(*slides)) / 2.0, 0.0)

    def closed_widths(self, X_OGs: Array, openings_m: Array) -> Array:
        """Return (N,) how far the pads are apart when both have met material; 0 where one does not.

        Each pad goes its own way until it meets material, as if the object slid between them.
        """
        ways = [self._ways(X_OGs, openings_m, side)[0].min(axis=1) for side in (1.0, -1.0)]
        meets = (ways[0] < openings_m) & (ways[1] < openings_m)
        return np.where(meets, np.maximum(openings_m - ways[0] - ways[1], 0.0), 0.0)

    def settled_widths(self, X_OGs: Array, openings_m: Array) -> Array:
        """Return (N,) the least of `closed_widths` as the object turns a little between the pads.

        Of what is pinched askew the pads are as far apart as its faces once they lie flat on them.
        What is `THICK_M` wide or more is left as it is.
        """
        widths_m = self.closed_widths(X_OGs, openings_m)
        thin = np.flatnonzero((widths_m > 0.0) & (widths_m < THICK_M))
        if len(thin):
            for turn in _SETTLING:
                turned_m = self.closed_widths(X_OGs[thin] @ turn, openings_m[thin])
                closer = np.where(turned_m > 0.0, turned_m, THICK_M)
                widths_m[thin] = np.minimum(widths_m[thin], closer)
        return widths_m

    def _bears(self, X_OGs: Array, openings_m: Array, side: float) -> NDArray[np.bool_]:
        """Return (N, L): whether the pad at y = side * opening / 2 bears along its lines."""
        distances, cosines = self._ways(X_OGs, openings_m, side)
        square = cosines > self._least_cosine
        stops = distances.min(axis=1, keepdims=True) + BEARING_DEPTH_M
        return square & (distances < openings_m[:, None]) & (distances < stops)

    def _ways(self, X_OGs: Array, openings_m: Array, side: float) -> tuple[Array, Array]:
        """Return (N, L) how far a pad's lines run to what they meet, and how squarely they do."""
        shape = (len(X_OGs), len(_PAD_X))
        p_GMiddles = np.column_stack([_PAD_X, np.zeros_like(_PAD_X), _PAD_Z])
        outward = side * X_OGs[:, None, :3, 1]
        origins = transform_points(X_OGs, p_GMiddles) + openings_m[:, None, None] / 2.0 * outward
        inward = np.broadcast_to(-outward, (*shape, 3)).reshape(-1, 3)
        hits, faces = self._caster.cast(origins.reshape(-1, 3), inward)
        cosines = np.einsum("ni,ni->n", self._mesh.face_normals[faces], -inward)
        return hits.reshape(shape).astype(float), cosines.reshape(shape)

    def collides(self, X_OGs: Array, openings_m: Array) -> NDArray[np.bool_]:
        """Return (N,): whether the hand, or its way in along z_G, holds a point of the surface."""
        hits = np.zeros(len(X_OGs), dtype=bool)
        p_OPs = self._p_OSurface.astype(np.float32)
        X_GOs = invert_pose(X_OGs).astype(np.float32)
        for chosen, boxes in _hands(openings_m):
            for part in np.array_split(chosen, len(chosen) // 200 + 1):
                p_GPs = p_OPs @ X_GOs[part, :3, :3].swapaxes(1, 2) + X_GOs[part, None, :3, 3]
                hits[part] = _any_inside(p_GPs, boxes)
        return hits


def _least_slide(bears: NDArray[np.bool_], at: Array, half_m: float) -> Array:
    """Return (N,) in [0, 1] the least slide that loses all bearing lines (N, L), over `half_m`.

    `at` (L,) is where the lines lie along the direction of the slide, from the pad's middle.
    """
    highest = np.where(bears, at, -half_m).max(axis=1)
    lowest = np.where(bears, at, half_m).min(axis=1)
    return np.clip(np.minimum(half_m + highest, half_m - lowest) / half_m, 0.0, 1.0)


def _any_inside(p_GPs: Array, boxes: tuple[Box, ...]) -> NDArray[np.bool_]:
    """Return (N,): whether any of the points (N, M, 3) lies in a box swept along the approach."""
    x, y, z = np.abs(p_GPs[..., 0]), p_GPs[..., 1], p_GPs[..., 2]
    inside = np.zeros(p_GPs.shape[:2], dtype=bool)
    for box in boxes:
        (_, y0, z0), (x1, y1, z1) = box.lower, box.upper
        inside |= (x < x1) & (y > y0) & (y < y1) & (z > z0 - APPROACH_M) & (z < z1)
    return np.any(inside, axis=1)


def _hands(openings_m: Array) -> Iterator[tuple[NDArray[np.int_], tuple[Box, ...]]]:
    """Yield the grasps of about equal openings, to 2 mm, and the boxes of a hand so opened."""
    bins = np.minimum(np.ceil(openings_m * 500.0 - 1e-6) / 500.0, MAX_OPENING_M)
    for opening_m in np.unique(bins):
        yield np.flatnonzero(bins == opening_m), gripper_boxes(float(opening_m))


def hand_corners(X_OGs: Array, openings_m: Array) -> Array:
    """Return (N, K, 3) the corners in O of the boxes that make up the opened hands."""
    p_GCorners = np.zeros((len(X_OGs), 8 * len(gripper_boxes(MAX_OPENING_M)), 3))
    for chosen, boxes in _hands(openings_m):
        p_GCorners[chosen] = np.concatenate(
            [trimesh.bounds.corners([box.lower, box.upper]) for box in boxes]
        )
    return transform_points(X_OGs, p_GCorners)


def reachable(X_WO: Array, X_OGs: Array, p_OCorners: Array, table_z_m: float) -> NDArray[np.bool_]:
    """Return (N,): whether hands with these corners (N, K, 3) clear the table.

    The table's top is at `table_z_m` in W.  The approach must be within 90 degrees of straight down
    (paper section V).
    """
    z_WO = X_WO[2, :3]
    lowest_m = (p_OCorners @ z_WO).min(axis=1) + (X_WO[2, 3] - table_z_m)
    return (lowest_m > TABLE_CLEARANCE_M) & (X_OGs[:, :3, 2] @ z_WO < 0.0)


def feasible(X_WO: Array, X_OGs: Array, openings_m: Array, table_z_m: float) -> NDArray[np.bool_]:
    """Return (N,): whether the hand clears the table and comes from above, the object at X_WO.

    The table's top is at `table_z_m` in W.
    """
    return reachable(X_WO, X_OGs, hand_corners(X_OGs, openings_m), table_z_m)
