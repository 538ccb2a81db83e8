"""Drawing how an object lies on the table when a trial starts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from split_drake.objects.rigid import RigidObject
from split_drake.poses import Array, make_pose, transform_points
from split_drake.scene import Workspace
from split_drake.station.station import Station
from split_drake.truth.rest import axis_tilt_rad, wait_for_rest
from split_drake.truth.state import Truth

DROP_HEIGHT_M = 0.02
SPREAD_M = 0.03
SETTLE_TIMEOUT_S = 5.0

UPSIDE_DOWN_RAD = np.radians(120.0)
NEARLY_UPRIGHT_RAD = np.radians(30.0)

STILL_MOVING = "still moving"
OUTSIDE_WORKSPACE = "outside the workspace"
UPSIDE_DOWN = "upside down"
NEARLY_UPRIGHT = "nearly upright"


@dataclass(frozen=True)
class Start:
    """How an object lies.

    Attributes:
        X_WO: (4, 4) its pose.
        redraws: why each earlier draw was rejected.
    """

    X_WO: Array
    redraws: tuple[str, ...]


class NoStartError(RuntimeError):
    """No draw came to rest as wanted.

    Attributes:
        redraws: why each draw was rejected.
    """

    def __init__(self, name: str, redraws: Sequence[str]) -> None:
        reasons = ", ".join(sorted(set(redraws)))
        super().__init__(f"{len(redraws)} starts of {name} were all rejected: {reasons}")
        self.redraws = tuple(redraws)


def draw_start(
    station: Station,
    truth: Truth,
    rng: np.random.Generator,
    reject: Callable[[Array], str],
    index: int = 0,
    max_draws: int = 30,
) -> Start:
    """Drop object `index` until it comes to rest in the workspace as `reject` wants it.

    Args:
        reject: takes X_WO at rest and returns why to draw again, or an empty string.

    Raises NoStartError where `max_draws` draws were all rejected.
    """
    item, workspace = station.objects[index], station.config.layout.workspace
    redraws: list[str] = []
    while len(redraws) < max_draws:
        station.place_object(index, draw_drop(item, workspace, rng))
        rests = wait_for_rest(station, truth, index, SETTLE_TIMEOUT_S)
        X_WO = truth.X_WO(index)
        fault = "" if rests else STILL_MOVING
        fault = fault or outside_workspace(item, X_WO, workspace) or reject(X_WO)
        if not fault:
            return Start(X_WO, tuple(redraws))
        redraws.append(fault)
    raise NoStartError(item.name, redraws)


def draw_drop(item: RigidObject, workspace: Workspace, rng: np.random.Generator) -> Array:
    """Return X_WO (4, 4): any orientation, 2 cm above the table, near the workspace's centre."""
    R_WO = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    offset = np.append(rng.uniform(-SPREAD_M, SPREAD_M, size=2), 0.0)
    return drop_pose(item, R_WO, workspace.p_WCenter + offset)


def drop_pose(item: RigidObject, R_WO: Array, p_WT: Array) -> Array:
    """Return X_WO (4, 4): the middle of the object above p_WT on the table, 2 cm of air between."""
    lowest = float((item.mesh.vertices @ R_WO.T)[:, 2].min())
    middle = R_WO @ item.mesh.bounds.mean(axis=0)
    x, y, z = p_WT
    return make_pose(R_WO, (x - middle[0], y - middle[1], z + DROP_HEIGHT_M - lowest))


def outside_workspace(item: RigidObject, X_WO: Array, workspace: Workspace) -> str:
    """Return a fault where any part of the object is beside the workspace."""
    offsets = transform_points(X_WO, item.mesh.vertices) - workspace.p_WCenter
    beside = np.abs(offsets[:, :2]).max() > workspace.edge_m / 2.0
    return OUTSIDE_WORKSPACE if beside else ""


def reject_for_hang(X_WO: Array) -> str:
    """Return a fault where the mug lies upside down (as in the paper, section VI-B)."""
    return UPSIDE_DOWN if axis_tilt_rad(X_WO) > UPSIDE_DOWN_RAD else ""


def reject_for_reorient(X_WO: Array) -> str:
    """Return a fault where the mug lies upside down, or its axis is within 30 degrees of up."""
    nearly_upright = axis_tilt_rad(X_WO) < NEARLY_UPRIGHT_RAD
    return NEARLY_UPRIGHT if nearly_upright else reject_for_hang(X_WO)
