"""Which objects lie in scenes of clutter, drawn one scene after another."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from split_drake.data.clutter.arrangements import Arrangement, packed, subsets
from split_drake.data.clutter.library import NO_GRASPS, ClutterObject, ObjectGrasps
from split_drake.data.clutter.piles import PileSimulator
from split_drake.objects.task_object import ObjectSource
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout

PILE_SHARE = 0.5
# Objects in a scene at most.
MOST_OBJECTS = 6
# Piles are simulated with a longer step than trials: nothing is held.
PILE_STEP_S = 0.004


class Objects:
    """Objects of a source, made when they are first wanted.

    Those without a grasp lie there as well: they have to be told from others.

    Args:
        source: of the objects.
        grasps: {name of an object: its grasps}; objects that are not named have none.
    """

    def __init__(
        self, source: ObjectSource, grasps: Mapping[str, ObjectGrasps] | None = None
    ) -> None:
        self._source = source
        self._grasps = grasps or {}
        self._names = list(source.names())
        self._made: dict[str, ClutterObject] = {}

    def draw(self, count: int, rng: np.random.Generator) -> list[ClutterObject]:
        """Return objects drawn with replacement."""
        return [self._get(self._names[n]) for n in rng.integers(len(self._names), size=count)]

    def _get(self, name: str) -> ClutterObject:
        if name not in self._made:
            grasps = self._grasps.get(name, NO_GRASPS)
            self._made[name] = ClutterObject(self._source.load(name), grasps)
        return self._made[name]


def arrangements(
    objects: Objects, layout: Layout, rng: np.random.Generator
) -> Iterator[tuple[list[ClutterObject], Arrangement]]:
    """Yield drawn objects and how some of them lie, without end.

    About half are packed, the others piles as they grow.
    """
    piled = standing = 0
    while True:
        drawn = objects.draw(int(rng.integers(1, MOST_OBJECTS + 1)), rng)
        if piled < PILE_SHARE * (piled + standing + 1):
            for arrangement in _pile(drawn, layout, rng):
                piled += 1
                yield drawn, arrangement
        else:
            # With fewer objects, too: rounds end with one.
            every = list(subsets(packed(drawn, layout.workspace, rng)))
            for number in dict.fromkeys((len(every) - 1, int(rng.integers(len(every))))):
                standing += 1
                yield drawn, every[number]


def _pile(
    objects: Sequence[ClutterObject], layout: Layout, rng: np.random.Generator
) -> Iterator[Arrangement]:
    config = StationConfig(layout, time_step_s=PILE_STEP_S)
    try:
        yield from PileSimulator(objects, config).drop_all(rng)
    except RuntimeError:  # Drake's contact solver: what fell before is seen already
        return
