"""Ways back after a failure: out of an insertion, down with the object, and home."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from planning.collision.world import CollisionWorld, Situation
from planning.execution.executor import ExecutionResult, Executor
from planning.execution.faults import Fault
from planning.geometry.perceived import OBSTACLE_VOXEL_M, voxel_centroids
from planning.handling.held_view import beside_robot
from planning.handling.lowering import Lowering
from planning.handling.retracing import put_down_segments, retraced, withdrawal
from planning.handling.way_out import WayOut
from planning.motion.free import MotionQuery, NoMotion, free_motion
from planning.motion.segment_builder import SegmentBuilder
from planning.motion.timing import FREE
from planning.problem import SAMPLE_S, Plan, Segment, SegmentName
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import gripper_pose
from split_drake.sensing.table_noise import above_table_noise
from split_drake.station.layout import Layout


class Recovery:
    """Leads the robot back after a failure, by what it did before and by what it sees now.

    Args:
        executor: of the segments.
        layout: of the static station.
        ways_out: that are tried where the hand is caught on the object; none if 0.
    """

    def __init__(self, executor: Executor, layout: Layout, ways_out: int) -> None:
        self._executor = executor
        self._layout = layout
        self._ways_out = ways_out

    def lower_on(self, lowering: Segment) -> ExecutionResult:
        """Lower the held object on from a segment's end, until something is felt."""
        return Lowering(self._executor, self._world).go_on(lowering)

    def back_out(self, segments: Sequence[Segment], execution: ExecutionResult) -> ExecutionResult:
        """Carry the object back along the segments as far as they were executed."""
        return self._executor.execute(retraced(segments, execution))

    def put_down(self, plan: Plan) -> bool:
        """Put the lifted object down where the plan took it, by feel, and draw back.

        Return whether the hand is free of it.
        """
        segments = put_down_segments(plan)
        return self.eased_out(segments, self._executor.execute(segments)).completed

    def withdraw(self, segments: Sequence[Segment], execution: ExecutionResult) -> bool:
        """Draw the empty hand back from where it closed on an object, or from the hook.

        Return whether the hand is free of the object.
        """
        way = withdrawal(segments, execution)
        return self.eased_out(way, self._executor.execute(way)).completed

    def eased_out(self, segments: Sequence[Segment], execution: ExecutionResult) -> ExecutionResult:
        """Return how an execution of segments ended, after leading the hand out if it was caught.

        Its logs are followed by those of the ways out.
        """
        if execution.fault is not Fault.CAUGHT:
            return execution
        out = WayOut(self._executor, self._world)
        return out.take(execution, _drawn_back_m(segments, execution), self._ways_out)

    def go_home(self, rng: np.random.Generator) -> bool:
        """Move home around what the cameras show in the workspace; return whether there is a way.

        The hand is expected to be empty.
        """
        robot = self._executor.robot
        opening_m = float(np.clip(robot.opening_m, 0.0, MAX_OPENING_M))
        views = robot.capture()
        workspace = above_table_noise(self._layout.workspace, views)
        seen = beside_robot(views, robot.q, opening_m, workspace.lowest_z_m)
        seen = seen[workspace.contains(seen)]
        obstacles = voxel_centroids(seen, OBSTACLE_VOXEL_M) if len(seen) else None
        situation = Situation(opening_m, p_WStanding=obstacles)
        q_home = self._world.layout.q_home
        path = free_motion(MotionQuery(self._world, robot.q, q_home, situation), rng)
        if isinstance(path, NoMotion):
            return False
        segment = SegmentBuilder(self._world).empty(SegmentName.TRANSIT, path, FREE, situation)
        return self._executor.execute([segment]).completed

    @cached_property
    def _world(self) -> CollisionWorld:
        return CollisionWorld(self._layout)


def _drawn_back_m(segments: Sequence[Segment], execution: ExecutionResult) -> float:
    """Return how far the hand got along its approach in the last segment that was executed."""
    log = execution.logs[-1]
    qs = segments[len(execution.logs) - 1].trajectory.qs
    X_WStart, X_WEnd = gripper_pose(qs[0]), gripper_pose(qs[round(log.duration_s / SAMPLE_S) - 1])
    return float((X_WStart[:3, 3] - X_WEnd[:3, 3]) @ X_WStart[:3, 2])
