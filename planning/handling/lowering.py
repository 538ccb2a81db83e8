"""Further down with what is to be let go, where nothing was felt on the planned way.

A plan lowers an object by feel as far as its handle has room for sure.  What hangs or stands is
felt a little lower at the latest.  What is not felt there either has been missed: it turned in the
hand on the way, and would fall.
"""

from dataclasses import dataclass

import numpy as np

from planning.collision.world import CollisionWorld, Situation
from planning.execution.executor import ExecutionResult, Executor
from planning.execution.faults import Fault
from planning.geometry.waypoints import LINE_STEP_M, shifted, straight_line
from planning.handling.retracing import retraced
from planning.motion.ik import follow
from planning.motion.segment_builder import SegmentBuilder
from planning.motion.timing import FEELING
from planning.problem import Segment, SegmentName, Stage
from split_drake.robot.kinematics import gripper_pose

# Beyond the planned lowering, of 15 mm on a hook.  A handle's outer edge is 20 mm from the middle
# of its opening (median), 33 mm at most of 280 mugs; the peg's radius of 6 mm comes off that.
FURTHER_M = 0.02


@dataclass(frozen=True)
class Lowering:
    """Lowers a held object on.

    Attributes:
        executor: of the segments.
        world: that the arm moves in; what is held may touch what it is lowered onto.
    """

    executor: Executor
    world: CollisionWorld

    def go_on(self, lowering: Segment) -> ExecutionResult:
        """Lower on from the end of a segment in which nothing was felt, until something is.

        Where nothing is, or the object slips or is lost, the arm moves up again, and the fault says
        so.  Where it can move no lower, nothing is known, and nothing done.
        """
        segment = self._segment(lowering.held_width_m)
        if segment is None:
            return ExecutionResult(True, ())
        done = self.executor.execute([segment])
        if done.completed and done.logs[-1].stopped_by_contact:
            return done
        # What follows a failure starts from the end of the planned way.
        self.executor.execute(retraced([segment], done))
        if not done.completed:
            return done
        reason = f"nothing was felt on the way down, nor {1e3 * FURTHER_M:.0f} mm below its end"
        return ExecutionResult(False, done.logs, Stage.PLACEMENT, reason, Fault.MISSED)

    def _segment(self, held_width_m: float) -> Segment | None:
        q = self.executor.robot.q
        X_WG, situation = gripper_pose(q), Situation(held_width_m)
        line = straight_line(X_WG, shifted(X_WG, (0.0, 0.0, -FURTHER_M)), LINE_STEP_M / 2.0)
        path = follow(q, line)
        if path is None or not self.world.path_free(path, situation):
            return None
        qs = np.vstack([q, path])
        return SegmentBuilder(self.world).loaded(
            SegmentName.INSERT, qs, FEELING, situation, feel=True
        )
