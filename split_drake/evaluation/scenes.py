"""The mugs and scenes that a detector is evaluated on."""

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from split_drake.data.mug_scenes import MugScene, MugScenes
from split_drake.data.rests import Rests, load_rests, settle
from split_drake.evaluation.peg import PegTest
from split_drake.grasps.free_hand import FreeHand
from split_drake.grasps.judge import GraspJudge, feasible
from split_drake.grasps.store import CheckedGrasps, load_checked_grasps
from split_drake.grasps.visibility import GraspVisibility
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.mug_source import MugSource
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import Array
from split_drake.station.layout import Layout

# As many for a mug from a file as are stored of the splits' mugs.
RESTS = 40


@dataclass(frozen=True)
class EvalOptions:
    """What an evaluation's scenes are.

    Attributes:
        mugs: "train", "test", or a folder of upright mesh files.
        scenes: how many, spread evenly over the mugs of a split.
        scenes_per_mug: how many of each mug of a folder.
        physics_scenes: in how many of the first scenes grasps are tried in physics.
        noise_m: standard deviation of the noise on the points.
        seed: of all draws; with the number of a scene it says all about the scene.
    """

    mugs: str = "test"
    scenes: int = 2000
    scenes_per_mug: int = 200
    physics_scenes: int = 0
    noise_m: float = 0.005
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least in (("scenes", 1), ("scenes_per_mug", 1), ("physics_scenes", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least {least}")
        if not self.noise_m >= 0.0:
            raise ValueError(
                f"noise_m is {self.noise_m}; expected a standard deviation >= 0 in metres"
            )
        MugSource(self.mugs)

    @property
    def source(self) -> MugSource:
        """Where the mugs come from."""
        return MugSource(self.mugs)

    @property
    def of_split(self) -> bool:
        """Whether the mugs are those of a fixed split."""
        return self.source.folder is None

    def of_each_scene(self) -> dict[str, Any]:
        """Return what each scene's record depends on: all but how many there are."""
        options = asdict(self)
        return {key: options[key] for key in ("mugs", "physics_scenes", "noise_m", "seed")}


class TrueGrasps:
    """The grasps of a mug that hold in physics, mirror images included."""

    def __init__(self, shape: MugShape, grasps: CheckedGrasps) -> None:
        every = grasps.with_mirror_images()
        self._X_OGs = every.X_OGs[every.holds]
        self._openings_m = every.openings_m[every.holds]
        self._visibility = GraspVisibility(shape.body.mesh, self._X_OGs, self._openings_m)

    def in_scene(self, scene: MugScene) -> Array:
        """Return those (M, 4, 4), as X_WG, that are feasible and visible in a scene of the mug."""
        possible = feasible(scene.X_WO, self._X_OGs, self._openings_m)
        possible &= self._visibility.visible(scene.X_WO, scene.p_WPs)
        return scene.X_WO @ self._X_OGs[possible]


class EvalMug:
    """A mug, the scenes it appears in, and what judges detected poses of it.

    Attributes:
        shape: the mug.
        true_grasps: None where they are not known.
    """

    def __init__(self, shape: MugShape, rests: Rests, true_grasps: TrueGrasps | None) -> None:
        self.shape = shape
        self.true_grasps = true_grasps
        self._scenes = MugScenes(shape, rests, Layout(), randomization=None)

    @classmethod
    def of_split(cls, name: str) -> Self:
        """Return the mug `name` of a fixed split."""
        shape = load_mug(name)
        return cls(shape, load_rests(name), TrueGrasps(shape, load_checked_grasps(name)))

    @classmethod
    def settled(cls, shape: MugShape, rng: np.random.Generator) -> Self:
        """Return a mug of which neither rests nor grasps are stored; dropping it takes seconds."""
        return cls(shape, settle(shape.body, RESTS, rng), true_grasps=None)

    @cached_property
    def judge(self) -> GraspJudge:
        return GraspJudge(self.shape.body.mesh)

    @cached_property
    def peg(self) -> PegTest:
        return PegTest(self.shape)

    @cached_property
    def hand(self) -> FreeHand:
        return FreeHand(self.shape.body)

    def draw(self, rng: np.random.Generator) -> MugScene:
        """Return a scene, drawn as a scenario draws its starts and seen by its cameras."""
        return self._scenes.draw(rng)


class EvalMugs:
    """All mugs of an evaluation, made when they are first wanted."""

    def __init__(self, options: EvalOptions) -> None:
        self._options = options
        self._made: dict[int, EvalMug] = {}

    @cached_property
    def names(self) -> tuple[str, ...]:
        return self._options.source.names()

    def scenes(self) -> int:
        """Return how many scenes are wanted."""
        options = self._options
        return options.scenes if options.of_split else options.scenes_per_mug * len(self.names)

    def of_scene(self, index: int) -> EvalMug:
        """Return the mug of scene `index`: they take turns."""
        number = index % len(self.names)
        if number not in self._made:
            self._made[number] = self._make(number)
        return self._made[number]

    def _make(self, number: int) -> EvalMug:
        if self._options.of_split:
            return EvalMug.of_split(self.names[number])
        shape = self._options.source.load(self.names[number])
        return EvalMug.settled(shape, np.random.default_rng([self._options.seed, number]))
