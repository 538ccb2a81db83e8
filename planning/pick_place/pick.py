"""Picks: for one grasp, the configurations from which to approach, close and lift."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planning.collision.exemptions import TABLE_LIFT_M
from planning.collision.world import CollisionWorld, Situation
from planning.geometry.perceived import PerceivedObject
from planning.geometry.waypoints import APPROACH_M, LINE_STEP_M, backed_off, shifted, straight_line
from planning.motion.ik import DrakeIk, follow, solve_ik
from planning.pick_place.fingers import RELEASE_CLEARANCE_M, FingerFit, fit_fingers
from planning.subgoal import AllowedContact
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import gripper_pose

APPROACHES_M = (APPROACH_M, 0.06)
LIFTS_M = (0.10, 0.06)
# A posture in the middle of the arm's range, over the workspace.
Q_COMFORT = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, np.pi / 4.0])
# Configurations tried for one grasp.
MAX_CONFIGURATIONS = 6


@dataclass(frozen=True)
class Pick:
    """A feasible way to take the object.

    Attributes:
        X_WG: (4, 4) grasp.
        opening_m: of the fingers before they close.
        release_m: to which they open when they let go.
        held_width_m: expected between the pads once they have closed.
        approach_qs: (A, 7) from the pregrasp to the grasp.
        lift_qs: (L, 7) from the grasp upwards.
        lifting: the situation during the lift.
    """

    X_WG: Array
    opening_m: float
    release_m: float
    held_width_m: float
    approach_qs: Array
    lift_qs: Array
    lifting: Situation

    def held(self, p_WPs: Array) -> Array:
        """Return points (N, 3) of the object before the pick in the gripper's frame, p_GPs."""
        return transform_points(invert_pose(self.X_WG), p_WPs)


def held_pick(q: Array, held_width_m: float, target: PerceivedObject) -> Pick:
    """Return the pick of an object that the hand holds already, at `q` (7,).

    It is let go by opening clearly further than it is wide, whatever its cloud, which is some
    millimetres off, makes of that.
    """
    X_WG = gripper_pose(q)
    free_m = min(MAX_OPENING_M, held_width_m + 2.0 * RELEASE_CLEARANCE_M)
    release_m = max(fit_fingers(X_WG, target.p_WDetails).release_m, free_m)
    holding = Situation(
        held_width_m, p_GHeld=transform_points(invert_pose(X_WG), target.p_WObstacles)
    )
    return Pick(X_WG, release_m, release_m, held_width_m, q[None], q[None], holding)


@dataclass(frozen=True)
class _Ways:
    """What the hand may do about one grasp, as far as hand and object alone tell.

    Attributes:
        X_WG: (4, 4) grasp.
        approaches: lines (N, 4, 4) from the grasp back to a pregrasp.
        lifts: lines (N, 4, 4) from the grasp up.
        grasping, before: the situation on an approach, and where it starts.
        lifting, lifted: the situation on a lift, and where it ends.
    """

    X_WG: Array
    approaches: list[Array]
    lifts: list[Array]
    grasping: Situation
    before: Situation
    lifting: Situation
    lifted: Situation


class PickSearch:
    """Finds picks and counts what grasps are rejected by."""

    def __init__(self, world: CollisionWorld, target: PerceivedObject, ik: DrakeIk) -> None:
        self._world = world
        self._target = target
        self._ik = ik
        self.rejected: Counter[str] = Counter()

    def find(self, X_WG: Array, fit: FingerFit) -> Pick | None:
        """Return a pick at the grasp (4, 4), where the hand fits as given, or None."""
        if not fit.clears:
            self.rejected["no opening clears the object"] += 1
            return None
        # Of what a grasp pinches nothing may have been seen.
        if not (fit.pinches or fit_fingers(X_WG, self._target.p_WSurface).pinches):
            self.rejected["nothing between the pads"] += 1
            return None
        qs = solve_ik(X_WG[None]).of(0, Q_COMFORT)
        ways, reason = self._ways(X_WG, fit) if len(qs) else (None, "IK")
        if ways is not None:
            for q in self._configurations(X_WG, qs):
                pick, reason = self._from_configuration(q, ways, fit)
                if pick is not None:
                    return pick
        self.rejected[reason] += 1
        return None

    def _ways(self, X_WG: Array, fit: FingerFit) -> tuple[_Ways | None, str]:
        """Return how the hand may come and go, or why it cannot, whatever brings it there."""
        standing = self._target.p_WObstacles
        touching = frozenset({AllowedContact.FINGERS_TARGET})
        grasping = Situation(fit.opening_m, p_WStanding=standing, allowed=touching)
        if not self._world.poses_free(X_WG[None], grasping):
            return None, "collision at the grasp"
        before = Situation(fit.opening_m, p_WStanding=standing)
        backs = [backed_off(X_WG, distance) for distance in APPROACHES_M]
        approaches = self._lines(X_WG, backs, grasping, before)
        if not approaches:
            return None, "collision on the approach"
        lifting = self._lifting(X_WG, fit)
        lifted = Situation(lifting.opening_m, p_GHeld=lifting.p_GHeld)
        ups = [shifted(X_WG, (0.0, 0.0, height)) for height in LIFTS_M]
        lifts = self._lines(X_WG, ups, lifting, lifted)
        if not lifts:
            return None, "lift"
        return _Ways(X_WG, approaches, lifts, grasping, before, lifting, lifted), ""

    def _lines(
        self, X_WG: Array, X_WGends: list[Array], on_the_way: Situation, there: Situation
    ) -> list[Array]:
        """Return the lines (N, 4, 4) from the grasp to those ends that the hand can follow."""
        lines = [straight_line(X_WG, X_WGend, LINE_STEP_M) for X_WGend in X_WGends]
        return [
            line
            for line in lines
            if self._world.poses_free(line[-1:], there)
            and self._world.poses_free(np.concatenate([X_WG[None], line]), on_the_way)
        ]

    def _configurations(self, X_WG: Array, qs: Array) -> Iterator[Array]:
        """Yield the solution nearest to comfort, refined, and then the others as they are."""
        if not len(qs):
            return
        refined = self._ik.refine(X_WG, qs[0], Q_COMFORT)
        if refined is not None:
            exact = follow(refined, X_WG[None])
            if exact is not None:
                yield exact[0]
        yield from qs[:MAX_CONFIGURATIONS]

    def _from_configuration(self, q: Array, ways: _Ways, fit: FingerFit) -> tuple[Pick | None, str]:
        if not self._world.free(q[None], ways.grasping)[0]:
            return None, "collision at the grasp"
        approach, reason = self._approach(q, ways)
        if approach is None:
            return None, reason
        lift = self._lift(q, ways)
        if lift is None:
            return None, "lift"
        widths = (fit.opening_m, fit.release_m, fit.held_width_m)
        return Pick(ways.X_WG, *widths, approach, lift, ways.lifting), ""

    def _approach(self, q: Array, ways: _Ways) -> tuple[Array | None, str]:
        """Return (A, 7) from the furthest pregrasp that works to the grasp at `q`, or why none."""
        reason = ""
        for line in ways.approaches:
            back = follow(q, line)
            if back is None:
                reason = "IK of the approach"
                continue
            path = np.concatenate([back[::-1], q[None]])
            if self._world.free(path[:1], ways.before)[0] and self._world.path_free(
                path, ways.grasping
            ):
                return path, ""
            reason = "collision on the approach"
        return None, reason

    def _lifting(self, X_WG: Array, fit: FingerFit) -> Situation:
        return Situation(
            fit.held_width_m,
            p_GHeld=transform_points(invert_pose(X_WG), self._target.p_WObstacles),
            table_below_m=float(X_WG[2, 3]) + TABLE_LIFT_M,
            allowed=frozenset({AllowedContact.HELD_TABLE}),
        )

    def _lift(self, q: Array, ways: _Ways) -> Array | None:
        for line in ways.lifts:
            up = follow(q, line)
            if up is None or not self._world.free(up[-1:], ways.lifted)[0]:
                continue
            path = np.concatenate([q[None], up])
            if self._world.path_free(path, ways.lifting):
                return path
        return None


def balance(X_WGs: Array, target: PerceivedObject) -> Array:
    """Return (N,) factors in (0, 1]: which grasps (N, 4, 4) come from above and hold with ease.

    An object's weight turns it about the closing direction, which friction alone resists, with a
    lever of up to the distance of its centre of mass from that axis.
    """
    approach = 0.6 + 0.4 * np.clip(-X_WGs[:, 2, 2], 0.0, 1.0)
    lever = np.linalg.norm(np.cross(target.p_WCom - X_WGs[:, :3, 3], X_WGs[:, :3, 1]), axis=1)
    return np.asarray(approach * np.exp(-np.square(lever / 0.05)))


def firmness(fits: list[FingerFit]) -> Array:
    """Return (N,) factors in (0, 1]: which grasps pinch deeply and leave the fingers room.

    Where the stems of the fingers would meet the object before their pads do, the hand pushes and
    turns the object as it closes.
    """
    depth = np.array([fit.pinch_depth_m for fit in fits])
    room = np.array([fit.clearance_m for fit in fits])
    deep = 0.3 + 0.7 * np.clip(depth / 0.016, 0.0, 1.0)
    wide = 0.5 + 0.5 * np.clip(room / 0.006, 0.0, 1.0)
    stems = np.array([fit.stem_room_m for fit in fits])
    square = np.clip(stems / 0.003, 0.05, 1.0)
    return np.asarray(deep * wide * square)
