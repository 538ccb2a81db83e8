"""Pictures of moments that a trial went through."""

from pathlib import Path

import numpy as np
from PIL import Image

from scenarios.viewing.film import FRAMES_PER_SECOND, Film
from split_drake.objects.mugs.split import load_mug
from split_drake.poses import make_pose
from split_drake.station.station import Station
from split_drake.truth.state import Truth
from tests.helpers.stations import STATION


def test_moments_are_drawn_afterwards(tmp_path: Path) -> None:
    station = Station(STATION, [load_mug("test_001").body])
    film = Film(station)
    X_WOs = [make_pose(p=(0.45, y, 0.0)) for y in (-0.1, 0.1)]
    station.place_object(0, X_WOs[0])
    first_s = film.mark()
    station.advance(0.1)
    film.note()  # too soon after the last
    station.advance(1.0 / FRAMES_PER_SECOND)
    station.place_object(0, X_WOs[1])
    last_s = film.mark()
    before = Truth(station).X_WO()
    for name, time_s in (("first", first_s), ("last", last_s)):
        film.save_still(tmp_path / "stills" / f"{name}.webp", time_s)
    pictures = [
        np.asarray(Image.open(tmp_path / "stills" / f"{name}.webp").convert("RGB"), dtype=float)
        for name in ("first", "last")
    ]
    assert pictures[0].shape == pictures[1].shape == (360, 480, 3)
    moved = np.abs(pictures[0] - pictures[1]).max(axis=2) > 60.0
    assert 100 < moved.sum() < 20_000, "the mug is elsewhere, and all else is not"
    film.save(tmp_path / "film.webp")
    with Image.open(tmp_path / "film.webp") as animated:
        assert getattr(animated, "n_frames", 1) == 2
    assert np.array_equal(Truth(station).X_WO(), before), "the station stands as it did"
