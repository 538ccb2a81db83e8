"""The free motions of pick and place as motion problems, for planners of other projects."""

from collections.abc import Iterator, Mapping

import numpy as np

from planning.planner import make_planner
from planning.problem import Plan, PlanningProblem, Segment, SegmentName
from scenarios.bench.motions.problem import MotionProblem
from split_drake.objects.rigid import Primitive
from split_drake.poses import Array, invert_pose, make_pose, transform_points
from split_drake.robot.kinematics import gripper_pose
from split_drake.station.fixtures import bin_primitives, hook_primitives, table_primitive
from split_drake.station.layout import Layout

# A cloud becomes cubes of this size.
CUBE_M = 0.02


def exported(
    problems: Mapping[str, PlanningProblem], seed: int
) -> tuple[dict[str, list[MotionProblem]], int]:
    """Return {transit or transfer: its motions}, and how many problems have none.

    A motion leads as that of the default planner's plan does: from where the robot starts to where
    it approaches, and with the object in the hand from there to where it is inserted.  A problem
    that the planner solves not has none.

    Args:
        problems: {name: problem}.
        seed: of the planner, with the problem's number.
    """
    planner = make_planner("default")
    found: dict[str, list[MotionProblem]] = {
        name.value: [] for name in (SegmentName.TRANSIT, SegmentName.TRANSFER)
    }
    unsolved = 0
    for number, (name, problem) in enumerate(problems.items()):
        plan = planner.plan(problem, np.random.default_rng((seed, number)))
        if not isinstance(plan, Plan):
            unsolved += 1
            continue
        for segment in _free_segments(plan):
            found[segment.name.value].append(_motion(name, problem, plan, segment))
    return found, unsolved


def _free_segments(plan: Plan) -> Iterator[Segment]:
    """Yield the first transit and the transfer of a plan, those of both that it has."""
    for name in (SegmentName.TRANSIT, SegmentName.TRANSFER):
        yield from [segment for segment in plan.pick + plan.place if segment.name is name][:1]


def _motion(name: str, problem: PlanningProblem, plan: Plan, segment: Segment) -> MotionProblem:
    qs = segment.trajectory.qs
    solids = {**static_solids(problem.layout), **cubes(problem.p_WObstacles, "other")}
    held: dict[str, Primitive] = {}
    if segment.holding:
        X_GW = invert_pose(plan.X_WGrasp)
        held = cubes(transform_points(X_GW, problem.p_WPs), "held")
    else:
        solids |= cubes(problem.p_WPs, "object")
    return MotionProblem(name, qs[0], gripper_pose(qs[-1]), qs[-1:], solids, held)


def static_solids(layout: Layout) -> dict[str, Primitive]:
    """Return {name: solid} of a station's table, hook and bin, their poses in W."""
    hook = [
        Primitive(each.kind, each.size, layout.X_WK @ each.X_OP) for each in hook_primitives(layout)
    ]
    parts = {"table": [table_primitive(layout)], "hook": hook, "bin": bin_primitives(layout)}
    return {
        f"{name}_{number}": _plain(solid)
        for name, solids in parts.items()
        for number, solid in enumerate(solids)
    }


def cubes(points: Array, name: str) -> dict[str, Primitive]:
    """Return cubes of `CUBE_M` that hold all points (N, 3), by names, in the points' frame."""
    cells = np.unique(np.floor(np.reshape(points, (-1, 3)) / CUBE_M).astype(int), axis=0)
    size = (CUBE_M, CUBE_M, CUBE_M)
    return {
        f"{name}_{number}": Primitive("box", size, make_pose(p=(cell + 0.5) * CUBE_M))
        for number, cell in enumerate(cells)
    }


def _plain(solid: Primitive) -> Primitive:
    """Return a solid as a box or cylinder: a capsule as the cylinder around it."""
    if solid.kind != "capsule":
        return solid
    radius_m, length_m = solid.size
    return Primitive("cylinder", (radius_m, length_m + 2.0 * radius_m), solid.X_OP)
