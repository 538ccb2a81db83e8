"""A page as it looks on a desk and on a phone: ``python -m scenarios.making.page_picture PAGE``.

Needs the development packages, and Chromium (Debian's package `chromium`).
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from scenarios.making.picture import BROWSER_FLAGS, find_chromium
from split_drake.bad_input import BadInputError, require_count, require_numbers
from split_drake.experiments.command import run_command

DESKTOP_PX, PHONE_PX = (1180, 900), (390, 900)
_GAP_PX = 12


@dataclass(frozen=True)
class PagePictureOptions:
    """Which page.

    Attributes:
        page: HTML file.
        out: PNG file.
        rows: how many of the table's rows are opened, from the first on.
        phone: draw it beside as a phone shows it.
        wait_ms: before it is drawn.
    """

    page: Annotated[Path, tyro.conf.Positional]
    out: Path
    rows: int = 0
    phone: bool = True
    wait_ms: int = 1000

    def __post_init__(self) -> None:
        require_numbers(self)
        require_count("--rows", self.rows)
        require_count("--wait-ms", self.wait_ms)
        if not self.page.is_file():
            raise BadInputError(f"there is no page {self.page}")


def _shown(browser: Browser, options: PagePictureOptions, size_px: tuple[int, int]) -> Image.Image:
    page = browser.new_page(viewport={"width": size_px[0], "height": size_px[1]})
    page.goto(options.page.resolve().as_uri())
    page.wait_for_timeout(options.wait_ms)
    rows = page.locator("tr.row")
    for number in range(min(options.rows, rows.count())):
        rows.nth(number).click()
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    page.close()
    return picture


def main(options: PagePictureOptions) -> None:
    """Write the picture."""
    sizes = [DESKTOP_PX, PHONE_PX] if options.phone else [DESKTOP_PX]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=find_chromium(), args=list(BROWSER_FLAGS)
        )
        pictures = [_shown(browser, options, size) for size in sizes]
        browser.close()
    width = sum(picture.width for picture in pictures) + _GAP_PX * (len(pictures) - 1)
    sheet = Image.new("RGB", (width, max(picture.height for picture in pictures)), (200, 200, 200))
    at = 0
    for picture in pictures:
        sheet.paste(picture, (at, 0))
        at += picture.width + _GAP_PX
    sheet.save(options.out, optimize=True)


if __name__ == "__main__":
    run_command(main, PagePictureOptions, __doc__)
