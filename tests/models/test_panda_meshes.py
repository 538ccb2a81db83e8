"""The committed drawings of the Panda are what the script draws."""

from pathlib import Path

import numpy as np
import pytest

from models import panda_meshes

PARTS = panda_meshes.arm_parts() | panda_meshes.hand_parts()
FOLDER = Path(panda_meshes.__file__).parent / "panda"


def read_obj(path: Path, kind: str) -> np.ndarray:
    """Return the numbers on the lines of a kind, "v" or "vn" (N, 3); of "f" the vertices' only."""
    rows = [line.split()[1:] for line in path.read_text().splitlines() if line.split()[0] == kind]
    return np.array([[float(word.partition("//")[0]) for word in row] for row in rows])


def test_there_is_one_file_a_part() -> None:
    assert {path.stem for path in FOLDER.glob("*.obj")} == set(PARTS)


@pytest.mark.parametrize("name", PARTS)
def test_committed_file_is_what_the_script_draws(name: str, tmp_path: Path) -> None:
    drawn, committed = tmp_path / f"{name}.obj", FOLDER / f"{name}.obj"
    panda_meshes.write_obj(drawn, PARTS[name])
    for kind, tolerance in (("v", 1e-4), ("vn", 2e-3)):
        np.testing.assert_allclose(
            read_obj(drawn, kind), read_obj(committed, kind), rtol=0, atol=tolerance
        )
    assert len(read_obj(drawn, "f")) == len(read_obj(committed, "f"))


@pytest.mark.parametrize("name", PARTS)
def test_triangles_face_outwards(name: str) -> None:
    for part in PARTS[name]:
        a, b, c = (part.points[part.triangles[:, k]] for k in range(3))
        outward = np.einsum(
            "ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - part.points.mean(0)
        )
        assert (outward > -1e-12).all()
