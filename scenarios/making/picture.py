"""Moments of a recording: `python -m scenarios.making.picture RECORDING.html --out FILE.png`.

Needs the development packages, and Chromium (Debian's package `chromium`).
"""

import io
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from split_drake.bad_input import require_numbers
from split_drake.experiments.command import run_command
from split_drake.files import MissingFileError

# Software rendering, and no connection to anywhere.
BROWSER_FLAGS = (
    "--no-sandbox",
    "--use-gl=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
)
_LOAD_MS = 3000
# The viewer's own menu, and what recordings lay over the scene.
_HIDDEN = ".dg, #told, #legend, #controls { display: none !important }"
# The view stays where it is, whatever the hand does.
_NOT_FOLLOWING = "() => { document.getElementById('follow').checked = false; }"
_FRAME_MS = 1000


@dataclass(frozen=True)
class PictureOptions:
    """Which moments of which recording.

    Attributes:
        recording: a page that mug_hang wrote.
        out: PNG file.
        moments: of the recording, each from 0 (its start) to 1 (its end).
        size_px: width and height of one moment.
    """

    recording: Annotated[Path, tyro.conf.Positional]
    out: Path
    moments: tuple[float, ...] = (0.0, 0.25, 1.0)
    size_px: tuple[int, int] = (480, 420)

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        if not self.moments or min(self.moments) < 0.0 or max(self.moments) > 1.0:
            raise ValueError(f"moments are {self.moments}; expected numbers from 0 to 1")
        if not self.recording.is_file():
            raise ValueError(f"there is no recording {self.recording}")


def find_chromium() -> str:
    """Return where Chromium is; MissingFileError says how to install it."""
    chromium = shutil.which("chromium")
    if chromium is None:
        raise MissingFileError("there is no chromium; run: sudo apt-get install -y chromium")
    return chromium


def _capture(page: Page, moment: float) -> Image.Image:
    """Return what the page shows at a moment of its animation."""
    page.evaluate(
        "moment => { const animator = viewer.animator; animator.pause();"
        " animator.seek(moment * animator.duration); viewer.set_dirty(); }",
        moment,
    )
    page.wait_for_timeout(_FRAME_MS)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def capture_moments(options: PictureOptions) -> list[Image.Image]:
    """Return the pictures of the moments; raise MissingFileError without Chromium."""
    chromium = find_chromium()
    width, height = options.size_px
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=list(BROWSER_FLAGS))
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(options.recording.resolve().as_uri())
        page.wait_for_timeout(_LOAD_MS)
        page.evaluate(_NOT_FOLLOWING)
        page.add_style_tag(content=_HIDDEN)
        pictures = [_capture(page, moment) for moment in options.moments]
        browser.close()
    return pictures


def main(options: PictureOptions) -> None:
    """Write the picture."""
    pictures = capture_moments(options)
    width, height = options.size_px
    sheet = Image.new("RGB", (width * len(pictures), height))
    for column, picture in enumerate(pictures):
        sheet.paste(picture, (column * width, 0))
    sheet.save(options.out, optimize=True)


if __name__ == "__main__":
    run_command(main, PictureOptions, __doc__)
