"""Grasps that suit how an object lies: from above, the pads just clear of the table.

A hand that is wide open fits over what lies flat only where it comes nearly straight down; of
grasps that are turned anyhow about their line hardly any does.
"""

import numpy as np
import trimesh
from trimesh.poses import compute_stable_poses

from split_drake.poses import Array, make_pose
from split_drake.robot.open_hand import lowest_heights

# Poses that an object comes to rest in less often are left out, and no more are looked at.
LEAST_PROBABILITY, MOST_POSES = 0.03, 6
# The line between the pads may rise by so much; the hand is turned about it by so much.
MAX_RISE_RAD = np.radians(20.0)
TILT_RAD = np.radians(12.0)
# Room between the open hand's lowest point and the table.
CLEARANCE_M = (0.0, 0.004)
# Grasps of higher places are drawn back by up to this; pads reach 11 mm beyond G.
MAX_BACK_M = 0.009


def resting_poses(mesh: trimesh.Trimesh, p_OCom: Array) -> Array:
    """Return X_TOs (K, 4, 4) of an object at rest on the table z = 0 of T, upright the first.

    The others are trimesh's stable poses of its convex hull, the likeliest first.
    """
    upright = make_pose(p=(0.0, 0.0, -mesh.bounds[0, 2]))
    X_TOs, probabilities = compute_stable_poses(
        mesh.convex_hull, center_mass=p_OCom, sigma=0.0, n_samples=1
    )
    likely = np.flatnonzero(probabilities >= LEAST_PROBABILITY)[:MOST_POSES]
    return np.concatenate([upright[None], np.asarray(X_TOs)[likely].reshape(-1, 4, 4)])


def grasps_from_above(lines: Array, X_TO: Array, count: int, rng: np.random.Generator) -> Array:
    """Return at most `count` grasps X_OGs (N, 4, 4) across lines (M, 2, 3) of an object at X_TO.

    The hand, wide open, clears the table z = 0 of T; where that draws it back from its line by more
    than `MAX_BACK_M`, there is no grasp.
    """
    ends = lines @ X_TO[:3, :3].T + X_TO[:3, 3]
    span = ends[:, 1] - ends[:, 0]
    level = np.abs(span[:, 2]) < np.sin(MAX_RISE_RAD) * np.linalg.norm(span, axis=1)
    chosen = rng.permutation(np.flatnonzero(level))[:count]
    y = span[chosen] / np.linalg.norm(span[chosen], axis=1, keepdims=True)
    down = y[:, 2:] * y - (0.0, 0.0, 1.0)
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    tilt = rng.normal(0.0, TILT_RAD, (len(y), 1))
    z = np.cos(tilt) * down + np.sin(tilt) * np.cross(y, down)
    R_TGs = np.stack([np.cross(y, z), y, z], axis=-1)
    p_TGs = ends[chosen].mean(axis=1)
    lowest_m = lowest_heights(make_pose(R_TGs, p_TGs))
    short_m = rng.uniform(*CLEARANCE_M, len(y)) - lowest_m
    needed_m = np.maximum(short_m, 0.0) / np.maximum(-z[:, 2], 0.1)
    back_m = np.maximum(needed_m, rng.uniform(0.0, MAX_BACK_M, len(y)))
    kept = needed_m < MAX_BACK_M
    X_TGs = make_pose(R_TGs, p_TGs - back_m[:, None] * z)[kept]
    X_OT = np.linalg.inv(X_TO)
    return X_OT @ X_TGs
