"""A motion problem: from a configuration to a pose of the gripper, among boxes and cylinders."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from planning.collision.world import CollisionWorld
from split_drake.bad_input import BadInputError
from split_drake.objects.rigid import Primitive
from split_drake.poses import Array, make_pose
from split_drake.scene import Workspace
from split_drake.station.layout import Layout

# Where the station's own table and hook are out of the arm's reach.
_TABLE_Z_M = -0.6
_X_WKAway = make_pose(p=(-3.0, 0.0, 0.0))


@dataclass(frozen=True)
class MotionProblem:
    """What a motion leads from, to and past.

    Attributes:
        name: of the problem.
        q_start: (7,) joint angles, rad.
        X_WGoal: (4, 4) pose of the gripper G at the goal.
        q_goals: (M, 7) configurations known to reach it; M = 0 where none are known.
        solids: {name: box or cylinder}, its pose in W; what stands in the way.
        held: {name: box or cylinder}, its pose in G; what is in the hand.

    Raises BadInputError where a solid is neither a box nor a cylinder.
    """

    name: str
    q_start: Array
    X_WGoal: Array
    q_goals: Array = field(default_factory=lambda: np.empty((0, 7)))
    solids: Mapping[str, Primitive] = field(default_factory=dict)
    held: Mapping[str, Primitive] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, solid in {**self.solids, **self.held}.items():
            if solid.kind not in ("box", "cylinder"):
                raise BadInputError(f"{name} is a {solid.kind}; expected a box or a cylinder")

    def world(self) -> CollisionWorld:
        """Return the world that its motions are free in: the arm and its solids, nothing else."""
        workspace = replace(Workspace(), p_WCenter=(0.5, 0.0, _TABLE_Z_M))
        layout = Layout(workspace=workspace, X_WK=_X_WKAway)
        return CollisionWorld(layout, tuple(self.solids.values()))
