"""Meshes of one mug as people have them: closed, open, doubled, thin, coarse, and so on."""

from collections.abc import Callable

import numpy as np
import trimesh

from split_drake.poses import Array, make_pose, rotation_x, rotation_z

HEIGHT_M, RADIUS_M, WALL_M = 0.09, 0.04, 0.004


def placed(mesh: trimesh.Trimesh, X: Array) -> trimesh.Trimesh:
    """Return a copy of a mesh at `X`."""
    moved = mesh.copy()
    moved.apply_transform(X)
    return moved


def scaled(mesh: trimesh.Trimesh, factor: float) -> trimesh.Trimesh:
    """Return a copy of a mesh, `factor` times as large."""
    return placed(mesh, np.diag([factor] * 3 + [1.0]))


def vessel(
    wall_m: float = WALL_M, sections: int = 48, height_m: float = HEIGHT_M
) -> trimesh.Trimesh:
    """Return a closed mesh of a cup with a cavity."""
    inner = RADIUS_M - wall_m
    outside = [[0.0, 0.0], [RADIUS_M, 0.0], [RADIUS_M, height_m]]
    inside = [[inner, height_m], [inner, wall_m], [0.0, wall_m]]
    return trimesh.creation.revolve(np.array(outside + inside), sections=sections)


def sheet(sections: int = 48) -> trimesh.Trimesh:
    """Return an open mesh of a cup whose wall is a single surface."""
    line = np.array([[0.0, 0.0], [RADIUS_M, 0.0], [RADIUS_M, HEIGHT_M]])
    return trimesh.creation.revolve(line, sections=sections)


def ring(sides: int = 32, around: int = 12, minor_m: float = 0.005) -> trimesh.Trimesh:
    """Return a ring that stands beside a cup as its handle, towards x."""
    torus = trimesh.creation.torus(0.022, minor_m, major_sections=sides, minor_sections=around)
    return placed(torus, make_pose(rotation_x(np.pi / 2.0), (0.044, 0.0, 0.045)))


def mug() -> trimesh.Trimesh:
    """Return a closed mug: a cup and the part of the ring that lies outside of its cavity."""
    cavity = trimesh.creation.cylinder(radius=RADIUS_M - WALL_M / 2.0, height=0.3)
    return trimesh.boolean.union([vessel(), trimesh.boolean.difference([ring(), cavity])])


def with_gaps(mesh: trimesh.Trimesh, share: float, seed: int = 0) -> trimesh.Trimesh:
    """Return a mesh without a random share of its faces."""
    some = mesh.copy()
    some.update_faces(np.random.default_rng(seed).random(len(some.faces)) >= share)
    return some


def doubled(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh with every face a second time, from its other side."""
    faces = np.vstack([mesh.faces, mesh.faces[:, ::-1]])
    return trimesh.Trimesh(mesh.vertices, faces, process=False)


def fine(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return mesh.subdivide().subdivide()


def join(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(meshes)


# What a person would call a mug, in metres with z up.
MUGS: dict[str, Callable[[], trimesh.Trimesh]] = {
    "closed": mug,
    "parts": lambda: join(vessel(), ring()),
    "doubled": lambda: doubled(mug()),
    "doubled parts": lambda: doubled(join(vessel(), ring())),
    "soup": lambda: trimesh.Trimesh(
        mug().triangles.reshape(-1, 3),
        np.arange(3 * len(mug().faces)).reshape(-1, 3),
        process=False,
    ),
    "sheet": lambda: join(sheet(), ring()),
    "doubled sheet": lambda: doubled(join(sheet(), ring())),
    "thin": lambda: join(vessel(wall_m=0.0004), ring()),
    "very thin": lambda: join(vessel(wall_m=2e-5), ring()),
    "low poly": lambda: join(vessel(sections=8), ring(8, 4)),
    "hexagonal": lambda: join(vessel(sections=6), ring(6, 4)),
    "inner wall": lambda: join(
        mug(), placed(vessel(wall_m=0.001), np.diag([0.94, 0.94, 0.98, 1.0]))
    ),
    "gaps 5%": lambda: with_gaps(fine(join(vessel(), ring())), 0.05),
    "gaps 15%": lambda: with_gaps(fine(join(vessel(), ring())), 0.15),
    "sheet with gaps": lambda: with_gaps(fine(join(sheet(), ring())), 0.05),
    "coarse gaps": lambda: with_gaps(join(vessel(), ring()), 0.03),
    "no bottom faces": lambda: no_faces_below(join(vessel(), ring()), 1e-3),
    "large gap": lambda: cut_window(join(vessel(), ring())),
    "espresso": lambda: scaled(mug(), 0.8),
    "turned": lambda: placed(mug(), make_pose(rotation_z(2.2), (0.3, -0.1, 0.4))),
}


def no_faces_below(mesh: trimesh.Trimesh, height_m: float) -> trimesh.Trimesh:
    """Return a mesh without the faces that lie below a height."""
    rest = mesh.copy()
    rest.update_faces(rest.triangles[:, :, 2].max(axis=1) > height_m)
    return rest


def cut_window(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh whose body lacks a piece of its side, opposite to the handle."""
    rest = fine(mesh)
    x, y, z = rest.triangles_center.T
    rest.update_faces(~((x < -0.02) & (np.abs(y) < 0.015) & (z > 0.05) & (z < 0.07)))
    return rest
