"""Mugs whatever their triangles, units and axes; folders as data sets and users lay them out."""

import struct
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from split_drake.objects.meshes.mass import mass_properties
from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.scanned import pieces
from split_drake.objects.scanned.build import build_mug, build_mug_from_mesh
from split_drake.objects.scanned.collision import fit_collision
from split_drake.objects.scanned.files import read_mug_file
from split_drake.objects.scanned.folder import find_mug_files
from split_drake.objects.scanned.profile import measure_profile
from split_drake.poses import make_pose, rotation_x
from tests.helpers.mug_meshes import (
    MUGS,
    RADIUS_M,
    doubled,
    join,
    mug,
    placed,
    ring,
    scaled,
    vessel,
)

Y_UP = make_pose(rotation_x(-np.pi / 2.0))
# Of these the wall, and so its radius, is coarser, or the mug smaller.
_LOOSE = {"low poly": 0.006, "hexagonal": 0.009, "espresso": 0.02}


@pytest.fixture(autouse=True)
def numpy_is_loud() -> Iterator[None]:
    """Fail where a measure divides by zero, or takes the median of nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


@pytest.mark.parametrize("kind", [kind for kind in MUGS if kind != "hexagonal"])
def test_all_of_these_are_mugs(kind: str) -> None:
    built = build_mug("mug", MUGS[kind]())
    shape, size = built.shape, 0.8 if kind == "espresso" else 1.0
    assert built.remarks == ()
    assert shape.outer_diameter_m == pytest.approx(2.0 * RADIUS_M, abs=_LOOSE.get(kind, 0.001))
    assert np.allclose(shape.X_OH[:3, 3], size * np.array([0.049, 0.0, 0.045]), atol=0.0015)
    assert np.hypot(*shape.body.p_OCom[:2]) < 0.008
    assert 0.03 * size < shape.body.p_OCom[2] < 0.045
    inertia = np.linalg.eigvalsh(shape.body.inertia_kg_m2)
    assert inertia[0] > 5e-5
    assert inertia[2] < inertia[0] + inertia[1]
    for piece in shape.body.collision:
        assert np.isfinite(piece.size).all()
        assert np.isfinite(piece.X_OP).all()


def test_doubling_faces_changes_no_mass() -> None:
    once, twice = (build_mug_from_mesh("mug", mesh).body for mesh in (mug(), doubled(mug())))
    assert np.allclose(once.p_OCom, twice.p_OCom, atol=1e-6)
    assert np.allclose(once.inertia_kg_m2, twice.inertia_kg_m2, atol=1e-8)
    # Whoever weighs a doubled mesh as it is gets a shell.
    p_OCom, inertia = mass_properties(doubled(mug()), 0.3)
    assert np.isfinite(p_OCom).all()
    assert np.linalg.eigvalsh(inertia)[0] > 0.0


def test_a_body_that_is_mostly_gone_is_refused_with_numbers() -> None:
    rest = vessel()
    rest = rest.subdivide().subdivide()
    rest.update_faces(rest.triangles_center[:, 2] < 0.03)
    floating = join(
        rest, ring(), placed(trimesh.creation.box((0.001,) * 3), make_pose(p=(0, 0, 0.09)))
    )
    with pytest.raises(InvalidMugError, match=r"open body: .*%.*, expected at (most|least)"):
        build_mug_from_mesh("mug", floating)


def test_a_tube_has_no_floor() -> None:
    tube = trimesh.creation.annulus(RADIUS_M - 0.004, RADIUS_M, 0.09)
    tube.apply_translation((0.0, 0.0, 0.045))
    with pytest.raises(InvalidMugError, match=r"no floor: .*, expected a cavity"):
        build_mug_from_mesh("mug", join(tube, ring()))


def test_profiles_hold_no_nan() -> None:
    mesh = MUGS["gaps 15%"]()
    profile = measure_profile(mesh)
    for values in (profile.outer_m, profile.wall_m, profile.floor_m, profile.height_m):
        assert np.isfinite(values).all()
    assert np.min(profile.wall_m) >= 0.0


def test_decomposition_takes_over_where_fitted_pieces_fail(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    mesh = MUGS["low poly"]()
    hulls = [trimesh.creation.box((0.07, 0.07, 0.09), make_pose(p=(0, 0, 0.045))).vertices]
    monkeypatch.setattr(pieces, "convex_hulls", lambda _mesh, _cache: hulls)
    monkeypatch.setattr(pieces, "CACHE", tmp_path)
    usual = fit_collision

    def too_wide(*args: object) -> object:
        return [piece.scaled(1.3) for piece in usual(*args)]  # type: ignore[arg-type]

    monkeypatch.setattr(pieces, "fit_collision", too_wide)
    with pytest.raises(InvalidMugError, match=r"unlike its pieces: .*; nor decomposed: unlike"):
        build_mug("mug", mesh)
    good = [pieces.piece_mesh(piece).vertices for piece in build_as_usual(mesh, usual, monkeypatch)]
    hulls[:] = good
    monkeypatch.setattr(pieces, "fit_collision", too_wide)
    built = build_mug("mug", mesh)
    assert "convex decomposition (unlike its pieces" in built.remarks[0]
    assert {piece.kind for piece in built.shape.body.collision} == {"convex"}


def build_as_usual(
    mesh: trimesh.Trimesh, fit: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> tuple[pieces.Primitive, ...]:
    monkeypatch.setattr(pieces, "fit_collision", fit)
    return build_mug("mug", mesh).shape.body.collision


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "glb"])
@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize(("unit", "factor"), [("metres", 1.0), ("millimetres", 1e3)])
def test_axes_and_units(suffix: str, up: str, unit: str, factor: float, tmp_path: Path) -> None:
    mesh = scaled(mug() if up == "z" else placed(mug(), Y_UP), factor)
    mesh.export(tmp_path / f"mug.{suffix}")
    read = read_mug_file(tmp_path / f"mug.{suffix}")
    assert np.allclose(read.shape.X_OH[:3, 3], (0.049, 0.0, 0.045), atol=0.0015)
    usual = "y" if suffix == "glb" else "z"
    expected = [] if unit == "metres" else [f"its units are taken for {unit}"]
    expected += [] if up == usual else [f"its {up} axis is taken for up"]
    assert list(read.remarks) == expected


def test_parts_of_a_scene_are_one_mug(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(placed(vessel(), Y_UP), node_name="body")
    scene.add_geometry(placed(ring(), Y_UP), node_name="handle")
    scene.export(tmp_path / "mug.glb")
    assert read_mug_file(tmp_path / "mug.glb").remarks == ()


def damaged_files() -> dict[str, bytes]:
    """Return {name: content} of files that are cut off, or whose heads lie."""
    stl, ply = (mug().export(file_type=kind) for kind in ("stl", "ply"))
    glb = trimesh.Scene(mug()).export(file_type="glb")
    return {
        "short.stl": stl[: len(stl) // 2],
        "head.stl": stl[:90],
        "count.stl": stl[:80] + struct.pack("<I", 2**31) + stl[84:],
        "noise.stl": bytes(range(128, 256)) * 3,
        "short.ply": ply[: len(ply) // 2],
        "head.ply": ply[:40],
        "count.ply": ply.replace(b"element face ", b"element face 9"),
        "short.glb": glb[: len(glb) // 2],
        "head.glb": b"nope" + glb[4:],
        "index.obj": b"v 0 0 0\nv 0 0 1\nv 0 1 0\nf 1 2 99\n",
        "words.obj": b"v a b c\nf 1 2 3\n",
        "points.ply": trimesh.PointCloud(mug().vertices).export(file_type="ply"),
        "nan.obj": b"v nan 0 0\nv 0 0 1\nv 0 1 0\nf 1 2 3\n",
    }


@pytest.mark.parametrize("name", damaged_files())
def test_damaged_files_are_refused_in_one_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(damaged_files()[name])
    with warnings.catch_warnings(), pytest.raises(InvalidMugError) as caught:
        warnings.simplefilter("ignore")
        read_mug_file(path)
    told = str(caught.value)
    assert str(path) in told
    assert "expected" in told
    assert "\n" not in told
    assert "module" not in told


LAYOUTS: dict[str, tuple[list[str], dict[str, str]]] = {
    "files": (["a.obj", "b.stl"], {"a": "a.obj", "b": "b.stl"}),
    "hidden": (["a.obj", "._a.obj", "__MACOSX/a.obj", ".git/b.obj"], {"a": "a.obj"}),
    "vgn": (
        ["a_visual.obj", "a_collision.obj", "b_visual.obj", "b_collision.obj"],
        {"a": "a_visual.obj", "b": "b_visual.obj"},
    ),
    "role folders": (
        ["visual/a.obj", "collision/a.obj", "visual/b.obj"],
        {"a": "visual/a.obj", "b": "visual/b.obj"},
    ),
    "ycb": (
        ["025_mug/google_16k/nontextured.stl", "025_mug/google_16k/textured.obj"],
        {"025_mug_google_16k": "025_mug/google_16k/textured.obj"},
    ),
    "gso": (["Red_Mug/meshes/model.obj"], {"Red_Mug": "Red_Mug/meshes/model.obj"}),
    "pieces": (
        ["cup/mesh.obj", "cup/mesh_vhacd_0.obj", "cup/mesh_vhacd_1.obj"],
        {"cup": "cup/mesh.obj"},
    ),
    "formats": (["cup/mug.stl", "cup/mug.obj", "cup/mug.glb"], {"cup": "cup/mug.obj"}),
    "collision alone": (["cup/mug_collision.obj"], {"cup": "cup/mug_collision.obj"}),
    "several": (["set/a.obj", "set/b.obj"], {"set_a": "set/a.obj", "set_b": "set/b.obj"}),
    "deep": (["x/y/z/mug.ply"], {"x_y_z": "x/y/z/mug.ply"}),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layouts_of_folders(layout: str, tmp_path: Path) -> None:
    files, expected = LAYOUTS[layout]
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
    found = find_mug_files(tmp_path)
    assert {n: str(p.relative_to(tmp_path)) for n, p in found.meshes.items()} == expected
    assert found.refused == {}


def test_of_two_mugs_of_one_name_the_second_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mug").mkdir()
    (tmp_path / "mug" / "a.obj").touch()
    (tmp_path / "mug.obj").touch()
    found = find_mug_files(tmp_path)
    assert found.meshes == {"mug": tmp_path / "mug.obj"}
    (reason,) = found.refused.values()
    assert "would be called 'mug'" in reason
    assert "expected different names" in reason
