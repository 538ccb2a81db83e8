"""Counting which points of a cloud lie on a mug's handle, from the mug's mesh alone."""

import numpy as np
import trimesh
from scipy.ndimage import maximum_filter1d

from split_drake.objects.ray_caster import RayCaster
from split_drake.poses import Array, invert_pose, transform_points

# Points this far outside the body lie on the handle.
HANDLE_MARGIN_M = 0.002
# The handle, towards +x of O, does not reach around the body further than this.
HANDLE_AZIMUTH_RAD = np.radians(60.0)
ROWS = 160
AZIMUTHS = 36
SURFACE_POINTS = 6000
# As many points of the handle's surface say how much of it a camera sees.
SEEN_POINTS = 200
SEEN_TOLERANCE_M = 0.001


class HandlePoints:
    """Tells points on a mug's handle from points on its body; O has z up and x to the handle.

    The body's outer radius is measured at `ROWS` heights, by rays towards the axis from all sides
    but the handle's.  The handle is what lies further out, within a box around that part of the
    mesh, so that no point of the table counts.

    Raises ValueError where nothing of the mesh sticks out of the body.
    """

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._caster = RayCaster(mesh)
        low, high = mesh.bounds[:, 2]
        self._heights_m = low + (np.arange(ROWS) + 0.5) / ROWS * (high - low)
        self._radii_m = _body_radii(mesh, self._caster, self._heights_m)
        p_OSurface, _ = trimesh.sample.sample_surface(mesh, SURFACE_POINTS, seed=0)
        p_OHandle = p_OSurface[self._outside(p_OSurface)]
        if not len(p_OHandle):
            raise ValueError(
                f"nothing of the mesh lies more than {HANDLE_MARGIN_M} m outside its body "
                f"of {self._radii_m.max():.4f} m radius; expected a handle towards +x"
            )
        self._p_OSeens = p_OHandle[:SEEN_POINTS]
        self._lower = p_OHandle.min(axis=0) - HANDLE_MARGIN_M
        self._upper = p_OHandle.max(axis=0) + HANDLE_MARGIN_M

    def count(self, X_WO: Array, p_WPs: Array) -> int:
        """Return how many of the points (N, 3) lie on the handle of the mug at X_WO (4, 4)."""
        p_OPs = transform_points(invert_pose(X_WO), p_WPs)
        boxed = np.all((p_OPs > self._lower) & (p_OPs < self._upper), axis=1)
        return int(self._outside(p_OPs[boxed]).sum())

    def seen_share(self, X_WO: Array, p_WC: Array) -> float:
        """Return the share of the handle's surface that is seen from `p_WC` (3,), the mug at X_WO.

        What faces away counts as well, so that the share stays far below 1.
        """
        p_OC = transform_points(invert_pose(X_WO), p_WC[None])[0]
        d_Os = self._p_OSeens - p_OC
        shares, _ = self._caster.cast(p_OC, d_Os)
        hidden_m = (1.0 - shares) * np.linalg.norm(d_Os, axis=1)
        return float((hidden_m < SEEN_TOLERANCE_M).mean())

    def _outside(self, p_OPs: Array) -> Array:
        """Return (N,): whether points (N, 3) lie outside the body on the handle's side."""
        x, y, z = p_OPs.T
        radius_m = np.interp(z, self._heights_m, self._radii_m) + HANDLE_MARGIN_M
        return (np.hypot(x, y) > radius_m) & (np.abs(np.arctan2(y, x)) < HANDLE_AZIMUTH_RAD)


def _body_radii(mesh: trimesh.Trimesh, caster: RayCaster, heights_m: Array) -> Array:
    """Return (N,) the body's largest outer radius about each of the heights (N,) of O, metres."""
    start_m = 2.0 * float(np.abs(mesh.bounds[:, :2]).max())
    azimuths = np.linspace(HANDLE_AZIMUTH_RAD, 2.0 * np.pi - HANDLE_AZIMUTH_RAD, AZIMUTHS)
    outward = np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(AZIMUTHS)])
    p_OStarts = np.tile(start_m * outward, (len(heights_m), 1))
    p_OStarts[:, 2] = np.repeat(heights_m, AZIMUTHS)
    distances, _ = caster.cast(p_OStarts, np.tile(-outward, (len(heights_m), 1)))
    radii = np.maximum(start_m - distances, 0.0).reshape(-1, AZIMUTHS).max(axis=1)
    # Where the profile turns abruptly, as at a foot, the wider of neighbouring rows holds.
    return np.asarray(maximum_filter1d(radii, 3), dtype=float)
