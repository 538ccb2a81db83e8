"""Draws the Panda's links: `python -m models.panda_meshes` writes models/panda/*.obj.

Each part is the convex hull of a few rounded discs and boxes, given in its link's frame, metres.
White parts are the link's shell, dark ones the joint's caps, rings and the flange.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]

_FOLDER = Path(__file__).parent / "panda"
_SIDES = 28
_FILLET_STEPS = 3


@dataclass(frozen=True)
class Surface:
    """Points (N, 3) on a convex surface with their outward normals (N, 3), triangles (M, 3)."""

    points: Array
    normals: Array
    triangles: NDArray[np.int64]

    @classmethod
    def hull(cls, *parts: Self) -> Self:
        """Return the convex hull: where it touches a smooth part, it has that part's normal."""
        points = np.concatenate([part.points for part in parts])
        normals = np.concatenate([part.normals for part in parts])
        convex = ConvexHull(points)
        a, b, c = (points[convex.simplices[:, k]] for k in range(3))
        inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), convex.equations[:, :3]) < 0.0
        triangles = convex.simplices.copy()
        triangles[inward] = triangles[inward, ::-1]
        used, renumbered = np.unique(triangles, return_inverse=True)
        return cls(points[used], normals[used], renumbered.reshape(-1, 3))

    def mirrored_y(self) -> Self:
        """Return the surface with y negated."""
        mirror = np.array([1.0, -1.0, 1.0])
        return type(self)(self.points * mirror, self.normals * mirror, self.triangles[:, ::-1])


def disc(
    center: ArrayLike, axis: str, radius: float, half: float, fillet: float = 0.012
) -> Surface:
    """Return a disc with rounded edges, `half` thick to both sides of `center` along `axis`."""
    turn = np.linspace(0.0, 2.0 * np.pi, _SIDES, endpoint=False)[:, None]
    bend = np.linspace(0.0, np.pi / 2.0, _FILLET_STEPS)
    bend = np.concatenate([-bend[::-1], bend])
    fillet = min(fillet, half, radius)
    outward = np.stack(np.broadcast_arrays(np.cos(turn), np.sin(turn), 0.0), axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    normals = np.cos(bend)[:, None] * outward + np.sin(bend)[:, None] * up
    flat = np.sign(np.arange(len(bend)) - _FILLET_STEPS + 0.5)[:, None]
    points = (radius - fillet) * outward + (half - fillet) * flat * up + fillet * normals
    to_axis = {"x": (2, 0, 1), "y": (1, 2, 0), "z": (0, 1, 2)}[axis]
    return _cloud(
        points.reshape(-1, 3)[:, to_axis] + np.asarray(center, float),
        normals.reshape(-1, 3)[:, to_axis],
    )


def box(lower: ArrayLike, upper: ArrayLike, fillet: float) -> Surface:
    """Return a box with rounded edges."""
    ball = trimesh.creation.icosphere(subdivisions=2).vertices
    low, high = np.asarray(lower, float) + fillet, np.asarray(upper, float) - fillet
    corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 1, 3)
    normals = np.broadcast_to(ball, (8, *ball.shape))
    return _cloud((corners + fillet * ball).reshape(-1, 3), normals.reshape(-1, 3))


def _cloud(points: Array, normals: Array) -> Surface:
    return Surface(points, normals, np.empty((0, 3), dtype=np.int64))


hull = Surface.hull


def barrel(radius: float) -> Surface:
    """Return the housing of a joint that turns about z of its link."""
    return hull(disc((0, 0, 0), "z", radius, 0.064))


def caps(radius: float) -> Surface:
    """Return the two dark covers of a barrel, as one disc that shows at both ends."""
    return hull(disc((0, 0, 0), "z", radius, 0.067, fillet=0.003))


def ring(z: float, radius: float, half: float = 0.004) -> Surface:
    """Return the dark gap between two links that turn against each other about z."""
    return hull(disc((0, 0, z), "z", radius, half, fillet=0.001))


def arm_parts() -> dict[str, list[Surface]]:
    """Return the parts of the arm's links by the names of their files."""
    return {
        "link0_white": [
            hull(
                disc((0, 0, 0.068), "z", 0.066, 0.068),
                disc((-0.09, 0, 0.04), "z", 0.062, 0.04),
                disc((0, 0, 0.03), "z", 0.088, 0.03),
            )
        ],
        "link0_dark": [ring(0.138, 0.058)],
        "link1_white": [
            hull(disc((0, 0, -0.165), "z", 0.06, 0.026), disc((0, 0, -0.01), "y", 0.056, 0.048))
        ],
        "link2_white": [
            barrel(0.06),
            hull(disc((0, 0, 0), "z", 0.056, 0.05), disc((0, -0.13, 0), "y", 0.058, 0.024)),
        ],
        "link2_dark": [caps(0.046), hull(disc((0, -0.157, 0), "y", 0.052, 0.004, 0.001))],
        "link3_white": [
            hull(disc((0, 0, -0.134), "z", 0.058, 0.022), disc((0.0825, 0, 0), "y", 0.05, 0.046))
        ],
        "link4_white": [
            barrel(0.058),
            hull(disc((0, 0, 0), "z", 0.054, 0.05), disc((-0.0825, 0.1, 0), "y", 0.056, 0.022)),
        ],
        "link4_dark": [caps(0.044), hull(disc((-0.0825, 0.125, 0), "y", 0.05, 0.004, 0.001))],
        "link5_white": [
            hull(
                disc((0, 0, -0.232), "z", 0.056, 0.022),
                disc((0, 0.074, -0.16), "z", 0.03, 0.06),
                disc((0, 0.03, -0.02), "y", 0.04, 0.05),
            ),
            hull(disc((0, 0.005, 0), "y", 0.046, 0.05)),
        ],
        "link6_white": [
            hull(disc((0, 0, 0), "z", 0.05, 0.062)),
            hull(disc((0, 0, 0), "z", 0.047, 0.036), disc((0.088, -0.005, 0), "y", 0.042, 0.046)),
        ],
        "link6_dark": [
            hull(disc((0, 0, 0), "z", 0.038, 0.065, 0.003)),
            hull(disc((0.088, 0.041, 0), "y", 0.032, 0.004, 0.002)),
        ],
        "link7_white": [hull(disc((0, 0, 0.076), "z", 0.044, 0.02))],
        "link7_dark": [ring(0.053, 0.04), ring(0.1, 0.034, half=0.008)],
    }


def hand_parts() -> dict[str, list[Surface]]:
    """Return the parts of the hand and its fingers by the names of their files."""
    parts = {
        "hand_white": [
            hull(
                box((-0.025, -0.1, 0.02), (0.025, 0.1, 0.058), fillet=0.01),
                box((-0.025, -0.072, 0.0), (0.025, 0.072, 0.04), fillet=0.01),
            )
        ],
        "hand_dark": [hull(box((-0.016, -0.09, 0.05), (0.016, 0.09, 0.064), fillet=0.002))],
    }
    finger = [
        hull(box((-0.009, 0.009, 0.0), (0.009, 0.021, 0.036), fillet=0.002)),
        hull(
            box((-0.009, 0.002, 0.034), (0.009, 0.014, 0.056), fillet=0.002),
            box((-0.009, 0.009, 0.026), (0.009, 0.020, 0.032), fillet=0.002),
        ),
    ]
    parts["finger_left"] = finger
    parts["finger_right"] = [part.mirrored_y() for part in finger]
    return parts


def write_obj(path: Path, parts: list[Surface]) -> None:
    """Write the parts as one OBJ file with normals."""
    points = np.concatenate([part.points for part in parts])
    normals = np.concatenate([part.normals for part in parts])
    starts = np.cumsum([0] + [len(part.points) for part in parts[:-1]])
    triangles = [p.triangles + start + 1 for p, start in zip(parts, starts, strict=True)]
    lines = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in points]
    lines += [f"vn {x:.3f} {y:.3f} {z:.3f}" for x, y, z in normals]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in np.concatenate(triangles)]
    path.write_text("\n".join(lines) + "\n")


def main() -> None:
    """Write all parts."""
    for name, parts in (arm_parts() | hand_parts()).items():
        write_obj(_FOLDER / f"{name}.obj", parts)


if __name__ == "__main__":
    main()
