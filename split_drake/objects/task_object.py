"""Objects that tasks ask about: a rigid body, and where its poses are."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from split_drake.objects.rigid import RigidObject
from split_drake.pose_task import PoseTask, UnknownTaskError
from split_drake.poses import Array


class Feature(Protocol):
    """A part of an object that its poses are told by, a mug's handle say."""

    def count(self, X_WO: Array, p_WPs: Array) -> int:
        """Return how many of the points (N, 3) lie on it, the object being at X_WO (4, 4)."""
        ...

    def seen_share(self, X_WO: Array, p_WC: Array) -> float:
        """Return the share of it that is seen from `p_WC` (3,), the object being at X_WO."""
        ...


@dataclass(frozen=True, kw_only=True)
class TaskObject:
    """A rigid object and the poses that tasks ask about, wherever it lies.

    Grasps are not among them: which of these are possible depends on how the object lies.

    Attributes:
        body: the rigid object.
        X_OPs: {task: (K, 4, 4) poses in O}, one each of those that mean the same.
        mirrored: whether the plane y = 0 of O is a plane of symmetry.
        split: the fixed set that the object belongs to; empty where it is from a file.
        number: of the object in its fixed set.
    """

    body: RigidObject
    X_OPs: Mapping[PoseTask, Array] = field(default_factory=dict)
    mirrored: bool = False
    split: str = ""
    number: int = 0

    @property
    def name(self) -> str:
        """The body's name, unique in its set."""
        return self.body.name

    @property
    def seed(self) -> tuple[int, ...]:
        """What the object's random draws are seeded by, together with a seed of the user's.

        By `split` and `number` in the fixed sets, and by `split` and name in all others.
        """
        if self.split in ("train", "test"):
            return self.number, int(self.split == "test")
        digest = hashlib.sha256(f"{self.split}/{self.name}".encode()).digest()
        return (*np.frombuffer(digest[:16], dtype=">u4").tolist(),)

    def feature(self) -> Feature | None:
        """Return the part that poses are told by; None where the whole object tells them."""
        return None

    def poses_of(self, task: PoseTask) -> Array:
        """Return X_OPs (K, 4, 4) of a task; raise UnknownTaskError where the object has none."""
        if task not in self.X_OPs:
            known = ", ".join(map(str, self.X_OPs)) or "no task"
            raise UnknownTaskError(
                f"{self.name} has no poses of {task.name!r}; it has those of {known}"
            )
        return np.asarray(self.X_OPs[task], dtype=float)

    def true_poses(self, task: PoseTask, X_WO: Array) -> Array:
        """Return the true X_WPs (N, 4, 4) of a task, the object being at X_WO (4, 4).

        Those that mean the same after a half turn are both there, all first ones first.
        """
        X_WPs = X_WO @ self.poses_of(task)
        if task.symmetry.kind != "half turn":
            return X_WPs
        return np.concatenate([X_WPs, X_WPs @ task.symmetry.X_half_turn])


class ObjectSource(Protocol):
    """Where objects come from; pickled by worker processes."""

    def names(self) -> Sequence[str]:
        """Return the names of all objects, in a fixed order."""
        ...

    def load(self, name: str) -> TaskObject:
        """Return the object of that name."""
        ...

    def sha256(self) -> str:
        """Return a hash of what the objects are made from."""
        ...
