"""Shapes by name: the fixed split into kinds to train on and kinds that are held out.

``python -m split_drake.objects.procedural.split`` writes ``models/procedural/{train,test}.json``,
the kinds and seeds that ``ProceduralSource("train").load("bottle_3")`` builds a shape from.
"""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from rich import print
from rich.progress import track

from split_drake.bad_input import require_numbers
from split_drake.experiments.command import run_command
from split_drake.experiments.pool import WorkerPool
from split_drake.files import write_json
from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects.antipodal import antipodal_share
from split_drake.objects.procedural import blocks, composed, prisms, slender, turned, vessels
from split_drake.objects.procedural.kinds import KINDS, build_body
from split_drake.objects.rigid import RigidObject
from split_drake.objects.task_object import TaskObject

Split = Literal["train", "test"]

# Importing these registers their kinds.
KIND_MODULES = (blocks, composed, prisms, slender, turned, vessels)
# Kinds that no shape to train on is of: some hollow, flat, long, round and composed ones.
TEST_KINDS = (
    *("jar", "goblet", "pan", "nut", "star", "wrench"),
    *("brush", "bolt", "pear", "jack", "animal", "bevelled_block"),
)

SIZE_M = (0.02, 0.15)
MIN_THICKNESS_M = 0.008
MAX_PIECES = 120
MIN_ANTIPODAL_SHARE = 0.05
# A kind whose seeds are refused this often in a row has something wrong with it.
_MAX_REFUSED = 200


class InvalidShapeError(ValueError):
    """A shape that is of no use; the message starts with the reason."""


@dataclass(frozen=True)
class ShapeEntry:
    """One shape of a split.

    Attributes:
        kind: of the shape.
        seed: with `kind` all that the shape depends on.
        volume_mm3: of its mesh, by which a changed kind is noticed.
    """

    kind: str
    seed: int
    volume_mm3: int

    @property
    def name(self) -> str:
        return f"{self.kind}_{self.seed}"


@dataclass(frozen=True)
class ProceduralSource:
    """The shapes of a split, as an `ObjectSource`.

    Attributes:
        split: "train" or "test".

    Raises ValueError where it is neither.
    """

    split: Split

    def __post_init__(self) -> None:
        if self.split not in get_args(Split):
            raise ValueError(f"split is {self.split!r}; expected one of {get_args(Split)}")

    def names(self) -> tuple[str, ...]:
        """Return the names of all shapes, such as "bottle_3", kinds taking turns."""
        return tuple(_numbers(self.split))

    def load(self, name: str) -> TaskObject:
        """Return the shape of that name, which has no task's poses.

        Raises ValueError where the split has none.
        """
        numbers = _numbers(self.split)
        if name not in numbers:
            first = ", ".join(list(numbers)[:3])
            raise ValueError(f"no shape of {self.split} is called {name!r}; expected {first} or so")
        number = numbers[name]
        entry = entries(self.split)[number]
        return TaskObject(body=build_body(entry.kind, entry.seed), split=self.split, number=number)

    def sha256(self) -> str:
        """Return a hash of the kinds, seeds and volumes."""
        return hashlib.sha256(_text(self.split).encode()).hexdigest()


def _text(split: Split) -> str:
    return (MODELS_FOLDER / "procedural" / f"{split}.json").read_text()


@lru_cache(maxsize=2)
def entries(split: Split) -> tuple[ShapeEntry, ...]:
    """Return what the shapes of a split are built from, in order."""
    return tuple(ShapeEntry(**entry) for entry in json.loads(_text(split))["shapes"])


@lru_cache(maxsize=2)
def _numbers(split: Split) -> dict[str, int]:
    return {entry.name: number for number, entry in enumerate(entries(split))}


def kinds_of(split: Split) -> tuple[str, ...]:
    """Return the kinds that a split's shapes are drawn from."""
    train = tuple(name for name in KINDS if name not in TEST_KINDS)
    return TEST_KINDS if split == "test" else train


def check_shape(body: RigidObject) -> None:
    """Raise InvalidShapeError, naming reason and numbers, where a shape is of no use."""
    mesh = body.mesh
    if not mesh.is_watertight or mesh.volume <= 0.0:
        raise InvalidShapeError("leaking mesh: an edge has not exactly two faces")
    if mesh.body_count != 1:
        raise InvalidShapeError(f"parts apart: the mesh has {mesh.body_count} bodies")
    thickness_m, _, size_m = sorted(mesh.extents)
    if not SIZE_M[0] <= size_m <= SIZE_M[1]:
        raise InvalidShapeError(f"wrong size: {size_m:.3f} m, expected {SIZE_M[0]} to {SIZE_M[1]}")
    if thickness_m < MIN_THICKNESS_M:
        raise InvalidShapeError(f"too thin: {thickness_m:.4f} m, expected {MIN_THICKNESS_M}")
    if len(body.collision) > MAX_PIECES:
        raise InvalidShapeError(f"many pieces: {len(body.collision)}, expected up to {MAX_PIECES}")
    if (share := antipodal_share(mesh)) < MIN_ANTIPODAL_SHARE:
        raise InvalidShapeError(
            f"no grasp: {share:.1%} of its surface can be held, expected {MIN_ANTIPODAL_SHARE:.0%}"
        )


def draw_shapes(kind: str, count: int) -> tuple[list[ShapeEntry], Counter[str]]:
    """Return the first `count` valid shapes of a kind, and how many seeds were refused and why.

    Raises InvalidShapeError where hardly any is valid.
    """
    drawn: list[ShapeEntry] = []
    refused: Counter[str] = Counter()
    seed = 0
    while len(drawn) < count:
        body = build_body(kind, seed)
        try:
            check_shape(body)
        except InvalidShapeError as error:
            refused[str(error).split(":")[0]] += 1
            if refused.total() > _MAX_REFUSED + len(drawn):
                raise InvalidShapeError(f"{kind}: hardly any shape is valid: {error}") from error
        else:
            drawn.append(ShapeEntry(kind, seed, round(body.mesh.volume * 1e9)))
        seed += 1
    return drawn, refused


def take_turns(by_kind: Sequence[Sequence[ShapeEntry]], count: int) -> list[ShapeEntry]:
    """Return `count` shapes, of each kind the first, then of each the second, and so on."""
    rounds = max(map(len, by_kind))
    order = [shapes[i] for i in range(rounds) for shapes in by_kind if i < len(shapes)]
    return order[:count]


@dataclass(frozen=True)
class SplitConfig:
    """Draws the shapes that the project trains and tests on.

    Attributes:
        out: folder to write train.json and test.json to.
        train: shapes for training.
        test: shapes for testing.
        workers: processes; the shapes do not depend on them.
    """

    out: Path = Path("models/procedural")
    train: int = 1200
    test: int = 120
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("train", "test", "workers"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}; expected at least 1")


def _draw(task: tuple[str, int]) -> tuple[list[ShapeEntry], Counter[str]]:
    return draw_shapes(*task)


def write_split(config: SplitConfig) -> None:
    """Draw the split, write it, and print which shares of each kind's seeds were refused."""
    counts: dict[Split, int] = {"train": config.train, "test": config.test}
    for split, count in counts.items():
        kinds = kinds_of(split)
        tasks = [(kind, int(np.ceil(count / len(kinds)))) for kind in kinds]
        found = list(track(WorkerPool(_draw, config.workers).run(tasks), split, total=len(tasks)))
        drawn = {shapes[0].kind: shapes for shapes, _ in found}
        chosen = take_turns([drawn[kind] for kind in kinds], count)
        content = {"shapes": [asdict(entry) for entry in chosen]}
        write_json(config.out / f"{split}.json", content)
        for shapes, refused in found:
            if refused:
                reasons = ", ".join(f"{n} {reason}" for reason, n in refused.most_common())
                print(f"  {shapes[0].kind}: refused {reasons} for {len(shapes)}")
        print(f"{split}: {len(chosen)} shapes of {len(kinds)} kinds")


if __name__ == "__main__":
    run_command(write_split, SplitConfig, __doc__)
