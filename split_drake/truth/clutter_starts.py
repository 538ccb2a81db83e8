"""Drawing how the objects of a clutter round lie when it starts: packed, or in a pile.

The scenes are VGN's (arXiv 2101.01132), with its numbers, for a cube of 0.30 m; which objects, and
how large, the caller has drawn.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array, make_pose, rotation_z
from split_drake.robot.panda import HAND_BODIES
from split_drake.station.fixtures import TABLE_BODY
from split_drake.station.hand.fence import FENCE_BODY
from split_drake.station.hand.hand_station import HandStation
from split_drake.truth.removal import wait_and_remove, wait_for_all_to_rest
from split_drake.truth.state import Truth

OBJECTS = 5
PACKED_ATTEMPTS = 12
# From the workspace's centre, along x and y.
PACKED_SPREAD_M = 0.07
PILE_SPREAD_M = 0.05

STANDING_GAP_M = 0.002
DROP_HEIGHT_M = 0.2
DROP_TIMEOUT_S = 1.0
# Where the pile reaches up to it, an object is dropped from so much higher at a time.
_RAISE_M = 0.02


@dataclass(frozen=True)
class ClutterStart:
    """Which objects lie in the workspace, and how.

    Attributes:
        indices: (N,) of the station's objects that are in, ascending; all others are parked.
        X_WOs: (N, 4, 4) their poses.
        rests: whether they came to rest in time.
    """

    indices: tuple[int, ...]
    X_WOs: Array
    rests: bool


def packed_start(
    station: HandStation,
    truth: Truth,
    rng: np.random.Generator,
    count: int = OBJECTS,
    attempts: int = PACKED_ATTEMPTS,
) -> ClutterStart:
    """Stand objects on the table, one at a time, each at rest before the next one comes.

    The station's objects come in their order; an attempt that touches anything is undone, and its
    object comes again when all others had their turn.  So a station with as many objects as there
    are attempts gives each attempt an object of its own, as in VGN.

    Args:
        count: how many are to stand; there may be fewer in the end.
        attempts: how many there are at most.
    """
    _clear(station)
    waiting = deque(range(len(station.objects)))
    for _ in range(attempts):
        if not waiting or len(station.present) >= count:
            break
        index = waiting.popleft()
        station.place_object(index, _standing(station, index, rng))
        if _overlaps(station, truth, index):
            station.park_object(index)
            waiting.append(index)
        else:
            wait_and_remove(station, truth)
    return _start(station, truth)


def pile_start(
    station: HandStation, truth: Truth, rng: np.random.Generator, count: int = OBJECTS
) -> ClutterStart:
    """Drop the first `count` objects between walls, one after another, and take the walls away.

    What leaves the cube then is not in.
    """
    _clear(station)
    station.put_fence_up()
    for index in range(min(count, len(station.objects))):
        X_WO = _dropped(station, index, rng)
        station.place_object(index, X_WO)
        while _overlaps(station, truth, index):
            X_WO[2, 3] += _RAISE_M
            station.place_object(index, X_WO)
        wait_for_all_to_rest(station, truth, DROP_TIMEOUT_S)
    station.take_fence_away()
    return _start(station, truth)


def _clear(station: HandStation) -> None:
    station.park_hand()
    station.take_fence_away()
    for index in station.present:
        station.park_object(index)


def _start(station: HandStation, truth: Truth) -> ClutterStart:
    rests, _ = wait_and_remove(station, truth)
    X_WOs = np.array([truth.X_WO(index) for index in station.present])
    return ClutterStart(station.present, X_WOs.reshape(-1, 4, 4), rests)


def _standing(station: HandStation, index: int, rng: np.random.Generator) -> Array:
    """Return X_WO (4, 4) of an object that stands upright in O, 2 mm above the table."""
    offset = rng.uniform(-PACKED_SPREAD_M, PACKED_SPREAD_M, size=2)
    R_WO = rotation_z(rng.uniform(0.0, 2.0 * np.pi))
    item = station.objects[index]
    height_m = item.mesh.extents[2] / 2.0 + STANDING_GAP_M
    return _around_middle(item, R_WO, _above_table(station, offset, height_m))


def _dropped(station: HandStation, index: int, rng: np.random.Generator) -> Array:
    """Return X_WO (4, 4) of an object anyhow turned, 20 cm above the table."""
    offset = rng.uniform(-PILE_SPREAD_M, PILE_SPREAD_M, size=2)
    R_WO = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    item = station.objects[index]
    return _around_middle(item, R_WO, _above_table(station, offset, DROP_HEIGHT_M))


def _above_table(station: HandStation, offset: Array, height_m: float) -> Array:
    return station.config.layout.workspace.p_WCenter + np.append(offset, height_m)


def _around_middle(item: RigidObject, R_WO: Array, p_WMiddle: Array) -> Array:
    """Return X_WO (4, 4) that puts the middle of the object's bounding box in O at p_WMiddle."""
    return make_pose(R_WO, p_WMiddle - R_WO @ item.mesh.bounds.mean(axis=0))


def _overlaps(station: HandStation, truth: Truth, index: int) -> bool:
    """Return whether an object overlaps with anything on the table or around it."""
    names = {station.objects[other].name for other in station.present if other != index}
    return truth.penetration_m({*names, TABLE_BODY, FENCE_BODY, *HAND_BODIES}, index) > 0.0
