"""A made-up mug and its true pose sets, for tests of the planner that need no simulator."""

from functools import cache

import numpy as np

from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.motion.ik import solve_ik
from planning.pick_place.pick import Q_COMFORT
from planning.planner import make_planner
from planning.problem import Plan, PlanningProblem
from planning.subgoal import Subgoal
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT
from split_drake.poses import Array, make_pose, rotation_x, rotation_z, transform_points
from split_drake.robot.posture import Q_HOME
from split_drake.station.layout import Layout

RADIUS_M = 0.034
WALL_M = 0.004
HEIGHT_M = 0.090
HANDLE_RADIUS_M = 0.024
HANDLE_TUBE_M = 0.005
X_OH = make_pose(p=(RADIUS_M + 0.014, 0.0, HEIGHT_M / 2.0))

STANDING = make_pose(rotation_z(0.7), (0.5, 0.02, 0.0))
LYING = make_pose(rotation_z(2.0) @ rotation_x(np.pi / 2.0), (0.5, 0.04, RADIUS_M))


@cache
def mug_cloud() -> Array:
    """Return (N, 3) points on the mug's surface in O: wall inside and outside, base, handle."""
    angles, heights = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 90), np.linspace(0, HEIGHT_M, 30))
    walls = [_cylinder(r, angles.ravel(), heights.ravel()) for r in (RADIUS_M, RADIUS_M - WALL_M)]
    radii, around = np.meshgrid(np.linspace(0.0, RADIUS_M, 15), np.linspace(0, 2 * np.pi, 60))
    base = _cylinder(radii.ravel(), around.ravel(), np.zeros(radii.size))
    return np.concatenate([*walls, base, _handle()])


def _cylinder(radius: Array | float, angles: Array, heights: Array) -> Array:
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), heights])


def _handle() -> Array:
    arc, ring = np.meshgrid(np.linspace(-2.0, 2.0, 50), np.linspace(0.0, 2.0 * np.pi, 12))
    reach = HANDLE_RADIUS_M + HANDLE_TUBE_M * np.cos(ring)
    x = X_OH[0, 3] - 0.008 + reach * np.cos(arc)
    z = X_OH[2, 3] + reach * np.sin(arc)
    points = np.column_stack([x.ravel(), HANDLE_TUBE_M * np.sin(ring).ravel(), z.ravel()])
    return points[points[:, 0] > RADIUS_M]


def rim_grasps() -> Array:
    """Return X_OGs (N, 4, 4) that pinch the wall at the rim, from straight above and tilted."""
    grasps = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False):
        if min(angle, 2.0 * np.pi - angle) < 0.6:
            continue
        outward = np.array([np.cos(angle), np.sin(angle), 0.0])
        tangent = np.array([-np.sin(angle), np.cos(angle), 0.0])
        for tilt in (0.0, 0.7, -0.7, 1.3, -1.3):
            z = np.cos(tilt) * np.array([0.0, 0.0, -1.0]) + np.sin(tilt) * tangent
            R_OG = np.column_stack([np.cross(outward, z), outward, z])
            p_OG = outward * (RADIUS_M - WALL_M / 2.0) + np.array([0.0, 0.0, HEIGHT_M - 0.008])
            grasps.append(make_pose(R_OG, p_OG))
    return np.stack(grasps)


def body_grasps() -> Array:
    """Return X_OGs (N, 4, 4) that take the body from the side, across its diameter."""
    grasps = []
    for angle in np.linspace(0.7, 2.0 * np.pi - 0.7, 12):
        outward = np.array([np.cos(angle), np.sin(angle), 0.0])
        across = np.array([-np.sin(angle), np.cos(angle), 0.0])
        R_OG = np.column_stack([np.cross(across, -outward), across, -outward])
        for share in (0.55, 0.7):
            p_OG = 0.010 * outward + np.array([0.0, 0.0, share * HEIGHT_M])
            grasps.append(make_pose(R_OG, p_OG))
    return np.stack(grasps)


def mug_problem(subgoal: Subgoal, X_WO: Array) -> PlanningProblem:
    """Return the problem of a mug that stands or lies at X_WO, with its true pose sets."""
    X_WGs = X_WO @ np.concatenate([rim_grasps(), body_grasps()])
    X_WGs = X_WGs[X_WGs[:, 2, 2] < 0.2]
    X_WH = X_WO @ X_OH
    pose_sets = {
        "grasp": PoseSet(GRASP, X_WGs, np.ones(len(X_WGs))),
        "handle": PoseSet(HANDLE, np.stack([X_WH, X_WH @ HANDLE.symmetry.X_half_turn]), np.ones(2)),
        "upright": PoseSet(UPRIGHT, X_WO[None], np.ones(1)),
    }
    p_WPs = transform_points(X_WO, mug_cloud())
    return PlanningProblem(subgoal, pose_sets, p_WPs, Q_HOME, Layout())


def configuration(p_WG: tuple[float, float, float]) -> Array:
    """Return joint angles that point the gripper straight down at a place."""
    return solve_ik(make_pose(rotation_x(np.pi), p_WG)[None]).of(0, Q_COMFORT)[0]


@cache
def reorient_plan() -> Plan:
    """Return a plan that takes the standing mug and stands it up elsewhere."""
    return _plan_of(REORIENT)


@cache
def hang_plan() -> Plan:
    """Return a plan that takes the standing mug and hangs it."""
    return _plan_of(HANG)


def _plan_of(subgoal: Subgoal) -> Plan:
    problem = mug_problem(subgoal, STANDING)
    found = make_planner("default").plan(problem, np.random.default_rng(0))
    if not isinstance(found, Plan):
        raise RuntimeError(f"the made-up mug's problem has no plan: {found.reason}")
    return found
