"""What a plan is like: how long, how smooth, how far from everything."""

from dataclasses import dataclass

import numpy as np
from pydrake.planning import RobotCollisionType, SceneGraphCollisionChecker

from planning.collision.distances import (
    arm_capsules,
    distance_to_box,
    distance_to_segments,
    hook_capsules,
)
from planning.collision.world import densified, static_checker
from planning.problem import SAMPLE_S, JointTrajectory, Plan, Segment, SegmentName
from split_drake.poses import Array, invert_pose, transform_points
from split_drake.robot.gripper import MAX_OPENING_M, PALM, finger_boxes
from split_drake.robot.kinematics import X_7G, link_poses
from split_drake.robot.panda import panda_positions
from split_drake.station.layout import Layout

# Clearance is looked at where the arm moves freely, at this step, and reported up to this distance.
FREE_SEGMENTS = (SegmentName.TRANSIT, SegmentName.TRANSFER)
STEP_RAD = 0.05
FARTHEST_M = 0.1


@dataclass(frozen=True)
class PlanMeasures:
    """Figures of a plan.

    Attributes:
        duration_s: of all segments, where nothing stops them.
        path_length_rad: sum over all segments of the Euclidean length in joint space.
        rms_jerk_rad_s3: root of the mean, over time and joints, of the squared jerk of the segments
            that move, from rest to rest; third differences of the sampled angles.
        clearance_m: least distance, during transits and transfers, of the robot and what it holds
            to table and hook, and of the robot to the object, that is to the points given of it.
            Often that of a segment's end.  `FARTHEST_M` where it is more.
    """

    duration_s: float
    path_length_rad: float
    rms_jerk_rad_s3: float
    clearance_m: float


class PlanMeter:
    """Measures plans for a layout.

    Args:
        layout: of the static station.
    """

    def __init__(self, layout: Layout) -> None:
        self._checker = static_checker(layout, hook_margin_m=0.0, table_margin_m=0.0)
        self._hook = hook_capsules(layout)
        self._table_z_m = layout.table_z_m

    def measure(self, plan: Plan, p_WPs: Array) -> PlanMeasures:
        """Return the figures of a plan for an object with surface points (N, 3) before the pick."""
        trajectories = [segment.trajectory for segment in plan.segments]
        return PlanMeasures(
            duration_s=sum(t.duration_s for t in trajectories),
            path_length_rad=sum(_length_rad(t.qs) for t in trajectories),
            rms_jerk_rad_s3=rms_jerk(trajectories),
            clearance_m=self._clearance(plan, p_WPs),
        )

    def _clearance(self, plan: Plan, p_WPs: Array) -> float:
        p_GPs = transform_points(invert_pose(plan.X_WGrasp), p_WPs)
        standing, least = p_WPs, FARTHEST_M
        for segment in plan.segments:
            if segment.holding:
                standing = transform_points(plan.X_WGplace, p_GPs)
            if segment.name in FREE_SEGMENTS:
                for q in densified(_sparse(segment.trajectory.qs), STEP_RAD):
                    points = p_GPs if segment.holding else standing
                    least = min(least, self._at(q, segment, points))
        return least

    def _at(self, q: Array, segment: Segment, points: Array) -> float:
        """Return the clearance at `q` (7,); `points` (N, 3) are in G where held, else in W."""
        opening_m = float(np.clip(segment.openings_m[0], 0.0, MAX_OPENING_M))
        least = self._static_clearance(q, opening_m)
        X_WLs = np.concatenate([np.eye(4)[None], link_poses(q[None])[0]])
        X_WG = X_WLs[7] @ X_7G
        if segment.holding:
            p_WPs = transform_points(X_WG, points)
            return min(least, self._held_clearance(p_WPs), _to_arm(X_WLs[:7], p_WPs))
        p_GPs = transform_points(invert_pose(X_WG), points)
        hand = min(distance_to_box(p_GPs, box).min() for box in (PALM, *finger_boxes(opening_m)))
        return float(min(least, hand, _to_arm(X_WLs, points)))

    def _static_clearance(self, q: Array, opening_m: float) -> float:
        """Return the distance of the robot to table and hook, at most `FARTHEST_M`."""
        return _static_clearance(self._checker, q, opening_m)

    def _held_clearance(self, p_WPs: Array) -> float:
        """Return the distance of held points (N, 3) to table and hook."""
        gaps = [distance_to_segments(p_WPs, *c.p_FEnds).min() - c.radius_m for c in self._hook]
        return float(min(*gaps, p_WPs[:, 2].min() - self._table_z_m))


def measure_motion(
    checker: SceneGraphCollisionChecker, trajectory: JointTrajectory, opening_m: float
) -> PlanMeasures:
    """Return the figures of one free motion, its clearance being the robot's in a checker's world.

    Args:
        checker: of the robot against what stands around it.
        trajectory: of the motion.
        opening_m: distance between the pads.
    """
    dense = densified(_sparse(trajectory.qs), STEP_RAD)
    return PlanMeasures(
        duration_s=trajectory.duration_s,
        path_length_rad=_length_rad(trajectory.qs),
        rms_jerk_rad_s3=rms_jerk([trajectory]),
        clearance_m=min(_static_clearance(checker, q, opening_m) for q in dense),
    )


def _static_clearance(checker: SceneGraphCollisionChecker, q: Array, opening_m: float) -> float:
    """Return the distance of the robot to a checker's world, at most `FARTHEST_M`."""
    found = checker.CalcRobotClearance(panda_positions(q, opening_m), FARTHEST_M)
    types = np.array(found.collision_types(), dtype=object)
    outside = types == RobotCollisionType.kEnvironmentCollision
    return float(np.min(found.distances()[outside], initial=FARTHEST_M))


def rms_jerk(trajectories: list[JointTrajectory]) -> float:
    """Return the root mean square jerk in rad/s^3 of those trajectories that move.

    They are sampled every `SAMPLE_S`.
    """
    moving = (t.qs for t in trajectories if np.ptp(t.qs, axis=0).max() > 0.0)
    squares = [np.square(_jerks(qs)).ravel() for qs in moving]
    return float(np.sqrt(np.concatenate(squares).mean())) if squares else 0.0


def _jerks(qs: Array) -> Array:
    """Return (T + 1, 7) jerks in rad/s^3 of angles (T, 7), with rest before and after them."""
    resting = np.pad(qs, ((2, 2), (0, 0)), mode="edge")
    return np.diff(resting, n=3, axis=0) / SAMPLE_S**3


def _length_rad(qs: Array) -> float:
    return float(np.linalg.norm(np.diff(qs, axis=0), axis=1).sum())


def _sparse(qs: Array) -> Array:
    """Return every fifth point of a path (N, 7), and its last."""
    return np.concatenate([qs[:-1:5], qs[-1:]])


def _to_arm(X_WLs: Array, p_WPs: Array) -> float:
    """Return the distance of points (N, 3) to the links 0, 1, ... with poses (L, 4, 4)."""
    return float(
        min(
            distance_to_segments(p_WPs, *transform_points(X_WLs[link], capsule.p_FEnds)).min()
            - capsule.radius_m
            for link, capsule in arm_capsules()
            if link < len(X_WLs)
        )
    )
