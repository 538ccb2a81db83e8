"""Say of every mesh of a folder whether it is a usable mug: `python -m scenarios.check_meshes DIR`.

A line a mesh: its size, mass and handle's opening, or why it is refused.  `--out FILE.png` draws
those that are usable.  The exit status is 1 where a mesh was refused.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from tyro.conf import Positional

from scenarios.trials.mug_check import MugCheck
from split_drake.bad_input import BadInputError, require_numbers
from split_drake.experiments.command import run_command
from split_drake.files import replacing
from split_drake.objects.convex_pieces import piece_mesh
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.procedural.sheet import draw
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.objects.scanned.usable import mug_verdicts
from split_drake.station.config import StationConfig
from split_drake.station.layout import Layout

_GREY, _BLUE = (0.75, 0.75, 0.72), (0.35, 0.55, 0.85)
# Two pictures a mug: its mesh, and what it collides as.
_PICTURES = (("mesh", _GREY), ("pieces", _BLUE))


@dataclass(frozen=True)
class CheckOptions:
    """Which meshes to check.

    Attributes:
        folder: of mesh files, or of folders of such.
        out: PNG file of the usable mugs, each as its mesh and as the pieces that it collides as;
            none by default.
        columns: mugs side by side in it.
        pixels: edge of a picture in it.
        workers: processes; what is said does not depend on them.
    """

    folder: Positional[Path]
    out: Path | None = None
    columns: int = 3
    pixels: int = 200
    workers: int = len(os.sched_getaffinity(0))

    def __post_init__(self) -> None:
        require_numbers(self, flags=True)
        for name in ("columns", "pixels", "workers"):
            if getattr(self, name) < 1:
                raise BadInputError(f"--{name} is {getattr(self, name)}; expected at least 1")
        if self.out is not None and self.out.suffix.lower() != ".png":
            raise BadInputError(f"--out is {self.out}; expected a file called .png")


def description(mug: MugShape, remarks: str) -> str:
    """Return what a mug measures, in one line."""
    x, y, z = 100.0 * mug.body.mesh.extents
    opening = np.ptp(mug.opening_OPs[:, [0, 2]], axis=0) * 100.0
    told = (
        f"{mug.name}: {x:.1f} x {y:.1f} x {z:.1f} cm, {1e3 * mug.body.mass_kg:.0f} g (assumed), "
        f"handle with an opening of {opening[0]:.1f} x {opening[1]:.1f} cm, "
        f"{len(mug.body.collision)} pieces"
    )
    return f"{told}; {remarks}" if remarks else told


def draw_mugs(mugs: Sequence[MugShape], out: Path, columns: int, pixels: int) -> None:
    """Write a picture of mugs, each as its mesh and as its collision pieces."""
    rows = -(-len(mugs) // columns)
    figure = Figure(figsize=(columns * 3.2, rows * 1.8))
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, mug in zip(axes, mugs, strict=False):
        body = mug.body
        meshes = {"mesh": [body.mesh], "pieces": [piece_mesh(piece) for piece in body.collision]}
        shown = [draw([(m, colour) for m in meshes[what]], pixels) for what, colour in _PICTURES]
        axis.imshow(np.hstack(shown))
        axis.set_title(mug.name, loc="left", fontsize=9)
    figure.tight_layout(pad=0.3)
    with replacing(out) as temporary:
        figure.savefig(temporary, dpi=pixels / 1.6, format="png")


def main(options: CheckOptions) -> None:
    """Print the lines, draw the mugs, and exit with 1 where a mesh was refused."""
    if not options.folder.is_dir():
        raise BadInputError(f"there is no folder {options.folder}; expected one of mesh files")
    console = Console()
    # A folder that is called as a fixed split is meant nevertheless.
    source = MugSource(str(options.folder.resolve()))
    trial = MugCheck(StationConfig(Layout()), None, options.folder)
    refused = len(source.unclear())
    for reason in source.unclear().values():
        console.print(f"refused: {reason}", markup=False, highlight=False, soft_wrap=True)
    mugs = []
    for verdict in mug_verdicts(source, options.workers, trial):
        if verdict.fault:
            refused += 1
            line = f"refused: {verdict.fault}"
        else:
            mugs.append(source.load(verdict.name))
            line = description(mugs[-1], verdict.remarks)
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    if options.out is not None and mugs:
        draw_mugs(mugs, options.out, options.columns, options.pixels)
        console.print(f"picture: {options.out}", markup=False, soft_wrap=True)
    if refused:
        raise SystemExit(1)


if __name__ == "__main__":
    run_command(main, CheckOptions, __doc__)
