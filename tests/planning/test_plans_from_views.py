"""Plans made from what two cameras show of real mug shapes pass the independent check.

The object is known to the planner and to the check as its perceived cloud; poses are the true ones.
"""

from functools import cache

import numpy as np
import pytest

from planning.checking.trajectory_check import TrajectoryChecker
from planning.geometry.perceived import voxel_centroids
from planning.goals.hang import SUBGOAL as HANG
from planning.goals.upright import SUBGOAL as REORIENT
from planning.planner import make_planner
from planning.problem import Plan, PlanningProblem
from planning.subgoal import Subgoal
from split_drake.data.render import DepthRenderer
from split_drake.grasps.judge import feasible
from split_drake.grasps.sampling import sample_grasps
from split_drake.objects.mugs.split import load_mug
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP, HANDLE, UPRIGHT
from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from split_drake.robot.posture import Q_HOME
from split_drake.scene import Scene
from split_drake.station.layout import Layout

MUGS = ("test_000", "test_001")
LAYOUT = Layout()


def pose_on_table(mug: str, subgoal: Subgoal) -> Array:
    """Return X_WO of a mug that stands, or that lies where it shall be reoriented."""
    R_WO = rotation_z(1.0)
    if subgoal == REORIENT:
        R_WO = rotation_z(2.0) @ rotation_x(np.pi / 2.0)
    vertices = load_mug(mug).body.mesh.vertices @ R_WO.T
    return make_pose(R_WO, (0.5, 0.02, -vertices[:, 2].min()))


@cache
def problem(mug: str, subgoal: Subgoal) -> PlanningProblem:
    """Return the problem that the paper's two views of a mug and its true poses pose."""
    shape, X_WO = load_mug(mug), pose_on_table(mug, subgoal)
    renderer = DepthRenderer(shape.body.mesh)
    views = [renderer.render(X_WO, camera) for camera in LAYOUT.cameras]
    labels = sample_grasps(shape.body, np.random.default_rng(0))
    kept = feasible(X_WO, labels.X_OGs, labels.openings_m, 0.0)
    handles = shape.true_poses(HANDLE, X_WO)
    pose_sets = {
        "grasp": PoseSet.ranked(GRASP, X_WO @ labels.X_OGs[kept], labels.qualities[kept]),
        "handle": PoseSet(HANDLE, handles, np.ones(len(handles))),
        "upright": PoseSet(UPRIGHT, X_WO[None], np.ones(1)),
    }
    scene = Scene.from_views(views, LAYOUT.workspace)
    return PlanningProblem(subgoal, pose_sets, scene.p_WPs, Q_HOME, LAYOUT)


@pytest.mark.parametrize("subgoal", [HANG, REORIENT], ids=str)
@pytest.mark.parametrize("mug", MUGS)
def test_plans_from_rendered_views_pass_the_independent_check(mug: str, subgoal: Subgoal) -> None:
    posed = problem(mug, subgoal)
    plan = make_planner("default").plan(posed, np.random.default_rng(0))
    assert isinstance(plan, Plan), plan
    seen = voxel_centroids(posed.p_WPs, 0.012)
    assert TrajectoryChecker(LAYOUT).violations(plan, seen) == []
