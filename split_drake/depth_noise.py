"""What real depth cameras do to a depth image: noise, steps, holes and flying pixels.

- The standard deviation of the depth has a constant part and one that grows with the square of the
  distance, as triangulation has it.  Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise for
  improved 3D reconstruction and tracking" (2012), measured 1.2 mm + 1.9 mm (z - 0.4 m)^2.
- Errors of neighbouring pixels are alike: stereo matches windows of pixels.
- Depth comes in steps, for disparity does: z^2 / (focal length x baseline) times the step in
  pixels (Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data", 2012).
- Surfaces seen at a grazing angle, and rims of what stands before something else, have holes.
- Some pixels at rims fly: they show a depth between the two sides (Sabov and Kruger,
  "Identification and correction of flying pixels in range camera data", 2008).
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from split_drake.camera import DepthView, pixel_rays
from split_drake.poses import Array

Mask = NDArray[np.bool_]


def with_normal_noise(
    depth_m: NDArray[np.float32], std_m: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return a depth image (H, W) with normal noise of each pixel; what saw nothing stays so."""
    noisy = depth_m + rng.normal(0.0, std_m, depth_m.shape)
    seen = (depth_m > 0.0) & np.isfinite(depth_m)
    return np.where(seen, np.maximum(noisy, 0.0), depth_m).astype(np.float32)


@dataclass(frozen=True)
class DepthNoise:
    """How a depth camera errs.

    Attributes:
        constant_m: standard deviation of the depth, whatever the distance.
        quadratic_per_m: what is added to it for each square metre of distance squared, m / m^2.
        correlation_px: standard deviation of the Gaussian that neighbours' errors are blurred by.
        step_per_m: steps of the depth at one metre, which grow with its square; 0 for none.
        max_incidence_rad: surfaces whose normal is further than this from the ray have holes.
        edge_jump_m: neighbours whose depths differ by more are a rim.
        edge_hole_share: of the pixels within `edge_px` of a rim that are holes.
        edge_px: how far a rim reaches.
        flying_share: of the pixels at a rim that show a depth between its sides.

    Raises ValueError where a number is negative or not finite, or a share above 1.
    """

    constant_m: float
    quadratic_per_m: float
    correlation_px: float
    step_per_m: float
    max_incidence_rad: float
    edge_jump_m: float
    edge_hole_share: float
    edge_px: int
    flying_share: float

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not 0.0 <= value < np.inf:
                raise ValueError(f"{entry.name} is {value}; expected a finite number >= 0")
        for name in ("edge_hole_share", "flying_share"):
            if getattr(self, name) > 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}; expected a share, at most 1")

    def seen(self, view: DepthView, rng: np.random.Generator) -> DepthView:
        """Return what the camera shows where a perfect one would show `view`; 0 where nothing."""
        depth = view.depth_m.astype(float)
        valid = (depth > 0.0) & np.isfinite(depth)
        depth[~valid] = 0.0
        rim = _rims(depth, valid, self.edge_jump_m)
        noisy = self._flown(depth, valid & rim, rng)
        noisy = self._stepped(noisy + self._errors(noisy, rng))
        lost = self._holes(depth, valid, rim, view, rng)
        noisy[~valid | lost | (noisy <= 0.0)] = 0.0
        return replace(view, depth_m=noisy.astype(np.float32))

    def _errors(self, depth: Array, rng: np.random.Generator) -> Array:
        """Return an error for every pixel, blurred and then as large as it shall be."""
        white = rng.normal(size=depth.shape)
        if self.correlation_px > 0.0:
            white = ndimage.gaussian_filter(white, self.correlation_px, mode="wrap")
            white /= white.std()
        return white * (self.constant_m + self.quadratic_per_m * depth**2)

    def _stepped(self, depth: Array) -> Array:
        """Return depths whose inverse is a multiple of `step_per_m`, as that of disparities is."""
        if self.step_per_m == 0.0:
            return depth
        disparity = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth > 0.0)
        whole = np.round(disparity / self.step_per_m) * self.step_per_m
        return np.divide(1.0, whole, out=np.zeros_like(depth), where=whole > 0.0)

    def _flown(self, depth: Array, rim: Mask, rng: np.random.Generator) -> Array:
        """Return the depths, with a share of those at rims somewhere between both sides."""
        near = ndimage.minimum_filter(np.where(depth > 0.0, depth, np.inf), size=3)
        far = ndimage.maximum_filter(depth, size=3)
        share = rng.uniform(size=depth.shape)
        flying = rim & (rng.uniform(size=depth.shape) < self.flying_share)
        flown = depth.copy()
        flown[flying] = near[flying] + share[flying] * (far[flying] - near[flying])
        return flown

    def _holes(
        self, depth: Array, valid: Mask, rim: Mask, view: DepthView, rng: np.random.Generator
    ) -> Mask:
        """Return which pixels show nothing."""
        wide = ndimage.binary_dilation(rim, iterations=self.edge_px) if self.edge_px else rim
        torn = wide & (rng.uniform(size=depth.shape) < self.edge_hole_share)
        return torn | (valid & ~rim & (_incidence(depth, view) > self.max_incidence_rad))


def _rims(depth: Array, valid: Mask, jump_m: float) -> Mask:
    """Return the pixels beside which the depth jumps."""
    near = ndimage.minimum_filter(np.where(valid, depth, np.inf), size=3)
    far = ndimage.maximum_filter(np.where(valid, depth, -np.inf), size=3)
    return valid & (far - near > jump_m)


def _incidence(depth: Array, view: DepthView) -> Array:
    """Return the angle between each pixel's ray and the surface's normal, rad."""
    rays = pixel_rays(view.intrinsics).astype(float)
    p_CPs = rays * depth[..., None]
    down, right = np.gradient(p_CPs, axis=0), np.gradient(p_CPs, axis=1)
    normals = np.cross(right, down)
    lengths = np.linalg.norm(normals, axis=-1) * np.linalg.norm(rays, axis=-1)
    cosines = np.abs(np.einsum("hwi,hwi->hw", normals, rays))
    ratio = np.divide(cosines, lengths, out=np.ones_like(cosines), where=lengths > 0.0)
    return np.arccos(np.clip(ratio, 0.0, 1.0))


DepthNoiseLevel = Literal["none", "low", "middle", "high"]
_MIDDLE = DepthNoise(
    constant_m=0.001,
    quadratic_per_m=0.002,
    correlation_px=1.0,
    step_per_m=0.002,
    max_incidence_rad=float(np.radians(80.0)),
    edge_jump_m=0.01,
    edge_hole_share=0.3,
    edge_px=1,
    flying_share=0.1,
)
# By name: a short-range stereo camera, a Kinect or one like it, and one that is worse by far.
DEPTH_NOISE: Mapping[DepthNoiseLevel, DepthNoise | None] = {
    "none": None,
    "low": replace(
        _MIDDLE, constant_m=0.0003, quadratic_per_m=0.001, step_per_m=0.0005, flying_share=0.03
    ),
    "middle": _MIDDLE,
    "high": replace(
        _MIDDLE, constant_m=0.003, quadratic_per_m=0.006, step_per_m=0.005, flying_share=0.3
    ),
}
