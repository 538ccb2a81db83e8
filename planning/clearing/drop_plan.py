"""What a planner of drops is given, and what it returns."""

from dataclasses import dataclass, field

import numpy as np

from planning.problem import Segment
from split_drake.pose_set import PoseSet
from split_drake.poses import Array
from split_drake.station.layout import Layout, OpenBin


@dataclass(frozen=True)
class DropProblem:
    """A table to take something from, whatever it is.

    Attributes:
        grasps: detected; they are tried in the order of `order`.
        p_WPs: (N, 3) perceived cloud of all that lies there, metres in W.
        q_start: (7,) joint angles at the start, rad.
        layout: of the static station, with a bin.
        order: indices of the grasps that may be tried, the first first; all, best first, where
            none are given.

    Raises ValueError where the layout has no bin, the cloud is empty, or q_start is no arm's.
    """

    grasps: PoseSet
    p_WPs: Array
    q_start: Array
    layout: Layout
    order: tuple[int, ...] = field(default=())

    def __post_init__(self) -> None:
        if self.layout.bin is None:
            raise ValueError("the layout has no bin; expected one to drop things into")
        if not len(self.p_WPs):
            raise ValueError("the perceived cloud is empty; expected points of what lies there")
        if np.shape(self.q_start) != (7,):
            raise ValueError(f"q_start has shape {np.shape(self.q_start)}; expected (7,)")

    @property
    def bin(self) -> OpenBin:
        """The layout's bin."""
        assert self.layout.bin is not None  # checked above
        return self.layout.bin

    @property
    def tried_order(self) -> tuple[int, ...]:
        """The indices of the grasps, in the order in which they are tried."""
        return self.order or tuple(range(len(self.grasps)))


@dataclass(frozen=True)
class DropPlan:
    """One object taken, and let go above the bin.

    The segments are TRANSIT, APPROACH until the hand feels something or is there, CLOSE, LIFT,
    TRANSFER to above the bin, OPEN, and TRANSIT home; each starts where the last one ends.

    Attributes:
        grasp: index of the grasp in the problem's set.
        X_WG: (4, 4) the gripper's pose where it closes: the grasp, or turned by half a turn.
        segments: in order of execution.
    """

    grasp: int
    X_WG: Array
    segments: tuple[Segment, ...]
