"""A second family of objects, and a task of its own: bowls, and the circle of their rim."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import trimesh

from split_drake.data.rests import Rests, settle
from split_drake.evaluation.scenes import EvalSubject
from split_drake.objects.collision_pieces import ring_of_boxes
from split_drake.objects.rigid import Primitive, RigidObject
from split_drake.objects.task_object import TaskObject
from split_drake.pose_task import PoseTask, Symmetry
from split_drake.poses import make_pose
from split_drake.station.layout import Layout
from tests.helpers.stations import STATION

RIM = PoseTask(
    "rim", Symmetry.any_turn("z"), "a bowl's rim: origin in the middle of its circle, z out of it"
)
WALL_M, FLOOR_M, BOXES = 0.005, 0.006, 24
RESTS = 3


def build_bowl(number: int) -> TaskObject:
    """Return bowl `number`: a cone that opens upwards, with a floor; O in the middle of its base.

    Sizes are drawn by the number alone.
    """
    rng = np.random.default_rng(number)
    base_m, rim_m = rng.uniform(0.025, 0.035), rng.uniform(0.05, 0.06)
    height_m = rng.uniform(0.04, 0.06)
    profile = [
        (0.0, 0.0),
        (base_m, 0.0),
        (rim_m, height_m),
        (rim_m - WALL_M, height_m),
        (base_m - WALL_M, FLOOR_M),
        (0.0, FLOOR_M),
    ]
    mesh = trimesh.creation.revolve(np.array(profile), sections=64)
    mass_kg = 0.2
    floor = Primitive("cylinder", (base_m, FLOOR_M), make_pose(p=(0.0, 0.0, FLOOR_M / 2.0)))
    ends = np.array([base_m, 0.0]), np.array([rim_m, height_m])
    body = RigidObject(
        name=f"bowl_{number}",
        mesh=mesh,
        mass_kg=mass_kg,
        p_OCom=np.asarray(mesh.center_mass),
        inertia_kg_m2=mesh.moment_inertia * (mass_kg / mesh.volume),
        collision=(floor, *ring_of_boxes(*ends, WALL_M, BOXES)),
    )
    rim = make_pose(p=(0.0, 0.0, height_m))[None]
    return TaskObject(body=body, X_OPs={RIM: rim}, mirrored=True, number=number)


@lru_cache(maxsize=16)
def bowl_rests(number: int) -> Rests:
    """Return how bowl `number` comes to rest after a few drops in physics."""
    rng = np.random.default_rng(number)
    return settle(build_bowl(number).body, RESTS, rng, STATION)


def rests_of(bowl: TaskObject, _layout: Layout) -> Rests:
    """Return how a bowl comes to rest on a table."""
    return bowl_rests(bowl.number)


@dataclass(frozen=True)
class Bowls:
    """Bowls by their numbers: an `ObjectSource`, and the `EvalSubjects` of an evaluation.

    Attributes:
        numbers: of the bowls.
        layout: of the cameras and the workspace.
    """

    numbers: tuple[int, ...]
    layout: Layout

    def names(self) -> Sequence[str]:
        return [f"bowl_{number}" for number in self.numbers]

    def load(self, name: str) -> TaskObject:
        return build_bowl(self.numbers[list(self.names()).index(name)])

    def sha256(self) -> str:
        return f"bowls {self.numbers}"

    def make(self, number: int, seed: int) -> EvalSubject:
        bowl = build_bowl(self.numbers[number])
        return EvalSubject(bowl, rests_of(bowl, self.layout), self.layout, true_grasps=None)

    def config(self) -> dict[str, Any]:
        return {"bowls": self.numbers, "workspace": asdict(self.layout.workspace)}
