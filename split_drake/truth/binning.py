"""What an arm that clears a table has brought into its bin, and what is lost."""

from collections.abc import Collection

import numpy as np

from split_drake.poses import Array
from split_drake.station.station import Station
from split_drake.truth.removal import Removal, in_cube, wait_for_all_to_rest
from split_drake.truth.state import Truth


def sort_out(station: Station, truth: Truth, binned: Collection[int]) -> Removal:
    """Wait for rest, and say what came into the bin; park what is neither there nor in the cube.

    Args:
        station: with a bin.
        binned: the objects that are in the bin already, by their indices; they stay there.

    Returns what is newly in the bin as `taken`, and as `left` what is still in the workspace.
    Raises RuntimeError where Drake's contact solver fails, ValueError where there is no bin.
    """
    layout = station.config.layout
    if layout.bin is None:
        raise ValueError("the layout has no bin; expected one")
    taken: list[int] = []
    lost: list[int] = []
    while True:
        rests = wait_for_all_to_rest(station, truth)
        gone = []
        for index in station.present:
            p_WCom: Array = np.asarray(truth.p_WCom(index))
            if index in binned or index in taken:
                continue
            if layout.bin.contains(p_WCom):
                taken.append(index)
            elif not in_cube(p_WCom, layout.workspace):
                gone.append(index)
        for index in gone:
            station.park_object(index)
        lost += gone
        if not gone:
            left = [i for i in station.present if i not in binned and i not in taken]
            return Removal(tuple(taken), tuple(lost), tuple(left), rests)
