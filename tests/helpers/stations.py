"""The station that tests work with."""

from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout

STATION = StationConfig(Layout())
