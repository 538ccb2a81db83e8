"""Segments that lead back over what was executed: with the object, without it, and down with it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planning.execution.executor import ExecutionResult
from planning.motion.segment_builder import opening_segment
from planning.motion.timing import FEELING, LOADED, RETREATING, Speed, time_path
from planning.problem import SAMPLE_S, JointTrajectory, Plan, Segment, SegmentName
from planning.subgoal import AllowedContact
from split_drake.poses import Array

# Paths are driven back through points this many samples apart.
RETRACE_STRIDE = 5


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
        name=SegmentName.BACK_OUT,
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


def _reversed_path(segment: Segment, duration_s: float, speed: Speed) -> JointTrajectory:
    """Return the way back over the first `duration_s` of a segment."""
    count = max(2, round(duration_s / SAMPLE_S))
    return time_path(_thinned(segment.trajectory.qs[:count][::-1]), speed)


def _thinned(qs: Array) -> Array:
    """Return every few points of a path (N, 7), its ends among them."""
    kept = np.arange(0, len(qs), RETRACE_STRIDE)
    return qs[kept] if kept[-1] == len(qs) - 1 else qs[np.append(kept, len(qs) - 1)]
