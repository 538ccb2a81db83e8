"""Parametric mugs: geometry of the meshes, their collision pieces, and the fixed split."""

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial import cKDTree

from split_drake.models_folder import MODELS_FOLDER
from split_drake.objects.mug_shape import InvalidMugError, MugShape
from split_drake.objects.mugs.build import OPENING_CLEARANCE_M, build_mug
from split_drake.objects.mugs.collision import simplify_path
from split_drake.objects.mugs.mesh import handle_path
from split_drake.objects.mugs.parameters import (
    PROFILES,
    RANGES,
    BodyProfile,
    outer_radius_m,
    sample_parameters,
)
from split_drake.objects.mugs.split import (
    SplitConfig,
    draw_mugs,
    load_mug,
    mug_names,
    mug_parameters,
    write_split,
)
from split_drake.objects.rigid import Primitive
from split_drake.poses import Array, invert_pose, transform_points


def one_of_each_profile() -> list[str]:
    """Return the first training mug of each body profile."""
    names: dict[str, str] = {}
    for name in mug_names("train"):
        names.setdefault(mug_parameters(name).profile, name)
    return [names[profile] for profile in PROFILES]


NAMES = one_of_each_profile()


@pytest.fixture(scope="module", params=NAMES)
def mug(request: pytest.FixtureRequest) -> MugShape:
    return load_mug(request.param)


def signed_distances(piece: Primitive, p_OPs: Array) -> Array:
    """Return (N,) signed distances of points in O to a box, cylinder or capsule."""
    p = transform_points(invert_pose(piece.X_OP), p_OPs)
    if piece.kind == "capsule":
        radius, length = piece.size
        p[:, 2] -= np.clip(p[:, 2], -length / 2, length / 2)
        return np.linalg.norm(p, axis=1) - radius
    if piece.kind == "cylinder":
        beyond = np.abs(np.column_stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]]))
        beyond -= (piece.size[0], piece.size[1] / 2)
    else:
        beyond = np.abs(p) - np.array(piece.size) / 2
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return outside + np.minimum(beyond.max(axis=1), 0.0)


def piece_surface(piece: Primitive) -> Array:
    """Return points on a piece's surface, in O."""
    if piece.kind == "box":
        mesh = trimesh.creation.box(piece.size)
    elif piece.kind == "cylinder":
        mesh = trimesh.creation.cylinder(radius=piece.size[0], height=piece.size[1])
    else:
        mesh = trimesh.creation.capsule(radius=piece.size[0], height=piece.size[1])
    return transform_points(piece.X_OP, trimesh.sample.sample_surface(mesh, 60, seed=0)[0])


def test_mesh_is_a_solid_with_one_handle(mug: MugShape) -> None:
    mesh = mug.body.mesh
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    assert mesh.body_count == 1
    assert mesh.euler_number == 0  # A torus: one opening through the solid.


def test_mesh_stands_on_the_base_with_the_handle_towards_x(mug: MugShape) -> None:
    parameters = mug_parameters(mug.body.name)
    lower, upper = mug.body.mesh.bounds
    assert lower[2] == pytest.approx(0.0, abs=1e-9)
    assert upper[2] == pytest.approx(parameters.height_m, abs=1e-4)
    assert lower[0] >= -parameters.outer_radius_m
    assert upper[0] > parameters.outer_radius_m + 2 * OPENING_CLEARANCE_M
    assert mug.outer_diameter_m == pytest.approx(2 * parameters.outer_radius_m)


def test_cavity_holds_nothing_of_the_handle(mug: MugShape) -> None:
    parameters = mug_parameters(mug.body.name)
    p = mug.body.mesh.vertices
    above_base = p[p[:, 2] > parameters.base_m + 1e-6]
    inner = outer_radius_m(parameters, above_base[:, 2]) - 3.0 * parameters.wall_m
    assert (np.hypot(above_base[:, 0], above_base[:, 1]) > inner).all()


def test_handle_frame_lies_in_the_middle_of_the_opening(mug: MugShape) -> None:
    assert np.allclose(mug.X_OH[:3, :3], np.eye(3))
    outline = mug.opening_OPs
    assert np.allclose(outline[:, 1], 0.0, atol=1e-9)
    assert np.allclose(outline[0], outline[-1])
    polygon = shapely.Polygon(outline[:, [0, 2]])
    center = shapely.Point(mug.X_OH[0, 3], mug.X_OH[2, 3])
    assert polygon.contains(center)
    assert polygon.exterior.distance(center) >= OPENING_CLEARANCE_M
    assert polygon.centroid.distance(center) < 1e-9


def test_a_peg_fits_through_the_opening(mug: MugShape) -> None:
    along = np.linspace(-0.05, 0.05, 60)[:, None] * (0.0, 1.0, 0.0)
    p_OAxis = transform_points(mug.X_OH, along)
    distances = [signed_distances(piece, p_OAxis).min() for piece in mug.body.collision]
    assert min(distances) > OPENING_CLEARANCE_M - 0.0015


def test_mass_and_inertia_are_those_of_the_mesh(mug: MugShape) -> None:
    mesh, body = mug.body.mesh.copy(), mug.body
    mesh.density = body.mass_kg / mesh.volume
    assert mesh.mass == pytest.approx(body.mass_kg)
    assert np.allclose(mesh.moment_inertia, body.inertia_kg_m2)
    assert np.allclose(mesh.center_mass, body.p_OCom)
    a, b, c = np.linalg.eigvalsh(body.inertia_kg_m2)
    assert 0.0 < a <= b <= c <= a + b


def test_collision_covers_the_mesh(mug: MugShape) -> None:
    p_OPs, _ = trimesh.sample.sample_surface(mug.body.mesh, 2000, seed=0)
    distances = np.min([signed_distances(piece, p_OPs) for piece in mug.body.collision], axis=0)
    assert np.percentile(distances, 99) < 0.0012
    assert distances.max() < 0.002
    assert distances.min() > -0.0015


def test_collision_stays_within_the_mesh(mug: MugShape) -> None:
    pieces = mug.body.collision
    p_OQs = np.concatenate([piece_surface(piece) for piece in pieces])
    outer = np.min([signed_distances(piece, p_OQs) for piece in pieces], axis=0) > -1e-5
    p_OPs, _ = trimesh.sample.sample_surface(mug.body.mesh, 40000, seed=0)
    # The samples are a millimetre apart: distances to them overestimate those to the surface.
    distances = np.asarray(cKDTree(p_OPs).query(p_OQs[outer])[0])
    assert np.percentile(distances, 95) < 0.0016
    assert distances.max() < 0.003
    assert p_OQs[:, 2].min() > -1e-4


def test_collision_geometry_is_small_enough_for_physics() -> None:
    assert max(len(load_mug(name).body.collision) for name in NAMES) <= 110


def test_simplified_path_is_the_shortest_that_follows() -> None:
    bent = np.array([[0.0, 0.0], [1.0, 0.01], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0]])
    assert np.allclose(simplify_path(bent, 0.1, 4), bent[[0, 2, 4]])
    assert np.allclose(simplify_path(bent, 0.001, 4), bent[[0, 1, 2, 4]])
    assert len(simplify_path(bent, 0.001, 2)) == 3


def test_the_split_has_distinct_shapes() -> None:
    assert (len(mug_names("train")), len(mug_names("test"))) == (200, 40)
    numbers = [mug_parameters(n).numbers() for n in (*mug_names("train"), *mug_names("test"))]
    # Mass is the last; leave it out, and the outer size: shapes must differ in more than scale.
    shape = np.array(numbers)[:, 2:-1]
    distances = np.asarray(cKDTree(shape).query(shape, k=2)[0])
    assert distances[:, 1].min() > 0.1


def test_the_split_covers_the_ranges() -> None:
    parameters = [mug_parameters(name) for name in mug_names("train")]
    assert {p.profile for p in parameters} == set(PROFILES)
    radii = [p.outer_radius_m for p in parameters]
    assert min(radii) < 0.032
    assert max(radii) > 0.058


def test_building_is_repeatable() -> None:
    first, second = load_mug("test_003"), load_mug("test_003")
    assert np.array_equal(first.body.mesh.vertices, second.body.mesh.vertices)
    assert np.array_equal(first.X_OH, second.X_OH)


def test_drawing_counts_what_it_rejects() -> None:
    mugs, rejected = draw_mugs(20, np.random.default_rng(3))
    again, _ = draw_mugs(20, np.random.default_rng(3))
    assert mugs == again
    assert set(rejected) <= {
        "tight opening",
        "no single opening",
        "narrow cavity",
        "handle apart from body",
        "leaking mesh",
    }


def test_tight_openings_are_refused() -> None:
    parameters = replace(
        sample_parameters(np.random.default_rng(0)),
        handle="round",
        handle_power=2.0,
        handle_reach_m=0.028,
        handle_span=0.45,
        height_m=0.06,
        grip_thickness_m=0.012,
    )
    with pytest.raises(InvalidMugError, match="tight opening"):
        build_mug("tight", parameters)


def test_parameters_out_of_range_are_named() -> None:
    parameters = sample_parameters(np.random.default_rng(0))
    with pytest.raises(ValueError, match=r"wall_m is 4\.0; expected 0\.0015 to 0\.013"):
        replace(parameters, wall_m=4.0)
    with pytest.raises(ValueError, match=r"profile is 'vase'; expected one of"):
        replace(parameters, profile=cast(BodyProfile, "vase"))


def test_thin_mugs_leave_the_ranges_of_the_others() -> None:
    mugs = [mug_parameters(name) for name in mug_names("thin")]
    assert len(mugs) == 40
    assert all(0.002 <= mug.grip_thickness_m <= 0.003 for mug in mugs)
    assert {mug.wall_m > RANGES["wall_m"][1] for mug in mugs} == {False, True}
    assert min(mug.wall_m for mug in mugs) < RANGES["wall_m"][0]
    below = [load_mug(name).body.mesh.bounds[0, 2] < -0.001 for name in mug_names("thin")]
    assert any(below) and not all(below)


@pytest.mark.parametrize("lift_m", [-0.02, 0.02])
def test_a_lift_raises_the_middle_of_the_handle_alone(lift_m: float) -> None:
    parameters = replace(mug_parameters("test_000"), handle_lift_m=0.0)
    plain = handle_path(parameters)
    lifted = handle_path(replace(parameters, handle_lift_m=lift_m))
    np.testing.assert_allclose(lifted[[0, -1]], plain[[0, -1]], atol=1e-4)
    furthest = lifted[lifted[:, 0].argmax(), 1] - plain[plain[:, 0].argmax(), 1]
    assert furthest == pytest.approx(lift_m, abs=0.007)


def test_shipped_mugs_are_what_the_command_draws(tmp_path: Path) -> None:
    write_split(SplitConfig(out=tmp_path))
    for split in ("train", "test", "thin"):
        assert (tmp_path / f"{split}.json").read_text() == (
            MODELS_FOLDER / "mugs" / f"{split}.json"
        ).read_text()


@pytest.mark.parametrize("name", ["train_200", "validation_000", "test", "test_-1", ""])
def test_unknown_mugs_are_named(name: str) -> None:
    with pytest.raises(ValueError, match="no mug is called"):
        load_mug(name)
