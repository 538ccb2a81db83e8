"""Pose tasks: what the poses of a set are for, as values.

A task is a name, what a pose's frame means, and which poses mean the same.  Objects, datasets,
checkpoints and pose-set files carry their tasks; a new one needs no code in this package.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from split_drake.bad_input import BadInputError
from split_drake.poses import Array, make_pose, rotation_error_rad

Axis = Literal["x", "y", "z"]
SymmetryKind = Literal["none", "half turn", "any turn"]

_NAME = re.compile(r"[a-z][a-z0-9_]*")


class UnknownTaskError(BadInputError):
    """A task was asked for that is not among those known."""


@dataclass(frozen=True)
class Symmetry:
    """Which poses of a task mean the same: X and X turned about an axis of its own frame.

    Attributes:
        kind: no other pose, that after a half turn, or that after any turn.
        axis: of the frame that is turned about; None where nothing is.

    Raises ValueError where a kind is unknown, or lacks its axis.
    """

    kind: SymmetryKind = "none"
    axis: Axis | None = None

    def __post_init__(self) -> None:
        if self.kind not in get_args(SymmetryKind):
            raise ValueError(
                f"symmetry is {self.kind!r}; expected 'none', 'half turn' or 'any turn'"
            )
        if (self.axis is None) != (self.kind == "none") or self.axis not in (None, *get_args(Axis)):
            raise ValueError(
                f"the axis of symmetry {self.kind!r} is {self.axis!r}; expected 'x', 'y' or 'z', "
                "and None where there is no symmetry"
            )

    @classmethod
    def half_turn(cls, axis: Axis) -> Self:
        """Return the symmetry of what is the same after a half turn about an axis."""
        return cls("half turn", axis)

    @classmethod
    def any_turn(cls, axis: Axis) -> Self:
        """Return the symmetry of what is the same after any turn about an axis."""
        return cls("any turn", axis)

    @property
    def column(self) -> int:
        """The number of the axis, 0 to 2; raises ValueError where there is none."""
        if self.axis is None:
            raise ValueError("there is no axis where there is no symmetry")
        return "xyz".index(self.axis)

    @property
    def X_half_turn(self) -> Array:
        """(4, 4): the half turn about the axis, exact; the identity without symmetry."""
        signs = -np.ones(3)
        if self.axis is None:
            signs[:] = 1.0
        else:
            signs[self.column] = 1.0
        return np.diag([*signs, 1.0])

    def nearest(self, X_WPs: ArrayLike, X_WP: ArrayLike) -> Array:
        """Return of each pose (N, 4, 4) the equivalent that is turned most like X_WP (4, 4)."""
        poses, R_WP = np.asarray(X_WPs, dtype=float), np.asarray(X_WP, dtype=float)[:3, :3]
        if self.kind == "none":
            return poses
        if self.kind == "any turn":
            return poses @ make_pose(self._aligning(R_WP.T @ poses[..., :3, :3]))
        others = poses @ self.X_half_turn
        nearer = rotation_error_rad(others[..., :3, :3], R_WP) < rotation_error_rad(
            poses[..., :3, :3], R_WP
        )
        return np.where(nearer[..., None, None], others, poses)

    def rotation_error_rad(self, R_As: Array, R_Bs: Array) -> Array:
        """Return the least angles (...) in [0, pi] between equivalents of rotations (..., 3, 3).

        The shapes broadcast.
        """
        if self.kind == "any turn":
            cosine = np.einsum("...i,...i->...", R_As[..., self.column], R_Bs[..., self.column])
            return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))
        error = rotation_error_rad(R_As, R_Bs)
        if self.kind == "half turn":
            turned = R_Bs @ self.X_half_turn[:3, :3]
            error = np.minimum(error, rotation_error_rad(R_As, turned))
        return np.asarray(error)

    def _aligning(self, R_PQs: Array) -> Array:
        """Return the turns (..., 3, 3) about the axis after which Q is turned most like P.

        The trace of R_PQ Rot(theta) is a cosine of theta with this phase.
        """
        i, j = (self.column + 1) % 3, (self.column + 2) % 3
        sine = R_PQs[..., i, j] - R_PQs[..., j, i]
        cosine = R_PQs[..., i, i] + R_PQs[..., j, j]
        theta = np.arctan2(sine, cosine)
        turns = np.zeros_like(R_PQs)
        turns[..., i, i] = turns[..., j, j] = np.cos(theta)
        turns[..., j, i] = np.sin(theta)
        turns[..., i, j] = -turns[..., j, i]
        turns[..., self.column, self.column] = 1.0
        return turns


@dataclass(frozen=True)
class PoseTask:
    """What poses are for.

    Attributes:
        name: lower-case letters, digits and underscores; what it is known by everywhere.
        symmetry: which poses mean the same.
        frame: what the pose's frame means, in words; tasks that differ in it alone are equal.

    Raises ValueError where the name has other characters.
    """

    name: str
    symmetry: Symmetry = field(default_factory=Symmetry)
    frame: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(
                f"a task is called {self.name!r}; expected lower-case letters, digits and "
                "underscores, a letter first"
            )

    def __str__(self) -> str:
        return self.name

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """Return the task that `asdict` made these fields of."""
        return cls(**{**fields, "symmetry": Symmetry(**fields["symmetry"])})


GRASP = PoseTask(
    "grasp",
    Symmetry.half_turn("z"),
    "a gripper that closes on the object: z the approach, y the closing direction",
)
HANDLE = PoseTask(
    "handle",
    Symmetry.half_turn("x"),
    "a handle's opening: y through it, x away from the body, z to the rim or to the base",
)
UPRIGHT = PoseTask(
    "upright",
    Symmetry(),
    "an object that stands: origin at the centre of its base, z to its rim, x to its handle",
)
# The tasks of mugs, in the order of the weights that ship.
MUG_TASKS = (GRASP, HANDLE, UPRIGHT)


def find_tasks(
    tasks: Iterable[PoseTask | str], known: Sequence[PoseTask], whose: str
) -> tuple[PoseTask, ...]:
    """Return the tasks, of which some may be given by their names alone.

    Args:
        tasks: that are asked for.
        known: those there are.
        whose: they are, for the message.

    Raises UnknownTaskError naming those known, where one is not among them, and TypeError where
    `tasks` is a single name.
    """
    if isinstance(tasks, str):
        raise TypeError(f"tasks are {tasks!r}; expected a sequence, such as [{tasks!r}]")
    by_name = {task.name: task for task in known}
    found = []
    for task in tasks:
        name = str(task)
        if name not in by_name:
            raise UnknownTaskError(f"{whose} has no task {name!r}; it has {', '.join(by_name)}")
        if isinstance(task, PoseTask) and task.symmetry != by_name[name].symmetry:
            raise UnknownTaskError(
                f"task {name!r} has the symmetry {asdict(task.symmetry)}, but that of {whose} has "
                f"{asdict(by_name[name].symmetry)}"
            )
        found.append(by_name[name])
    return tuple(found)
