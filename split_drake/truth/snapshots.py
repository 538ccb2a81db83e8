"""How a station stood at a moment, to be drawn later."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from split_drake.poses import Array
from split_drake.station.station import Station


def snapshot(station: Station) -> Array:
    """Return the positions of everything, as `stand_as` wants them."""
    return np.array(station.plant.GetPositions(station.plant_context))


@contextmanager
def restored(station: Station) -> Iterator[None]:
    """Put everything back at the end to where it is now."""
    now = snapshot(station)
    try:
        yield
    finally:
        stand_as(station, now)


def stand_as(station: Station, positions: Sequence[float] | Array) -> None:
    """Put everything to where it was in a snapshot."""
    station.plant.SetPositions(station.plant_context, np.asarray(positions))
