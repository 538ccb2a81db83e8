"""Out of an object that was let go and caught the hand: along what holds it, not against it.

An object swings where the hand lets go of it, and may come to lean on a finger inside it.  The
finger then pulls it along, unless the hand slides along the surface that it feels.
"""

from dataclasses import dataclass

import numpy as np

from planning.collision.exemptions import clear_of_palm
from planning.collision.world import CollisionWorld, Situation
from planning.execution.executor import ExecutionResult, Executor
from planning.geometry.waypoints import APPROACH_M, LINE_STEP_M, shifted, straight_line
from planning.motion.ik import follow
from planning.motion.segment_builder import SegmentBuilder
from planning.motion.timing import RETREATING
from planning.problem import Segment, SegmentName
from planning.subgoal import AllowedContact
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import gripper_force, gripper_pose

# The way out leads off the surface that was felt by this angle, and no further than so from the
# approach; less and more of that lean is tried where the arm cannot follow or hits something.
EXTRA_RAD = np.radians(15.0)
MAX_LEAN_RAD = np.radians(60.0)
SHARES = np.array([1.0, 0.5, 1.25])
# With less of the force than that across the approach, there is no telling which way to lean.
MIN_SIDEWAYS_N = 4.0
# Friction adds to what is felt against the motion: this share of it is taken to be the surface's.
NORMAL_SHARE = 0.6

_TOUCHING = frozenset({AllowedContact.FINGERS_TARGET})


@dataclass(frozen=True)
class WayOut:
    """Leads an open hand out of an object that it is caught on.

    Attributes:
        executor: of the segments.
        world: that the arm moves in.
    """

    executor: Executor
    world: CollisionWorld

    def take(self, p_WReleased: Array, tries: int) -> ExecutionResult | None:
        """Move out as often as it takes; return how, or None where no way is free.

        Args:
            p_WReleased: (N, 3) points of the object where it was let go.
            tries: after which the hand stays where it is; at least 1.
        """
        done: ExecutionResult | None = None
        for _ in range(tries):
            segment = self._segment(p_WReleased)
            if segment is None:
                break
            found = self.executor.execute([segment])
            logs = found.logs if done is None else done.logs + found.logs
            done = ExecutionResult(found.completed, logs, found.stage, found.reason, found.fault)
            if done.completed:
                break
        return done

    def _segment(self, p_WReleased: Array) -> Segment | None:
        """Return a straight way along the surface that is felt now, or None."""
        robot = self.executor.robot
        opening_m = float(np.clip(robot.opening_m, 0.0, MAX_OPENING_M))
        q = robot.q
        X_WG = gripper_pose(q)
        p_WOff = p_WReleased[clear_of_palm(X_WG, p_WReleased)]
        situation = Situation(opening_m, p_WStanding=p_WOff, allowed=_TOUCHING)
        for direction_W in ways_out(X_WG, -gripper_force(q, robot.joint_torques_nm)):
            end = shifted(X_WG, APPROACH_M * direction_W)
            path = follow(q, straight_line(X_WG, end, LINE_STEP_M))
            # It is free from its first centimetre on: what catches the hand is where it starts.
            if path is not None and self.world.path_free(path, situation):
                qs = np.vstack([q, path])
                return SegmentBuilder(self.world).empty(
                    SegmentName.RETREAT, qs, RETREATING, situation
                )
        return None


def ways_out(X_WG: Array, f_W: Array) -> Array:
    """Return unit directions (D, 3) in W out of an object, best first.

    Back along the approach, leaning away from the surface that pushes the hand: by what it takes to
    slide along that surface and then some, within bounds.  Straight back alone where hardly any of
    the force is across the approach.

    Args:
        X_WG: (4, 4) gripper.
        f_W: (3,) force on the gripper, N.
    """
    back = -X_WG[:3, 2]
    along = float(f_W @ back)
    aside = f_W - along * back
    sideways = float(np.linalg.norm(aside))
    if sideways < MIN_SIDEWAYS_N:
        return back[None]
    surface_rad = np.arctan2(NORMAL_SHARE * max(0.0, -along), sideways)
    leans = SHARES[:, None] * min(surface_rad + EXTRA_RAD, MAX_LEAN_RAD)
    return np.asarray(np.cos(leans) * back + np.sin(leans) * aside / sideways)
