"""Views of simple solids on the table."""

from collections.abc import Sequence

import numpy as np

from split_drake.camera import DepthView, Intrinsics, look_at
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import CameraPlacement, Layout, two_views
from tests.split_drake.station.solids import solids, stand


def views(
    *places: tuple[int, float, float], cameras: Sequence[CameraPlacement] = ()
) -> tuple[DepthView, ...]:
    """Return views, two where no cameras are given, of solids (index, x, y) on the table."""
    layout = Layout()
    station = HandStation(solids(), layout)
    for index, x, y in places:
        stand(station, index, x, y)
    return station.capture(cameras or two_views(layout.workspace))


def side_view() -> CameraPlacement:
    """Return the camera that GIGA was trained with: 0.6 m away, 60 degrees from the vertical."""
    p_WTarget = np.add(Layout().workspace.p_WCenter, (0.0, 0.0, 0.05))
    away = np.array([0.0, -np.sin(np.radians(60.0)), np.cos(np.radians(60.0))])
    X_WC = look_at(np.add(p_WTarget, 0.6 * away), p_WTarget)
    return CameraPlacement("side", Intrinsics.centered(640, 480, 540.0), X_WC)
