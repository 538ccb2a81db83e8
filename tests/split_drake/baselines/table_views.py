"""Views of simple solids on the table."""

from split_drake.camera import DepthView
from split_drake.station.hand.hand_station import HandStation
from split_drake.station.layout import Layout, two_views
from tests.split_drake.station.solids import solids, stand


def views(*places: tuple[int, float, float]) -> tuple[DepthView, ...]:
    """Return two views of solids (index, x, y) on the table."""
    layout = Layout()
    station = HandStation(solids(), layout)
    for index, x, y in places:
        stand(station, index, x, y)
    return station.capture(two_views(layout.workspace))
