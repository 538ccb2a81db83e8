"""Other things that stand on the table beside the object that a trial is about."""

from collections.abc import Sequence

import numpy as np
import shapely

from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array, make_pose, rotation_z, transform_points
from split_drake.scene import Workspace
from split_drake.station.station import Station
from split_drake.truth.rest import wait_for_rest
from split_drake.truth.starts import SETTLE_TIMEOUT_S, NoStartError
from split_drake.truth.state import Truth

# Things stand at least so far apart, seen from above: room for a finger.
GAP_M = 0.03
# From the workspace's border.
MARGIN_M = 0.01
PLACES = 200
_ABOVE_M = 0.0005


def stand_beside(
    station: Station, truth: Truth, indices: Sequence[int], rng: np.random.Generator
) -> None:
    """Stand objects on free places of the workspace, one after the other; they come as parked.

    Raises NoStartError where there is no place for one, or it does not stand.
    """
    for index in indices:
        station.park_object(index)
    for index in indices:
        item, table = station.objects[index], station.config.layout.workspace
        taken = [_footprint(station.objects[i], truth.X_WO(i)) for i in station.present]
        station.place_object(index, _free_place(item, table, taken, rng))
        if not wait_for_rest(station, truth, index, SETTLE_TIMEOUT_S):
            raise NoStartError(item.name, ["it does not stand"])


def _free_place(
    item: RigidObject, table: Workspace, taken: Sequence[shapely.Geometry], rng: np.random.Generator
) -> Array:
    """Return X_WO (4, 4) of an object that stands in the workspace, away from all that is there."""
    half = table.edge_m / 2.0 - MARGIN_M
    room = shapely.box(*np.subtract(table.p_WCenter[:2], half), *np.add(table.p_WCenter[:2], half))
    for _ in range(PLACES):
        offset = np.append(rng.uniform(-half, half, 2), _ABOVE_M)
        X_WO = make_pose(rotation_z(rng.uniform(0.0, 2.0 * np.pi)), np.add(table.p_WCenter, offset))
        footprint = _footprint(item, X_WO)
        if room.contains(footprint) and all(footprint.distance(each) > GAP_M for each in taken):
            return X_WO
    raise NoStartError(item.name, [f"there is no room for it in {PLACES} places"])


def _footprint(item: RigidObject, X_WO: Array) -> shapely.Geometry:
    """Return the convex hull of an object as seen from above."""
    corners = transform_points(X_WO, item.mesh.vertices)[:, :2]
    with np.errstate(invalid="ignore"):  # the renderer leaves that flag of the processor set
        return shapely.MultiPoint(corners).convex_hull
