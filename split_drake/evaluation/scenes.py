"""The objects and scenes that a detector is evaluated on."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np

from split_drake.bad_input import require_number, require_numbers
from split_drake.data.object_scenes import ObjectScene, ObjectScenes
from split_drake.data.rests import Rests, load_rests, settle
from split_drake.grasps.free_hand import FreeHand
from split_drake.grasps.judge import GraspJudge, feasible
from split_drake.grasps.store import CheckedGrasps, load_checked_grasps
from split_drake.grasps.visibility import GraspVisibility
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.peg_test import PegTest
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.task_object import TaskObject
from split_drake.poses import Array
from split_drake.scene import MAX_NOISE_M
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout

# As many for an object from a file as are stored of the splits' mugs.
RESTS = 40


@dataclass(frozen=True)
class EvalOptions:
    """What an evaluation's scenes are.

    Attributes:
        physics_scenes: in how many of the first scenes grasps are tried in physics.
        noise_m: standard deviation of the noise on the points.
        seed: of all draws; with the number of a scene it says all about the scene.
    """

    physics_scenes: int = 0
    noise_m: float = 0.005
    seed: int = 0

    def __post_init__(self) -> None:
        require_numbers(self)
        if self.physics_scenes < 0:
            raise ValueError(f"physics_scenes is {self.physics_scenes}; expected at least 0")
        require_number("noise_m", self.noise_m, 0.0, MAX_NOISE_M, "a standard deviation in metres")


class TrueGrasps:
    """The grasps of an object that hold in physics, its mirror images included."""

    def __init__(self, subject: TaskObject, grasps: CheckedGrasps) -> None:
        every = grasps.with_mirror_images() if subject.mirrored else grasps
        self._X_OGs = every.X_OGs[every.holds]
        self._openings_m = every.openings_m[every.holds]
        self._visibility = GraspVisibility(subject.body.mesh, self._X_OGs, self._openings_m)

    def in_scene(self, scene: ObjectScene) -> Array:
        """Return those (M, 4, 4), as X_WG, that are feasible and visible in a scene."""
        possible = feasible(scene.X_WO, self._X_OGs, self._openings_m, scene.table_z_m)
        possible &= self._visibility.visible(scene.X_WO, scene.p_WPs)
        return scene.X_WO @ self._X_OGs[possible]


class EvalSubject:
    """An object, the scenes it appears in, and what judges detected poses of it.

    Attributes:
        shape: the object.
        true_grasps: None where they are not known.
    """

    def __init__(
        self, shape: TaskObject, rests: Rests, layout: Layout, true_grasps: TrueGrasps | None
    ) -> None:
        self.shape = shape
        self.true_grasps = true_grasps
        self._layout = layout
        self._scenes = ObjectScenes(shape, rests, layout, randomization=None)

    @classmethod
    def settled(cls, shape: TaskObject, layout: Layout, rng: np.random.Generator) -> Self:
        """Return an object of which neither rests nor grasps are stored; dropping takes seconds."""
        rests = settle(shape.body, RESTS, rng, StationConfig(layout))
        return cls(shape, rests, layout, true_grasps=None)

    @cached_property
    def judge(self) -> GraspJudge:
        """What judges grasps X_OG of the object by its mesh."""
        return GraspJudge(self.shape.body.mesh)

    @cached_property
    def peg(self) -> PegTest | None:
        """What tries pegs in a mug's handle; None for other objects."""
        return PegTest(self.shape) if isinstance(self.shape, MugShape) else None

    @cached_property
    def hand(self) -> FreeHand:
        """What tries grasps of the object in physics; made when first asked for."""
        return FreeHand(self.shape.body, StationConfig(self._layout))

    def draw(self, rng: np.random.Generator) -> ObjectScene:
        """Return a scene, drawn as a scenario draws its starts and seen by its cameras."""
        return self._scenes.draw(rng)


class EvalSubjects(Protocol):
    """The objects of an evaluation; pickled by worker processes."""

    @property
    def layout(self) -> Layout:
        """Of the cameras and the workspace."""
        ...

    def names(self) -> Sequence[str]:
        """Return the names of all objects."""
        ...

    def make(self, number: int, seed: int) -> EvalSubject:
        """Return object `number`; what it draws depends on the seed and the number alone."""
        ...

    def config(self) -> dict[str, Any]:
        """Return what tells these objects and their scenes from others, as JSON values."""
        ...


@dataclass(frozen=True)
class EvalMugs:
    """Mugs of a fixed split, or of a folder of upright mesh files.

    Attributes:
        source: of the mugs.
        layout: of the cameras and the workspace.
    """

    source: MugSource
    layout: Layout

    def names(self) -> Sequence[str]:
        """Return the names of all mugs."""
        return self.source.names()

    def make(self, number: int, seed: int) -> EvalSubject:
        """Return mug `number`: the rests and grasps of a split's are stored."""
        shape, split = self.source.load(self.names()[number]), self.source.split
        if split is None:
            return EvalSubject.settled(shape, self.layout, np.random.default_rng([seed, number]))
        grasps = TrueGrasps(shape, load_checked_grasps(split, shape.name))
        return EvalSubject(shape, load_rests(split, shape.name), self.layout, grasps)

    def config(self) -> dict[str, Any]:
        """Return what tells these mugs and their scenes from others."""
        return {
            "mugs": self.source.where,
            "mugs_sha256": self.source.sha256(),
            **({"left_out": self.source.left_out} if self.source.left_out else {}),
            "workspace": asdict(self.layout.workspace),
        }
