"""Out of an object that was let go and caught the hand: where it has room, not against it.

An object swings where the hand lets go of it, and comes to lie otherwise than the hand's way back
leads.  A finger inside it then pulls it taut, and the harder the hand pulls the firmer it is held.
So the hand first moves in again as far as it had drawn back, which leaves the object as it hangs or
stands by itself; steps aside until it feels nothing; and then goes out on a way that leans off what
held it.  A way that is caught as well leans the next one further.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from planning.collision.world import CollisionWorld, Situation
from planning.execution.executor import ExecutionResult, Executor
from planning.geometry.waypoints import APPROACH_M, LINE_STEP_M, shifted, straight_line
from planning.motion.ik import follow
from planning.motion.segment_builder import SegmentBuilder
from planning.motion.timing import RETREATING, rest
from planning.problem import Segment, SegmentName
from planning.subgoal import AllowedContact
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import gripper_pose
from split_drake.robot.panda import gripper_force

# Each way leans off the surface that was felt on the one before by so much more.
LEAN_RAD = np.radians(20.0)
# Where the arm cannot follow that, or hits something, less of the lean is tried, and a shorter way:
# a finger reaches no deeper into an object than that.
SHARES = (1.0, 0.5, 0.0)
LENGTHS_M = (APPROACH_M, 0.75 * APPROACH_M)
# A hand that feels less than this across its approach, at rest, hardly touches anything.
FREE_FORCE_N = 0.7
ASIDE_STEP_M, ASIDE_STEPS = 0.003, 10
# An object that was moved swings for a while.
CALM_S = 0.4
# A way in again that is shorter than this is none.
LEAST_DEPTH_M = 0.002


@dataclass(frozen=True)
class WayOut:
    """Leads an open hand out of an object that it is caught on.

    Attributes:
        executor: of the segments.
        world: that the arm moves in.  The object itself is no obstacle: where it lies is not known
            any longer, and the hand stops where it meets it.
    """

    executor: Executor
    world: CollisionWorld

    def take(self, caught: ExecutionResult, depth_m: float, tries: int) -> ExecutionResult:
        """Move out as often as it takes; return how that ended, its logs after those of before.

        Args:
            caught: how the hand was caught.
            depth_m: by how far it had drawn back.
            tries: after which the hand stays where it is.
        """
        done, direction_W = caught, -self._X_WG[:3, 2]
        for _ in range(tries):
            direction_W = leaned(direction_W, self._force_W)
            done = _after(done, self._move(depth_m * self._X_WG[:3, 2]))
            done = _after(done, self._step_aside())
            start = self._X_WG
            segment = self._way(direction_W)
            if segment is None:
                return _caught_again(done, caught)
            done = _after(done, self.executor.execute([segment]))
            if done.completed:
                return done
            depth_m = float((start[:3, 3] - self._X_WG[:3, 3]) @ start[:3, 2])
        return _caught_again(done, caught)

    @property
    def _X_WG(self) -> Array:
        return gripper_pose(self.executor.robot.q)

    @property
    def _force_W(self) -> Array:
        """The force (3,) on the gripper, N."""
        robot = self.executor.robot
        return -gripper_force(robot.q, robot.joint_torques_nm)

    @property
    def _situation(self) -> Situation:
        opening_m = float(np.clip(self.executor.robot.opening_m, 0.0, MAX_OPENING_M))
        return Situation(opening_m, allowed=frozenset({AllowedContact.FINGERS_TARGET}))

    def _step_aside(self) -> ExecutionResult:
        """Move across the approach, away from what is felt, until hardly anything is."""
        done = ExecutionResult(True, ())
        for _ in range(ASIDE_STEPS):
            aside = _across(self._force_W, self._X_WG[:3, 2])
            force_n = float(np.linalg.norm(aside))
            if force_n < FREE_FORCE_N:
                break
            done = _after(done, self._move(ASIDE_STEP_M * aside / force_n))
        return done

    def _move(self, p_W: Array) -> ExecutionResult:
        """Move by (3,), if the way is free, and wait until all is calm."""
        if np.linalg.norm(p_W) < LEAST_DEPTH_M:
            return ExecutionResult(True, ())
        moved = self._line(p_W, SegmentName.EASE)
        if moved is None:
            return ExecutionResult(True, ())
        calm = replace(moved, trajectory=rest(moved.trajectory.qs[-1], CALM_S))
        return self.executor.execute([moved, calm])

    def _way(self, direction_W: Array) -> Segment | None:
        """Return the first way out that is free, or None."""
        for p_W in self._ways(direction_W):
            segment = self._line(p_W, SegmentName.RETREAT)
            if segment is not None:
                return segment
        return None

    def _ways(self, direction_W: Array) -> Iterator[Array]:
        back = -self._X_WG[:3, 2]
        for length_m in LENGTHS_M:
            for share in SHARES:
                blend = share * direction_W + (1.0 - share) * back
                yield length_m * blend / np.linalg.norm(blend)

    def _line(self, p_W: Array, name: SegmentName) -> Segment | None:
        """Return the segment that leads straight by (3,), or None where it is not free."""
        q, situation = self.executor.robot.q, self._situation
        X_WG = gripper_pose(q)
        path = follow(q, straight_line(X_WG, shifted(X_WG, p_W), LINE_STEP_M))
        if path is None or not self.world.path_free(path, situation):
            return None
        return SegmentBuilder(self.world).empty(name, np.vstack([q, path]), RETREATING, situation)


def leaned(direction_W: Array, f_W: Array) -> Array:
    """Return a unit direction (3,) of motion, leaned by `LEAN_RAD` to where the hand is pushed.

    Args:
        direction_W: (3,) unit vector.
        f_W: (3,) force on the gripper, N; one along the direction leaves that as it is.
    """
    aside = _across(f_W, direction_W)
    force_n = float(np.linalg.norm(aside))
    if force_n < FREE_FORCE_N:
        return direction_W
    return np.asarray(np.cos(LEAN_RAD) * direction_W + np.sin(LEAN_RAD) * aside / force_n)


def _across(f_W: Array, axis_W: Array) -> Array:
    """Return what of a force (3,) is across a unit axis (3,)."""
    return np.asarray(f_W - (f_W @ axis_W) * axis_W)


def _after(done: ExecutionResult, then: ExecutionResult) -> ExecutionResult:
    """Return how an execution ended that followed another one."""
    return replace(then, logs=done.logs + then.logs)


def _caught_again(done: ExecutionResult, caught: ExecutionResult) -> ExecutionResult:
    """Return the failure of before, after all that was done since."""
    return replace(caught, logs=done.logs)
