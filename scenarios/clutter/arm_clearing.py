"""Clearing a table with the station's arm: plans, their execution, and a bin beside the table."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planning.clearing.drop_plan import DropPlan, DropProblem
from planning.clearing.drop_planner import DropPlanner
from planning.execution.executor import ExecutionResult, Executor
from planning.execution.faults import Fault
from planning.geometry.modes import away_from
from planning.handling.recovery import Recovery
from planning.problem import PlanFailure, SegmentName
from scenarios.clutter.clearing import names_of
from scenarios.clutter.observation import side_camera
from scenarios.clutter.records import GraspRecord
from split_drake.camera import DepthView
from split_drake.objects.rigid import RigidObject
from split_drake.pose_set import PoseSet
from split_drake.pose_task import GRASP
from split_drake.poses import Array, make_pose, rotation_x, rotation_z
from split_drake.scene import Scene
from split_drake.station.layout import Layout, OpenBin
from split_drake.station.station import Station
from split_drake.truth.binning import sort_out
from split_drake.truth.state import Truth

# The hook stands on the other side of the table than the camera, so high above its top.
_R_WK, _P_WK, _HOOK_HEIGHT_M = rotation_z(np.pi) @ rotation_x(np.radians(10.0)), (0.5, 0.38), 0.40


class LostArmError(RuntimeError):
    """The arm finds no way home, so that nothing more can be tried."""


def arm_layout(layout: Layout) -> Layout:
    """Return a layout with a bin beside the table, and one camera, that of clutter removal."""
    camera = side_camera(layout.workspace)
    X_WK = make_pose(_R_WK, (*_P_WK, layout.table_z_m + _HOOK_HEIGHT_M))
    bin_there = OpenBin.level_with(layout.table_z_m)
    return replace(layout, cameras=(camera,), X_WK=X_WK, bin=bin_there)


class ArmClearing:
    """The station's arm, which tries grasps that it can plan, and drops what it took into the bin.

    Args:
        station: with a bin, one camera, and objects that bear on points.
        planner: of the drops.
        rng: what the planner draws from.
    """

    def __init__(self, station: Station, planner: DropPlanner, rng: np.random.Generator) -> None:
        self._station = station
        self._planner = planner
        self._rng = rng
        self._executor = Executor(station)
        self._recovery = Recovery(self._executor, station.config.layout, ways_out=0)
        self._binned: set[int] = set()
        self._plan: DropPlan | None = None
        self._X_WGfailed: list[Array] = []
        self._stranded = ""
        self.truth = Truth(station)

    @property
    def objects(self) -> Sequence[RigidObject]:
        return self._station.objects

    @property
    def left(self) -> tuple[int, ...]:
        return tuple(index for index in self._station.present if index not in self._binned)

    @property
    def time_s(self) -> float:
        return self._station.time_s

    def look(self) -> DepthView:
        """Return what the camera sees now."""
        (view,) = self._station.capture()
        return view

    def choose(self, found: PoseSet, scene: Scene, order: Sequence[int]) -> int | str:
        """Return the first of the grasps that there is a plan with, or why there is none.

        Grasps like those that failed since one succeeded come last: what lies there is as it was.

        Raises LostArmError where the arm found no way home after the last one.
        """
        if self._stranded:
            raise LostArmError(self._stranded)
        X_WGfailed = np.reshape(self._X_WGfailed, (-1, 4, 4))
        fresh = away_from(found.X_WPs, X_WGfailed, GRASP.symmetry)
        tried = tuple(sorted(order, key=lambda index: not fresh[index]))
        layout = self._station.config.layout
        problem = DropProblem(found, scene.p_WPs, self._station.q, layout, tried)
        outcome = self._planner.plan(problem, self._rng)
        if isinstance(outcome, PlanFailure):
            return outcome.reason
        self._plan = outcome
        return outcome.grasp

    def take(self, found: PoseSet, chosen: int) -> GraspRecord:
        """Execute the plan, and see what came into the bin and what is lost."""
        plan = self._plan
        if plan is None or plan.grasp != chosen:
            raise ValueError(f"grasp {chosen} has no plan; expected one that was chosen before")
        done = self._carry_out(plan)
        removal = sort_out(self._station, self.truth, self._binned)
        self._binned.update(removal.taken)
        self._X_WGfailed = [] if removal.taken else [*self._X_WGfailed, plan.X_WG]
        reason = "" if removal.taken else done.reason or "nothing came into the bin"
        return GraspRecord(
            X_WG=plan.X_WG.tolist(),
            score=float(found.scores[chosen]),
            candidates=len(found),
            taken=names_of(self.objects, removal.taken),
            lost=names_of(self.objects, removal.lost),
            stopped_by=self._felt(done),
            reason=reason,
        )

    def _carry_out(self, plan: DropPlan) -> ExecutionResult:
        """Execute a plan, to the arm's being home again, where it finds a way."""
        done = self._executor.execute(plan.segments)
        if done.completed:
            return done
        if done.fault is Fault.SLIPPED:  # it is above the bin all the same
            self._executor.execute(plan.segments[len(done.logs) :])
            return done
        self._recovery.withdraw(plan.segments, done)
        if not self._recovery.go_home(self._rng):
            self._stranded = f"no way home was found after: {done.reason}"
        return done

    def _felt(self, done: ExecutionResult) -> tuple[str, ...]:
        """Return that something was felt on the way in: the arm does not know what."""
        approach = [log for log in done.logs if log.name is SegmentName.APPROACH]
        return ("something",) if any(log.stopped_by_contact for log in approach) else ()
