"""Which grasps are true in a clutter scene: reachable, visible, and clear of everything else."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from split_drake.data.clutter.library import ClutterObject
from split_drake.poses import Array, transform_points
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.open_hand import OPEN_HAND, lowest_heights

# The hand comes in along the last 5 cm, wide open.
APPROACH_M = 0.05
# The hand may come as near to the table: where a fingertip meets it, the hand closes there.
TABLE_CLEARANCE_M = -0.001
# Approaches must come from above by more than this share of the approach's length.
LEAST_DESCENT = 0.05
# A grasp is visible where the cloud shows so many points between the pads.
VISIBLE_POINTS = 6
BETWEEN_PADS_M = (0.015, 0.5 * MAX_OPENING_M, 0.02)
# As many grasps of one object are looked at in a scene, and kept of a scene.
PER_OBJECT, TRUE_KEPT, FALSE_KEPT = 160, 96, 128
# Of one object, those that hit the table, or that are hidden, which are kept as false.
TABLE_KEPT = 8


@dataclass(frozen=True)
class SceneGrasps:
    """Grasps in one scene.

    Attributes:
        X_WGs: (T, 4, 4) true ones, T <= TRUE_KEPT.
        weights: (T,) how often to learn each, in (0, 1].
        X_WFs: (F, 4, 4) false ones, F <= FALSE_KEPT: those in collision first, about half of them.
    """

    X_WGs: Array
    weights: Array
    X_WFs: Array


def label_scene(
    objects: Sequence[ClutterObject],
    X_WOs: Array,
    p_WPs: Array,
    table_z_m: float,
    rng: np.random.Generator,
) -> SceneGrasps:
    """Return the grasps of objects at X_WOs (K, 4, 4), of which a cloud (N, 3) is seen.

    The table's top is at `table_z_m` in W.
    """
    surfaces = [
        transform_points(X_WO, each.p_OSurface) for each, X_WO in zip(objects, X_WOs, strict=True)
    ]
    tree = cKDTree(p_WPs)
    true, weights, blocked, other = [], [], [], []
    for number, (each, X_WO) in enumerate(zip(objects, X_WOs, strict=True)):
        X_WGs = X_WO @ each.grasps.X_OGs
        low = ~clears_table(X_WGs, table_z_m)
        chosen = np.r_[
            rng.permutation(np.flatnonzero(~low))[:PER_OBJECT],
            rng.permutation(np.flatnonzero(low))[:TABLE_KEPT],
        ]
        X_WGs, above = X_WGs[chosen], ~low[chosen]
        seen = np.zeros(len(X_WGs), dtype=bool)
        seen[above] = visible(X_WGs[above], p_WPs, tree)
        neighbours = [p for index, p in enumerate(surfaces) if index != number]
        free = seen.copy()
        if neighbours and seen.any():
            free[seen] = ~hand_hits(X_WGs[seen], np.concatenate(neighbours))
        true.append(X_WGs[free])
        weights.append(each.grasps.weights[chosen][free])
        blocked.append(X_WGs[seen & ~free])
        other += [X_WGs[above & ~seen][:TABLE_KEPT], X_WGs[~above]]
        failing = X_WO @ each.grasps.X_OFs[rng.permutation(len(each.grasps.X_OFs))[:20]]
        other.append(failing)
    X_WGs, of = np.concatenate(true), np.concatenate(weights)
    kept = rng.permutation(len(X_WGs))[:TRUE_KEPT]
    hits = np.concatenate(blocked)
    others = np.concatenate(other)
    # Neither kind may crowd the other out.
    hits = hits[rng.permutation(len(hits))[: max(FALSE_KEPT // 2, FALSE_KEPT - len(others))]]
    others = others[rng.permutation(len(others))[: FALSE_KEPT - len(hits)]]
    false = np.concatenate([hits, others])
    return SceneGrasps(X_WGs[kept], of[kept], false)


def clears_table(X_WGs: Array, table_z_m: float) -> NDArray[np.bool_]:
    """Return (N,): whether wide-open hands (N, 4, 4) clear the table and come from above.

    The table's top is at `table_z_m` in W.
    """
    clear = lowest_heights(X_WGs) - table_z_m > TABLE_CLEARANCE_M
    return np.asarray(clear & (X_WGs[:, 2, 2] < -LEAST_DESCENT))


def visible(X_WGs: Array, p_WPs: Array, tree: cKDTree) -> NDArray[np.bool_]:
    """Return (N,): whether the cloud (M, 3) with its tree shows what is between the pads."""
    if not len(X_WGs):
        return np.zeros(0, dtype=bool)
    reach_m = float(np.linalg.norm(BETWEEN_PADS_M))
    shown = np.zeros(len(X_WGs), dtype=bool)
    for number, p_WG in enumerate(X_WGs[:, :3, 3]):
        indices = tree.query_ball_point(p_WG, reach_m)
        if len(indices) >= VISIBLE_POINTS:
            offsets = p_WPs[indices] - X_WGs[number, :3, 3]
            p_GPs = np.abs(offsets @ X_WGs[number, :3, :3])
            shown[number] = np.all(p_GPs < BETWEEN_PADS_M, axis=1).sum() >= VISIBLE_POINTS
    return shown


def hand_hits(X_WGs: Array, p_WPs: Array) -> NDArray[np.bool_]:
    """Return (N,): whether wide-open hands (N, 4, 4), or their way in, hold a point (M, 3)."""
    R_WGs = X_WGs[:, :3, :3].astype(np.float32)
    p_GPs = (p_WPs.astype(np.float32)[None] - X_WGs[:, None, :3, 3].astype(np.float32)) @ R_WGs
    x, y, z = np.abs(p_GPs[..., 0]), p_GPs[..., 1], p_GPs[..., 2]
    inside = np.zeros(p_GPs.shape[:2], dtype=bool)
    for box in OPEN_HAND:
        (_, y0, z0), (x1, y1, z1) = box.lower, box.upper
        inside |= (x < x1) & (y > y0) & (y < y1) & (z > z0 - APPROACH_M) & (z < z1)
    return np.any(inside, axis=1)
