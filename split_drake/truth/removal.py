"""What is left in the workspace of a clutter round, and what is lost.

Of VGN's protocol (arXiv 2101.01132): after each grasp the object that was taken is removed, all
others come to rest, and those that left the cube are removed as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from split_drake.poses import Array, rotation_error_rad
from split_drake.robot.panda import FINGER_BODIES
from split_drake.scene import Workspace
from split_drake.station.hand.hand_station import HandStation
from split_drake.truth.state import AnyStation, Truth

# At rest: no faster than this, m/s and rad/s, on the average of a tenth of a second.  An object
# that touches another at a single point may rock on the spot, which the average leaves out.
REST_SPEED = 0.01
REST_TIMEOUT_S = 2.0
WATCH_STEP_S = 0.1


@dataclass(frozen=True)
class Removal:
    """What became of the objects of a round, by their indices.

    Attributes:
        taken: removed with the hand.
        lost: removed since they left the workspace.
        left: still there.
        rests: whether all of these came to rest in time.
    """

    taken: tuple[int, ...]
    lost: tuple[int, ...]
    left: tuple[int, ...]
    rests: bool


def clear_away(station: HandStation, truth: Truth, held: Sequence[str] = ()) -> Removal:
    """Remove what the hand holds, and the hand, then wait for rest and remove what is lost.

    Args:
        held: names of the objects that a successful grasp ended with.  One grasp takes one object:
            the one that overlaps with the hand's pads the deepest, the first of equals.  All that
            the hand held besides falls.

    Raises RuntimeError where Drake's contact solver fails.
    """
    taken = _most_firmly_held(station, truth, held)
    for index in taken:
        station.park_object(index)
    station.park_hand()
    rests, lost = wait_and_remove(station, truth)
    return Removal(taken, lost, station.present, rests)


def wait_and_remove(station: AnyStation, truth: Truth) -> tuple[bool, tuple[int, ...]]:
    """Wait for rest and remove what left the workspace, until nothing else did.

    Returns whether the rest came to rest, and the indices of what was removed.
    """
    lost: list[int] = []
    while True:
        rests = wait_for_all_to_rest(station, truth)
        gone = outside(station, truth)
        for index in gone:
            station.park_object(index)
        lost += gone
        if not gone:
            return rests, tuple(sorted(lost))


def wait_for_all_to_rest(
    station: AnyStation, truth: Truth, timeout_s: float = REST_TIMEOUT_S
) -> bool:
    """Simulate until every object on the table rests; False after `timeout_s`."""
    deadline_s = station.time_s + timeout_s
    before = _poses(station, truth)
    while station.time_s < deadline_s - 1e-9:
        station.advance(WATCH_STEP_S)
        now = _poses(station, truth)
        if not _moved(before, now):
            return True
        before = now
    return False


def outside(station: AnyStation, truth: Truth) -> list[int]:
    """Return the objects on the table whose centre of mass is beside the workspace's cube."""
    workspace = station.config.layout.workspace
    return [index for index in station.present if not in_cube(truth.p_WCom(index), workspace)]


def in_cube(p_WP: Array, workspace: Workspace) -> bool:
    """Return whether a point (3,) lies in the workspace's cube, above the table or within it."""
    p_VP = p_WP - workspace.p_WV
    return bool(np.all((p_VP >= 0.0) & (p_VP <= workspace.edge_m)))


def _poses(station: AnyStation, truth: Truth) -> Array:
    """Return X_WOs (N, 4, 4) of the objects on the table, each in its centre of mass."""
    X_WOs = np.zeros((len(station.present), 4, 4))
    for at, index in enumerate(station.present):
        X_WOs[at] = truth.X_WO(index)
        X_WOs[at, :3, 3] = truth.p_WCom(index)
    return X_WOs


def _moved(before: Array, now: Array) -> bool:
    """Return whether any of the objects (N, 4, 4) was faster than `REST_SPEED`."""
    distances_m = np.linalg.norm(now[:, :3, 3] - before[:, :3, 3], axis=1)
    turns_rad = rotation_error_rad(now[:, :3, :3], before[:, :3, :3])
    farthest = max(distances_m.max(initial=0.0), turns_rad.max(initial=0.0))
    return bool(farthest > REST_SPEED * WATCH_STEP_S)


def _most_firmly_held(station: HandStation, truth: Truth, held: Sequence[str]) -> tuple[int, ...]:
    """Return the index of the object among `held` that the pads press on most, if any."""
    indices = [index for index in station.present if station.objects[index].name in held]
    if not indices:
        return ()
    return (max(indices, key=lambda index: truth.penetration_m(FINGER_BODIES, index)),)
