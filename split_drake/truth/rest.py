"""When an object has come to rest."""

import numpy as np

from split_drake.poses import Array, rotation_error_rad
from split_drake.station.station import Station
from split_drake.truth.state import Truth

# At rest: moved and turned by no more than this within REST_S.
REST_S = 0.2
REST_DISTANCE_M = 0.0005
REST_TURN_RAD = np.radians(0.3)
WATCH_STEP_S = 0.01


def wait_for_rest(station: Station, truth: Truth, index: int, timeout_s: float) -> bool:
    """Simulate until object `index` has kept its place for 0.2 s; False after `timeout_s`.

    Places are compared, not speeds: at rest on an edge, contact points take turns, and the speed
    shows their chatter.
    """
    deadline_s = station.time_s + timeout_s
    X_WStart, since_s = truth.X_WO(index), station.time_s
    while station.time_s < deadline_s:
        station.advance(WATCH_STEP_S)
        X_WO = truth.X_WO(index)
        if _moved(X_WStart, X_WO):
            X_WStart, since_s = X_WO, station.time_s
        elif station.time_s - since_s >= REST_S - 1e-9:
            return True
    return False


def _moved(X_WA: Array, X_WB: Array) -> bool:
    distance_m = np.linalg.norm(X_WA[:3, 3] - X_WB[:3, 3])
    turn_rad = rotation_error_rad(X_WA[:3, :3], X_WB[:3, :3])
    return bool(distance_m > REST_DISTANCE_M or turn_rad > REST_TURN_RAD)


def axis_tilt_rad(X_WO: Array) -> float:
    """Return the angle between z_O and the upward vertical: 0 upright, pi upside down."""
    return float(np.arccos(np.clip(X_WO[2, 2], -1.0, 1.0)))
