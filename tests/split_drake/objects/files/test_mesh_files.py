"""Mesh files that are refused, each with a sentence that names file and reason."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from split_drake.objects.meshes.mesh_file import SUFFIXES, ObjectFileError, read_mesh, tidied

CUBE = trimesh.creation.box((0.04, 0.05, 0.06))


def refusal(path: Path) -> str:
    """Return the sentence that a file is refused with."""
    with pytest.raises(ObjectFileError) as caught:
        read_mesh(path)
    text = str(caught.value)
    assert str(path) in text
    assert "; expected" in text
    assert "\n" not in text
    return text


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_all_kinds_of_files_are_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"cube{suffix}"
    CUBE.export(path)
    mesh = tidied(read_mesh(path))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(CUBE.volume)
    assert len(mesh.vertices) == 8


def test_scales_stretch_and_mirror(tmp_path: Path) -> None:
    CUBE.export(tmp_path / "cube.obj")
    mesh = read_mesh(tmp_path / "cube.obj", (2.0, 1.0, -1.0))
    assert mesh.extents == pytest.approx([0.08, 0.05, 0.06], abs=1e-6)
    assert mesh.volume == pytest.approx(2.0 * CUBE.volume, rel=1e-4)


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".OBJ"])
@pytest.mark.parametrize("content", [b"", b"v 1 2\nf nonsense 9 9\n\x00\xff", b"solid\n"])
def test_unreadable_files_are_refused(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    assert refusal(path)


def test_missing_files_and_other_files_are_refused(tmp_path: Path) -> None:
    assert "is missing" in refusal(tmp_path / "none.obj")
    assert "is no mesh file; expected .obj, .stl" in refusal(tmp_path / "notes.txt")


def test_meshes_without_faces_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.obj"
    path.write_text("v 0 0 0\nv 0 0 1\nv 0 1 0\n")
    assert refusal(path)


def test_nan_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "nan.obj"
    text = trimesh.exchange.obj.export_obj(CUBE)
    first = next(line for line in text.splitlines() if line.startswith("v "))
    path.write_text(text.replace(first, "v nan 0 0", 1))
    assert "NaN" in refusal(path)


def test_sheets_are_refused(tmp_path: Path) -> None:
    flat = trimesh.Trimesh(CUBE.vertices * (1.0, 1.0, 0.0), CUBE.faces, process=False)
    flat.apply_transform(trimesh.transformations.rotation_matrix(0.5, [1, 2, 3]))
    flat.export(tmp_path / "flat.ply")
    assert "has no volume; expected a solid" in refusal(tmp_path / "flat.ply")


def test_units_are_guessed(tmp_path: Path) -> None:
    CUBE.copy().apply_scale(1000.0).export(tmp_path / "mm.stl")
    assert "measures 60 m" in (text := refusal(tmp_path / "mm.stl"))
    assert "are its units millimetres?" in text
    CUBE.copy().apply_scale(0.001).export(tmp_path / "km.ply")
    assert "are its units metres?" in refusal(tmp_path / "km.ply")


def test_tidy_meshes_are_turned_outwards() -> None:
    loose = trimesh.Trimesh(
        CUBE.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False
    )
    loose.invert()
    tidy = tidied(loose)
    assert tidy.is_watertight
    assert tidy.volume == pytest.approx(CUBE.volume)
