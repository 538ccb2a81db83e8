"""The collision world: the robot, the static station, and the object as a perceived cloud.

Robot against table, hook and itself is Drake's `SceneGraphCollisionChecker`.  The object is a set
of points with a radius, standing in the world or held by the hand; it is checked by the distances
of its points, so that contacts can be exempted point by point and objects change for free.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from pydrake.common import Parallelism
from pydrake.planning import RobotDiagramBuilder, SceneGraphCollisionChecker

from planning.collision.distances import (
    distance_to_box,
    distance_to_segments,
    distance_to_solid,
    hook_capsules,
)
from planning.collision.exemptions import MAX_TABLE_DEPTH_M
from planning.collision.points import (
    POINT_RADIUS_M,
    BoolArray,
    apart,
    arm_clear,
    hand_clear,
    posed,
)
from planning.subgoal import AllowedContact
from split_drake.objects.rigid import Primitive
from split_drake.poses import Array
from split_drake.robot.gripper import PALM, Box, finger_boxes
from split_drake.robot.kinematics import X_7G, link_poses
from split_drake.robot.panda import add_panda, panda_positions
from split_drake.station.fixtures import (
    add_bin,
    add_hook,
    add_solids,
    add_table,
    bin_primitives,
)
from split_drake.station.layout import Layout

# Joint motions are checked at steps of this size.
EDGE_STEP_RAD = 0.02
SPARSE_STEP = 6
# The robot stays this far from hook and table, and further from the table where it moves fast,
# which is where it declares no contact: the arm follows its commands within some millirad, and is a
# metre long.
HOOK_MARGIN_M = 0.004
TABLE_MARGIN_M, FAST_TABLE_MARGIN_M = 0.001, 0.006


@dataclass(frozen=True)
class Situation:
    """What the hand holds and what stands around it during a motion.

    Attributes:
        opening_m: distance between the pads.
        p_WStanding: (N, 3) points of what stands in the world, or None.
        p_GHeld: (N, 3) points of an object in the hand, or None; they keep clear of what stands.
        peg_exempt: (N,) the held points that HELD_PEG exempts.
        table_below_m: height of the gripper (z of G in W) below which HELD_TABLE acts.
        allowed: declared contacts; HELD_PEG acts on `peg_exempt` alone.
    """

    opening_m: float
    p_WStanding: Array | None = None
    p_GHeld: Array | None = None
    peg_exempt: BoolArray | None = None
    table_below_m: float = np.inf
    allowed: frozenset[AllowedContact] = frozenset()


class CollisionWorld:
    """Checks configurations of the arm against everything around it.

    Attributes:
        checker: of the robot against the static station and itself, with margins.
        free_motion_checker: with the larger ones of free motions.
        layout: of the station.
        p_WObstacles: (O, 3) points that stand beside the object, which nothing may touch.

    Args:
        layout: of the station.
        solids: boxes and cylinders that stand in the world, their poses in W, without a margin.
    """

    def __init__(self, layout: Layout, solids: Sequence[Primitive] = ()) -> None:
        self.layout = layout
        self.p_WObstacles: Array = np.empty((0, 3))
        self.checker = static_checker(layout, HOOK_MARGIN_M, TABLE_MARGIN_M, solids)
        self.free_motion_checker = static_checker(
            layout, HOOK_MARGIN_M, FAST_TABLE_MARGIN_M, solids
        )
        self._peg, self._post = hook_capsules(layout)
        self._bin = tuple(_box_in_world(each) for each in bin_primitives(layout))
        self._solids = tuple(solids)

    def among(self, p_WObstacles: Array) -> "CollisionWorld":
        """Return the same world with obstacles (O, 3) in place of those that it has."""
        world = copy(self)
        world.p_WObstacles = np.asarray(p_WObstacles, dtype=float)
        return world

    def free(self, qs: Array, situation: Situation) -> BoolArray:
        """Return (N,): which configurations (N, 7) touch nothing that is not allowed."""
        checker = self.checker if situation.allowed else self.free_motion_checker
        arms = [panda_positions(q, situation.opening_m) for q in qs]
        free = np.array([checker.CheckConfigCollisionFree(arm) for arm in arms], dtype=bool)
        if free.any():
            free[free] = self._object_free(qs[free], situation)
        return free

    def poses_free(self, X_WGs: Array, situation: Situation) -> bool:
        """Return whether hand and held object touch nothing at any of the poses (B, 4, 4).

        That is what of `free` does not depend on the arm: no configuration is free that reaches a
        pose where this is false.
        """
        free = np.ones(len(X_WGs), dtype=bool)
        return bool(self._hand_free(X_WGs, situation, free).all())

    def path_free(self, qs: Array, situation: Situation) -> bool:
        """Return whether the straight joint motions through `qs` (N, 7) are free.

        Motions that are not mostly show it at a few places; these are looked at first.
        """
        dense = densified(qs, EDGE_STEP_RAD)
        sparse = np.zeros(len(dense), dtype=bool)
        sparse[::SPARSE_STEP] = True
        return bool(
            self.free(dense[sparse], situation).all() and self.free(dense[~sparse], situation).all()
        )

    def _object_free(self, qs: Array, situation: Situation) -> BoolArray:
        free = np.ones(len(qs), dtype=bool)
        standing = self._standing(situation)
        if situation.p_GHeld is None and not standing:
            return free
        X_WLs = link_poses(qs)
        X_WGs = X_WLs[:, 6] @ X_7G
        free = self._hand_free(X_WGs, situation, free)
        for p_WPs, _ in standing:
            free[free] = arm_clear(X_WLs[free], p_WPs, last_link=7)
        if situation.p_GHeld is not None:
            held = posed(X_WGs[free], situation.p_GHeld)
            free[free] = arm_clear(X_WLs[free], held, last_link=6)
        return free

    def _hand_free(self, X_WGs: Array, situation: Situation, free: BoolArray) -> BoolArray:
        """Return which of the `free` (B,) hands, with what they hold, touch nothing at X_WGs."""
        for p_WPs, allowed in self._standing(situation):
            boxes = _boxes_that_may_not_touch(situation.opening_m, allowed)
            free[free] = hand_clear(X_WGs[free], p_WPs, boxes)
        if situation.p_GHeld is not None:
            free[free] = self._held_free(X_WGs[free], situation)
        return free

    def _held_free(self, X_WGs: Array, situation: Situation) -> BoolArray:
        """Return (B,): whether what hands at X_WGs (B, 4, 4) hold touches nothing but the arm."""
        assert situation.p_GHeld is not None
        p_WPs = posed(X_WGs, situation.p_GHeld)
        free = self._clear_of_table(p_WPs, X_WGs[:, 2, 3], situation)
        free &= self._clear_of_hook(p_WPs, situation)
        free &= self._clear_of_bin(p_WPs)
        free &= self._clear_of_solids(p_WPs)
        for p_WOthers, _ in self._standing(situation):
            free &= apart(p_WPs, p_WOthers)
        return free

    def _standing(self, situation: Situation) -> list[tuple[Array, frozenset[AllowedContact]]]:
        """Return the points of what stands in the world, and how the robot may touch them."""
        found = [(self.p_WObstacles, frozenset[AllowedContact]())]
        if situation.p_WStanding is not None:
            found.insert(0, (situation.p_WStanding, situation.allowed))
        return [(points, allowed) for points, allowed in found if len(points)]

    def _clear_of_table(self, p_WPs: Array, z_WGs: Array, situation: Situation) -> BoolArray:
        """Return (B,): whether held points (B, N, 3) are above the table, or as deep as allowed.

        `z_WGs` (B,) are the heights of the gripper.
        """
        exempt = np.zeros(len(p_WPs), dtype=bool)
        if AllowedContact.HELD_TABLE in situation.allowed:
            exempt = z_WGs < situation.table_below_m
        floors = self.layout.table_z_m + np.where(exempt, -MAX_TABLE_DEPTH_M, POINT_RADIUS_M)
        return np.asarray(p_WPs[..., 2].min(axis=1) > floors)

    def _clear_of_hook(self, p_WPs: Array, situation: Situation) -> BoolArray:
        """Return (B,): whether the held points (B, N, 3) are clear of the hook, or exempt."""
        free = np.ones(len(p_WPs), dtype=bool)
        for capsule in (self._peg, self._post):
            gap = capsule.radius_m + POINT_RADIUS_M
            touching = distance_to_segments(p_WPs, *capsule.p_FEnds) < gap
            if capsule is self._peg and AllowedContact.HELD_PEG in situation.allowed:
                touching &= ~_required(situation.peg_exempt)
            free &= ~touching.any(axis=1)
        return free

    def _clear_of_bin(self, p_WPs: Array) -> BoolArray:
        """Return (B,): whether the held points (B, N, 3) are clear of the bin's walls."""
        free = np.ones(len(p_WPs), dtype=bool)
        for wall in self._bin:
            free &= distance_to_box(p_WPs, wall).min(axis=1) > POINT_RADIUS_M
        return free

    def _clear_of_solids(self, p_WPs: Array) -> BoolArray:
        """Return (B,): whether the held points (B, N, 3) are clear of the world's solids."""
        free = np.ones(len(p_WPs), dtype=bool)
        for solid in self._solids:
            free &= distance_to_solid(p_WPs, solid).min(axis=1) > POINT_RADIUS_M
        return free


def densified(qs: Array, step_rad: float) -> Array:
    """Return the path (M, 7) with no joint moving by more than `step_rad` between neighbours."""
    pieces = [qs[:1]]
    for start, end in pairwise(qs):
        count = max(1, int(np.ceil(np.abs(end - start).max() / step_rad)))
        shares = np.arange(1, count + 1)[:, None] / count
        pieces.append(start + shares * (end - start))
    return np.concatenate(pieces)


def _boxes_that_may_not_touch(
    opening_m: float, allowed: frozenset[AllowedContact]
) -> tuple[Box, ...]:
    """Return the palm and, unless they may touch the target, the fingers."""
    fingers = AllowedContact.FINGERS_TARGET not in allowed
    return (PALM, *finger_boxes(opening_m)) if fingers else (PALM,)


def _box_in_world(primitive: Primitive) -> Box:
    """Return a box primitive whose pose does not turn it."""
    half, center = np.asarray(primitive.size) / 2.0, primitive.X_OP[:3, 3]
    return Box(tuple(center - half), tuple(center + half))


def _required(mask: BoolArray | None) -> BoolArray:
    if mask is None:
        raise ValueError("HELD_PEG is allowed but no points are exempt; expected peg_exempt")
    return mask


def static_checker(
    layout: Layout,
    hook_margin_m: float,
    table_margin_m: float,
    solids: Sequence[Primitive] = (),
) -> SceneGraphCollisionChecker:
    """Return the checker of the robot against table, hook and bin, grown by margins, and itself.

    The bin has the table's margin, `solids` have none.
    """
    hook = replace(
        layout.hook,
        peg_radius_m=layout.hook.peg_radius_m + hook_margin_m,
        tip_distance_m=layout.hook.tip_distance_m + hook_margin_m,
        post_radius_m=layout.hook.post_radius_m + hook_margin_m,
        post_above_m=layout.hook.post_above_m + hook_margin_m,
    )
    builder = RobotDiagramBuilder(time_step=0.001)
    panda = add_panda(builder.plant())
    add_table(builder.plant(), layout, table_margin_m)
    add_hook(builder.plant(), replace(layout, hook=hook))
    add_bin(builder.plant(), layout, table_margin_m)
    add_solids(builder.plant(), solids)
    return SceneGraphCollisionChecker(
        model=builder.Build(),
        robot_model_instances=[panda],
        edge_step_size=EDGE_STEP_RAD,
        env_collision_padding=0.0,
        self_collision_padding=0.0,
        implicit_context_parallelism=Parallelism(1),
    )
