"""Pictures of a trial, drawn after it: how it stood at moments that are worth a look.

The station's state is noted while the trial goes on, which costs next to nothing, and drawn once
it is known what became of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from scenarios.viewing.recording import Viewpoint
from split_drake.camera import Intrinsics, look_at
from split_drake.files import write_atomically
from split_drake.poses import Array
from split_drake.station.station import Station
from split_drake.truth.snapshots import restored, snapshot, stand_as

# Of a film of a failure.
FRAMES_PER_SECOND, SPEED = 4.0, 2.0
INTRINSICS = Intrinsics.centered(480, 360, focal_px=420.0)
_QUALITY, _FILM_QUALITY = 80, 55
_FILM_SIZE = (320, 240)


@dataclass(frozen=True)
class Frame:
    """How the station stood.

    Attributes:
        time_s: of the simulation.
        positions: see `split_drake.truth.snapshots`.
    """

    time_s: float
    positions: Array


class Film:
    """What a station looked like over time.

    Args:
        station: whose state is noted.
        viewpoint: where it is seen from.
    """

    def __init__(self, station: Station, viewpoint: Viewpoint | None = None) -> None:
        self._station = station
        eye = viewpoint or Viewpoint()
        self._X_WC = look_at(np.array(eye.p_WC), np.array(eye.p_WTarget))
        self._frames: list[Frame] = []

    def note(self) -> None:
        """Keep how the station stands, where enough time has passed since it was kept last."""
        time_s = self._station.time_s
        if not self._frames or time_s - self._frames[-1].time_s >= 1.0 / FRAMES_PER_SECOND - 1e-9:
            self._keep(time_s)

    def mark(self) -> float:
        """Keep how the station stands now; return the time, which `still` finds it by."""
        self._keep(self._station.time_s)
        return self._station.time_s

    def _keep(self, time_s: float) -> None:
        self._frames.append(Frame(time_s, snapshot(self._station)))

    def save_still(self, path: Path, time_s: float) -> None:
        """Write a picture of the frame that is nearest to a time, as WebP."""
        nearest = min(self._frames, key=lambda frame: abs(frame.time_s - time_s))
        (image,) = self._drawn([nearest])
        _save(path, [Image.fromarray(image)], _QUALITY)

    def save(self, path: Path) -> None:
        """Write all frames as an animated WebP, `SPEED` times as fast as it was."""
        drawn = [Image.fromarray(image).resize(_FILM_SIZE) for image in self._drawn(self._frames)]
        _save(path, drawn, _FILM_QUALITY)

    def _drawn(self, frames: Sequence[Frame]) -> list[NDArray[np.uint8]]:
        """Return a picture of each frame; the station stands as it did afterwards."""
        pictures = []
        with restored(self._station):
            for frame in frames:
                stand_as(self._station, frame.positions)
                pictures.append(self._station.photograph(INTRINSICS, self._X_WC))
        return pictures


def _save(path: Path, images: Sequence[Image.Image], quality: int) -> None:
    buffer = BytesIO()
    duration_ms = round(1000.0 / (FRAMES_PER_SECOND * SPEED))
    more = {"append_images": images[1:], "duration": duration_ms, "loop": 0}
    images[0].save(
        buffer, "WEBP", quality=quality, save_all=len(images) > 1, **(more if images[1:] else {})
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, buffer.getvalue())
