"""Ways back after a failure: out of an insertion, down with the object, and home."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from planning.collision.world import CollisionWorld, Situation
from planning.execution.executor import ExecutionResult, Executor
from planning.execution.faults import Fault
from planning.geometry.perceived import OBSTACLE_VOXEL_M, voxel_centroids
from planning.handling.held_view import beside_robot
from planning.handling.way_out import WayOut
from planning.motion.free import MotionQuery, NoMotion, free_motion
from planning.motion.segment_builder import SegmentBuilder, opening_segment
from planning.motion.timing import FEELING, FREE, LOADED, RETREATING, Speed, time_path
from planning.problem import SAMPLE_S, JointTrajectory, Plan, Segment, SegmentName
from planning.subgoal import AllowedContact
from split_drake.poses import Array
from split_drake.robot.gripper import MAX_OPENING_M
from split_drake.robot.kinematics import gripper_pose
from split_drake.station.layout import Layout

# Paths are driven back through points this many samples apart.
RETRACE_STRIDE = 5


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
        workspace = self._layout.workspace
        seen = beside_robot(robot.capture(), robot.q, opening_m, workspace.lowest_z_m)
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


def retraced(segments: Sequence[Segment], execution: ExecutionResult) -> tuple[Segment, ...]:
    """Return the segments of a loaded arm that lead back over what was executed, last first.

    An object that slips on the way is carried on: only its loss ends them.
    """
    executed = zip(segments, execution.logs, strict=False)
    return tuple(
        replace(
            segment,
            name=SegmentName.BACK_OUT,
            trajectory=_reversed_path(segment, log.duration_s, LOADED),
            stop_on_contact=False,
        )
        for segment, log in reversed(list(executed))
    )


def withdrawal(segments: Sequence[Segment], execution: ExecutionResult) -> tuple[Segment, ...]:
    """Return the segments of an empty hand back to the last approach's or insertion's start."""
    way: list[Segment] = []
    for segment, log in reversed(list(zip(segments, execution.logs, strict=False))):
        if segment.name is SegmentName.CLOSE:
            continue
        if segment.name not in (SegmentName.APPROACH, SegmentName.INSERT):
            break
        way.append(
            Segment(
                name=SegmentName.RETREAT,
                trajectory=_reversed_path(segment, log.duration_s, RETREATING),
                opening_start_m=0.0,
                opening_end_m=0.0,
                force_n=segment.force_n,
                holding=False,
                allowed_contacts=frozenset({AllowedContact.FINGERS_TARGET}),
            )
        )
    return tuple(way)


def put_down_segments(plan: Plan) -> tuple[Segment, ...]:
    """Return the segments that undo the plan's lift and approach.

    All the way down by feel: an object that turned in the hand may hang lower than it lay.
    """
    by_name = {segment.name: segment for segment in plan.pick}
    lift, approach = by_name[SegmentName.LIFT], by_name[SegmentName.APPROACH]
    qs = lift.trajectory.qs[::-1]
    touching = frozenset({AllowedContact.FINGERS_TARGET, AllowedContact.HELD_TABLE})
    felt = replace(
        lift,
        name=SegmentName.INSERT,
        trajectory=time_path(_thinned(qs), FEELING),
        stop_on_contact=True,
    )
    back = replace(
        approach,
        name=SegmentName.RETREAT,
        trajectory=_reversed_path(approach, approach.trajectory.duration_s + SAMPLE_S, RETREATING),
    )
    release_m = approach.opening_end_m
    return (felt, opening_segment(qs[-1], release_m, lift.held_width_m, touching), back)


def _drawn_back_m(segments: Sequence[Segment], execution: ExecutionResult) -> float:
    """Return how far the hand got along its approach in the last segment that was executed."""
    log = execution.logs[-1]
    qs = segments[len(execution.logs) - 1].trajectory.qs
    X_WStart, X_WEnd = gripper_pose(qs[0]), gripper_pose(qs[round(log.duration_s / SAMPLE_S) - 1])
    return float((X_WStart[:3, 3] - X_WEnd[:3, 3]) @ X_WStart[:3, 2])


def _reversed_path(segment: Segment, duration_s: float, speed: Speed) -> JointTrajectory:
    """Return the way back over the first `duration_s` of a segment."""
    count = max(2, round(duration_s / SAMPLE_S))
    return time_path(_thinned(segment.trajectory.qs[:count][::-1]), speed)


def _thinned(qs: Array) -> Array:
    """Return every few points of a path (N, 7), its ends among them."""
    kept = np.arange(0, len(qs), RETRACE_STRIDE)
    return qs[kept] if kept[-1] == len(qs) - 1 else qs[np.append(kept, len(qs) - 1)]
