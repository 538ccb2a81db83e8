"""Depth images and masks from files."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from split_drake.bad_input import BadInputError, require_number
from split_drake.files import MissingFileError, interpreting

WHAT_DEPTH = "a depth image: a PNG or TIFF of 16 bits, a TIFF of floats, or an NPY array"
WHAT_MASK = "a mask: an image whose pixels are 0 where all is seen"
# What 16 bits end with marks pixels that were not seen.
_SATURATED = 65535
# Of a PNG, by what RealSense, Azure Kinect and most others write.
MILLIMETRE_M = 0.001


def read_depth(path: Path | str, unit_m: float = MILLIMETRE_M) -> NDArray[np.float32]:
    """Return the depth image (H, W) of a file, in metres; 0 where nothing was seen.

    Args:
        path: of a PNG, TIFF or NPY.
        unit_m: metres of one unit of an image of whole numbers.  Floats are metres already.

    Raises MissingFileError, and UnreadableFileError or BadInputError where it is no such image.
    """
    require_number("the unit of depth", unit_m, 1e-6, 1.0, "metres of one unit")
    path = Path(path)
    with interpreting(path, WHAT_DEPTH):
        image = _pixels(path, WHAT_DEPTH)
        if image.ndim != 2 or image.dtype.kind not in "iuf":
            raise BadInputError(
                f"{path} has shape {image.shape} and type {image.dtype}; expected (H, W) numbers: "
                "is it a picture in colour?"
            )
        if image.dtype == np.uint8:
            raise BadInputError(
                f"{path} has 8 bits a pixel; expected {WHAT_DEPTH}: is it a picture of depth?"
            )
        if image.dtype.kind == "f":
            with np.errstate(over="ignore"):
                metres = image.astype(np.float32)
            return np.where(np.isfinite(metres), metres, np.float32(0.0))
        counts = image.astype(np.float64)
        return np.where(counts == _SATURATED, 0.0, counts * unit_m).astype(np.float32)


def read_mask(path: Path | str) -> NDArray[np.bool_]:
    """Return (H, W) booleans, true where an image's pixels are not 0: what is to be left out.

    Raises MissingFileError, and UnreadableFileError or BadInputError where it is no such image.
    """
    path = Path(path)
    with interpreting(path, WHAT_MASK):
        image = _pixels(path, WHAT_MASK)
        if image.ndim == 3 and image.shape[2] in (3, 4):
            image = image[..., :3].max(axis=2)
        if image.ndim != 2 or image.dtype.kind not in "biu":
            raise BadInputError(
                f"{path} has shape {image.shape} and type {image.dtype}; expected {WHAT_MASK}"
            )
        return np.asarray(image != 0)


def _pixels(path: Path, what: str) -> NDArray[np.generic]:
    if not path.is_file():
        raise MissingFileError(f"there is no file {path}; expected {what}")
    # NumPy and Pillow raise errors of a dozen kinds where bytes are damaged.
    try:
        if path.suffix == ".npy":
            return np.asarray(np.load(path, allow_pickle=False))
        with Image.open(path) as image:
            return np.asarray(image)
    except Exception as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error
