"""Registration of a cloud to a model of the same object, from a guess that is nearly right."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from split_drake.poses import Array, invert_pose, make_pose, transform_points

ITERATIONS = 20
# Points further from the model than this have no part in it; the limit shrinks from step to step.
FIRST_MATCH_M, LAST_MATCH_M = 0.015, 0.004
NORMAL_NEIGHBOURS = 12
# Starts are compared by this many points, and by how many of them are this near to the model.
START_POINTS, START_MATCH_M = 300, 0.006
# Standard deviations: of a point's distance to the model, and of the motion that is expected.
POINT_NOISE_M = 0.002
EXPECTED_SHIFT_M = 0.010
EXPECTED_TURN_RAD = np.radians(8.0)
# Points of one surface err together: all of them count as this many independent ones.
INDEPENDENT_POINTS = 60


@dataclass(frozen=True)
class Registration:
    """How a model has to be moved to lie where a cloud shows it.

    Attributes:
        X_AM: (4, 4) pose of the model M in the cloud's frame A; the identity where nothing moved.
        matched: share of the cloud's points that then lie within `LAST_MATCH_M` of the model.
        error_m: root mean square of their distances to its surface.
    """

    X_AM: Array
    matched: float
    error_m: float


def register(p_MPs: Array, p_APs: Array) -> Registration:
    """Return where the model (N, 3) lies in the cloud (M, 3), close to where it is expected.

    Iterated closest points, point to plane, with a prior: in directions that the cloud leaves open,
    such as the turn of a round body about its axis, the model stays as it is expected.

    Raises ValueError where either has fewer than `NORMAL_NEIGHBOURS` points.
    """
    if min(len(p_MPs), len(p_APs)) < NORMAL_NEIGHBOURS:
        raise ValueError(
            f"model and cloud have {len(p_MPs)} and {len(p_APs)} points; "
            f"expected at least {NORMAL_NEIGHBOURS} each"
        )
    surface = _Surface(p_MPs)
    motion = _Motion(p_MPs.mean(axis=0), np.zeros(3), Rotation.identity())
    for limit_m in np.geomspace(FIRST_MATCH_M, LAST_MATCH_M, ITERATIONS):
        matches = surface.matches(transform_points(motion.X_MA, p_APs), limit_m)
        if len(matches.offsets_m) < NORMAL_NEIGHBOURS:
            break
        motion = motion.improved(matches)
    final = surface.matches(transform_points(motion.X_MA, p_APs), LAST_MATCH_M)
    count = len(final.offsets_m)
    error_m = float(np.sqrt(np.square(final.offsets_m).sum() / count)) if count else np.inf
    return Registration(invert_pose(motion.X_MA), count / len(p_APs), error_m)


def nearest_start(p_MPs: Array, p_APs: Array, X_AMs: Array) -> Array:
    """Return which of the poses X_AMs (K, 4, 4) of a model (N, 3) a cloud (M, 3) fits best.

    The one with the most points of the cloud near the model; ties go to the first.
    """
    tree = KDTree(p_MPs)
    some = p_APs[:: max(1, len(p_APs) // START_POINTS)]
    shares = []
    for X_AM in X_AMs:
        p_MSeen = transform_points(invert_pose(X_AM), some)
        distances, _ = tree.query(p_MSeen, distance_upper_bound=START_MATCH_M)
        shares.append(np.isfinite(distances).mean())
    return np.asarray(X_AMs[int(np.argmax(shares))])


@dataclass(frozen=True)
class _Matches:
    """Points (K, 3) of the cloud, moved to the model, with normals (K, 3) and offsets (K,)."""

    p_MPs: Array
    normals_M: Array
    offsets_m: Array


class _Surface:
    """A model's points with their normals."""

    def __init__(self, p_MPs: Array) -> None:
        self._points = p_MPs
        self._tree = KDTree(p_MPs)
        _, neighbours = self._tree.query(p_MPs, NORMAL_NEIGHBOURS)
        patches = p_MPs[np.asarray(neighbours)]
        patches = patches - patches.mean(axis=1, keepdims=True)
        self._normals = np.linalg.eigh(np.swapaxes(patches, 1, 2) @ patches)[1][:, :, 0]

    def matches(self, p_MPs: Array, limit_m: float) -> _Matches:
        """Return which of the points (M, 3) are within a distance of the model, and how far off."""
        distances, nearest = self._tree.query(p_MPs, distance_upper_bound=limit_m)
        near = np.isfinite(distances)
        model = np.asarray(nearest)[near]
        points, normals = p_MPs[near], self._normals[model]
        offsets = np.einsum("ij,ij->i", points - self._points[model], normals)
        return _Matches(points, normals, offsets)


@dataclass(frozen=True)
class _Motion:
    """A motion of the cloud to the model: a turn about `p_MCenter` (3,), then a shift (3,)."""

    p_MCenter: Array
    shift_m: Array
    turn: Rotation

    @property
    def X_MA(self) -> Array:
        R_MA = self.turn.as_matrix()
        return make_pose(R_MA, self.p_MCenter - R_MA @ self.p_MCenter + self.shift_m)

    def improved(self, matches: _Matches) -> "_Motion":
        """Return the motion after one Gauss-Newton step on matches and prior."""
        levers = np.cross(matches.p_MPs - self.p_MCenter, matches.normals_M)
        jacobian = np.hstack([matches.normals_M, levers])
        weight = INDEPENDENT_POINTS / (len(jacobian) * POINT_NOISE_M**2)
        precision = np.repeat([EXPECTED_SHIFT_M**-2.0, EXPECTED_TURN_RAD**-2.0], 3)
        state = np.concatenate([self.shift_m, self.turn.as_rotvec()])
        hessian = weight * jacobian.T @ jacobian + np.diag(precision)
        gradient = weight * jacobian.T @ matches.offsets_m + precision * state
        step = -np.linalg.solve(hessian, gradient)
        turn = Rotation.from_rotvec(step[3:])
        return _Motion(self.p_MCenter, turn.apply(self.shift_m) + step[:3], turn * self.turn)
