"""Closed-form kinematics of the Panda arm, vectorised with numpy.

Forward: modified Denavit-Hartenberg parameters of the manufacturer.  Inverse: the arm has seven
joints, so the last joint's angle is a parameter; for each value there are at most four solutions
(Y. He and S. Liu, "Analytical Inverse Kinematics for Franka Emika Panda", ICCMA 2021).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from split_drake.poses import Array, make_pose, rotation_z
from split_drake.robot.gripper import FLANGE_TO_GRIPPER_M
from split_drake.robot.panda import arm_limits

# Modified Denavit-Hartenberg rows (a, alpha, d) of links 1 to 7, metres and radians.
_HALF_PI = np.pi / 2.0
DH_ROWS = (
    (0.0, 0.0, 0.333),
    (0.0, -_HALF_PI, 0.0),
    (0.0, _HALF_PI, 0.316),
    (0.0825, _HALF_PI, 0.0),
    (-0.0825, -_HALF_PI, 0.384),
    (0.0, _HALF_PI, 0.0),
    (0.088, _HALF_PI, 0.0),
)
# The gripper in link 7: the hand is turned by -45 degrees about the flange's axis.
X_7G = make_pose(rotation_z(-np.pi / 4.0), (0.0, 0.0, FLANGE_TO_GRIPPER_M))

# A solution's gripper pose must equal the one asked for to this precision, elementwise.
FK_TOLERANCE = 1e-6
# Solutions closer than this to a joint's limit are left out, so that motions have room.
LIMIT_MARGIN_RAD = 0.02


def link_poses(qs: ArrayLike) -> Array:
    """Return X_WLs (N, 7, 4, 4) of links 1 to 7 at joint angles `qs` (N, 7)."""
    angles = np.asarray(qs, dtype=float)
    poses = np.empty((len(angles), 7, 4, 4))
    X_WL = np.broadcast_to(np.eye(4), (len(angles), 4, 4))
    for joint, (a, alpha, d) in enumerate(DH_ROWS):
        X_WL = X_WL @ _dh_transforms(a, alpha, d, angles[:, joint])
        poses[:, joint] = X_WL
    return poses


def gripper_poses(qs: ArrayLike) -> Array:
    """Return X_WGs (N, 4, 4) at joint angles `qs` (N, 7)."""
    return link_poses(qs)[:, 6] @ X_7G


def gripper_pose(q: ArrayLike) -> Array:
    """Return X_WG (4, 4) at joint angles `q` (7,)."""
    return np.asarray(gripper_poses(np.reshape(np.asarray(q, dtype=float), (1, 7)))[0])


def _dh_transforms(a: float, alpha: float, d: float, theta: Array) -> Array:
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    X = np.zeros((len(theta), 4, 4))
    X[:, 0, 0], X[:, 0, 1], X[:, 0, 3] = c, -s, a
    X[:, 1, 0], X[:, 1, 1], X[:, 1, 2], X[:, 1, 3] = s * ca, c * ca, -sa, -d * sa
    X[:, 2, 0], X[:, 2, 1], X[:, 2, 2], X[:, 2, 3] = s * sa, c * sa, ca, d * ca
    X[:, 3, 3] = 1.0
    return X


def closed_form_ik(X_WGs: ArrayLike, q7s: ArrayLike) -> tuple[Array, NDArray[np.intp]]:
    """Return the solutions for every gripper pose and every angle of the last joint.

    Those of a nearly stretched arm, whose fourth joint is above -0.467 rad, are not among them.

    Args:
        X_WGs: (N, 4, 4) gripper poses.
        q7s: (M,) angles of the last joint for all poses, or (N, M) for each pose its own, rad.

    Returns:
        (K, 7) joint angles inside the limits, each verified by forward kinematics, and (K,) the
        index of the pose that each belongs to, ascending.
    """
    poses = np.asarray(X_WGs, dtype=float)
    angles = np.asarray(q7s, dtype=float)
    angles = np.broadcast_to(angles, (len(poses), angles.shape[-1]))
    with np.errstate(invalid="ignore", divide="ignore"):
        qs = _solve(poses[:, None], angles)
    index = np.broadcast_to(np.arange(len(poses))[:, None, None], qs.shape[:-1]).reshape(-1)
    qs = qs.reshape(-1, 7)
    limits = arm_limits()
    inside = np.all(
        (qs > limits.q_lower + LIMIT_MARGIN_RAD) & (qs < limits.q_upper - LIMIT_MARGIN_RAD), axis=1
    )
    qs, index = qs[inside], index[inside]
    exact = np.abs(gripper_poses(qs) - poses[index]).max(axis=(1, 2), initial=0.0) < FK_TOLERANCE
    return qs[exact], index[exact]


_D1, _D3, _D5, _A4, _A7 = 0.333, 0.316, 0.384, 0.0825, 0.088
_L24, _L46 = np.hypot(_A4, _D3), np.hypot(_A4, _D5)
_ANGLE_342, _ANGLE_H46 = np.arctan(_D3 / _A4), np.arctan(_D5 / _A4)
_ANGLE_46H = np.arctan(_A4 / _D5)


# No gripper is further from the shoulder: upper arm, forearm, and wrist with hand in a line.
REACH_M = float(_L24 + _L46 + np.hypot(_A7, FLANGE_TO_GRIPPER_M))


def shoulder_distances(p_WPs: ArrayLike) -> Array:
    """Return how far points (N, 3) are from the shoulder (N,), metres; cf. `REACH_M`."""
    return np.asarray(np.linalg.norm(np.asarray(p_WPs, float) - (0.0, 0.0, _D1), axis=-1))


def _solve(X_WG: Array, q7: Array) -> Array:
    """Return (N, M, 4, 7) candidate solutions, NaN where there are none.

    Points and angles are named as in the paper: O2 shoulder, O4 elbow, O6 wrist, H the foot on
    joint 5's axis, P where the axes of joints 3 and 5 meet.
    """
    R, z7 = X_WG[..., :3, :3], X_WG[..., :3, 2]
    across = np.stack([np.cos(q7 - np.pi / 4), -np.sin(q7 - np.pi / 4), 0.0 * q7], axis=-1)
    x6 = np.einsum("...ij,...j->...i", R, across)
    p_O2 = np.array([0.0, 0.0, _D1])
    p_O6 = X_WG[..., :3, 3] - FLANGE_TO_GRIPPER_M * z7 - _A7 * x6
    v_26 = p_O6 - p_O2
    l_26 = np.linalg.norm(v_26, axis=-1)
    angle_246 = np.arccos((_L24**2 + _L46**2 - l_26**2) / (2.0 * _L24 * _L46))
    angle_462 = np.arccos((l_26**2 + _L46**2 - _L24**2) / (2.0 * l_26 * _L46))
    q4 = angle_246 + _ANGLE_H46 + _ANGLE_342 - 2.0 * np.pi
    angle_26h = _ANGLE_46H + angle_462
    angle_p26 = 1.5 * np.pi - angle_462 - angle_246 - _ANGLE_342
    l_p6 = l_26 * np.sin(angle_p26) / np.sin(angle_p26 + angle_26h)

    z6 = np.cross(np.broadcast_to(z7, x6.shape), x6)
    R_6 = np.stack([x6, np.cross(z6, x6), z6], axis=-1)
    v_6 = -np.einsum("...ji,...j->...i", R_6, v_26)
    phase = np.arctan2(v_6[..., 1], v_6[..., 0])
    swing = np.arcsin(-l_26 * np.cos(angle_26h) / np.hypot(v_6[..., 0], v_6[..., 1]))
    solutions = []
    for q6 in (np.pi - swing - phase, swing - phase):
        q6 = _wrap_up(q6, float(arm_limits().q_lower[5]))
        axis5 = np.stack([np.sin(q6), np.cos(q6), 0.0 * q6], axis=-1)
        z5 = np.einsum("...ij,...j->...i", R_6, axis5)
        shoulder = _shoulder_angles(p_O6 - l_p6[..., None] * z5 - p_O2, v_26, z5, R_6, q6)
        for q1, q2, q3, q5 in shoulder:
            solutions.append(np.stack([q1, q2, q3, q4, q5, q6, q7], axis=-1))
    return np.stack(solutions, axis=-2)


def _shoulder_angles(
    v_2p: Array, v_26: Array, z5: Array, R_6: Array, q6: Array
) -> list[tuple[Array, Array, Array, Array]]:
    """Return the two choices of (q1, q2, q3, q5) for given wrist geometry."""
    z3 = v_2p / np.linalg.norm(v_2p, axis=-1, keepdims=True)
    y3 = np.cross(v_2p, v_26)
    x3 = np.cross(y3 / np.linalg.norm(y3, axis=-1, keepdims=True), z3)
    v_h4 = _D3 * z3 + _A4 * x3 - v_26 + _D5 * z5
    v_h4_in_6 = np.einsum("...ji,...j->...i", R_6, v_h4)
    c6, s6 = np.cos(q6), np.sin(q6)
    in_plane = c6 * v_h4_in_6[..., 0] - s6 * v_h4_in_6[..., 1]
    q5 = -np.arctan2(-v_h4_in_6[..., 2], in_plane)
    q1, q2 = np.arctan2(z3[..., 1], z3[..., 0]), np.arccos(z3[..., 2])
    flipped = np.where(q1 > 0.0, q1 - np.pi, q1 + np.pi)
    return [(a, b, _upper_arm_angle(a, b, x3), q5) for a, b in ((q1, q2), (flipped, -q2))]


def _upper_arm_angle(q1: Array, q2: Array, x3: Array) -> Array:
    """Return q3, by which x3 (..., 3) is turned about joint 3's axis."""
    c1, s1, c2, s2 = np.cos(q1), np.sin(q1), np.cos(q2), np.sin(q2)
    along = c2 * (c1 * x3[..., 0] + s1 * x3[..., 1]) - s2 * x3[..., 2]
    across = -s1 * x3[..., 0] + c1 * x3[..., 1]
    return np.arctan2(across, along)


def _wrap_up(angle: Array, lower: float) -> Array:
    """Return `angle` moved by whole turns into [lower, lower + 2 pi)."""
    return lower + np.mod(angle - lower, 2.0 * np.pi)
