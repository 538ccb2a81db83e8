"""Every kind of shape: solid, of a hand's size, and stood for by its pieces."""

from typing import get_args

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st

from split_drake.objects.piece_fidelity import measure_fidelity
from split_drake.objects.procedural.kinds import KINDS, MASS_KG, Trait, build_body, kind
from split_drake.objects.procedural.prisms import convex_parts, extruded
from split_drake.objects.procedural.revolved import ring, turned, vessel
from split_drake.objects.procedural.shape import (
    BULGE_M,
    Shape,
    circle,
    cuboid,
    moved,
    rod,
    swept,
    union,
)
from split_drake.objects.procedural.split import TEST_KINDS, check_shape, kinds_of
from split_drake.poses import make_pose, rotation_z

NAMES = sorted(KINDS)


def test_there_are_many_kinds_of_every_trait() -> None:
    assert len(KINDS) >= 20
    for names in (kinds_of("train"), kinds_of("test")):
        for trait in get_args(Trait):
            assert sum(trait in KINDS[name].traits for name in names) >= 2, trait
    assert not set(kinds_of("train")) & set(TEST_KINDS)


@pytest.mark.parametrize("name", NAMES)
def test_pieces_stand_for_the_mesh(name: str) -> None:
    body = build_body(name, 1)
    fidelity = measure_fidelity(body.mesh, body.collision, count=1000)
    assert fidelity.share_within(0.0005) == 1.0
    assert np.percentile(fidelity.protruding_m, 95) < 0.0015
    assert fidelity.protruding_m.max() < 0.002


@settings(max_examples=60)
@given(st.sampled_from(NAMES), st.integers(0, 10_000))
@example("wedge", 316)  # halved beside a corner
def test_bodies_are_solids_on_their_foot(name: str, seed: int) -> None:
    body = build_body(name, seed)
    assert body.mesh.is_watertight
    assert body.mesh.volume > 0.0
    assert body.mesh.body_count == 1
    lower, upper = body.mesh.bounds
    assert lower[2] == pytest.approx(0.0, abs=1e-9)
    assert (lower + upper)[:2] == pytest.approx(0.0, abs=1e-9)
    assert MASS_KG[0] <= body.mass_kg <= MASS_KG[1]
    assert (body.p_OCom > lower).all()
    assert (body.p_OCom < upper).all()
    a, b, c = np.linalg.eigvalsh(body.inertia_kg_m2)
    assert 0.0 < a <= b <= c <= a + b


@pytest.mark.parametrize("name", ["bottle", "cluster"])
def test_a_seed_is_one_shape(name: str) -> None:
    first, again, other = build_body(name, 3), build_body(name, 3, "mine"), build_body(name, 4)
    assert np.array_equal(first.mesh.vertices, again.mesh.vertices)
    assert (first.name, again.name) == (f"{name}_3", "mine")
    assert first.mass_kg == again.mass_kg
    assert not np.array_equal(first.mesh.bounds, other.mesh.bounds)


def test_a_new_kind_is_one_function() -> None:
    @kind("brick", "flat")
    def brick(rng: np.random.Generator) -> Shape:
        return cuboid((0.06, 0.03, rng.uniform(0.01, 0.02)))

    try:
        body = build_body("brick", 0)
        assert body.mesh.extents[:2] == pytest.approx([0.06, 0.03])
        check_shape(body)
        with pytest.raises(ValueError, match="two kinds called 'brick'"):
            kind("brick")(brick)
    finally:
        del KINDS["brick"]


def test_unknown_kinds_are_named() -> None:
    with pytest.raises(ValueError, match=r"no kind is called 'teapot'; expected one of .*bottle"):
        build_body("teapot", 0)


def test_turned_solids_are_as_long_as_convex_pieces_may_be() -> None:
    assert len(turned([(0.02, 0.0), (0.02, 0.05), (0.01, 0.08)]).hulls) == 1
    waisted = turned([(0.03, 0.0), (0.01, 0.04), (0.03, 0.08)])
    assert len(waisted.hulls) == 2
    assert waisted.mesh.volume == pytest.approx(2 * np.pi / 3 * 0.04 * 13e-4, rel=0.01)


def test_vessels_hold_water() -> None:
    cup = vessel([(0.0, 0.0), (0.03, 0.0), (0.03, 0.08)], 0.004)
    inside = np.pi * 0.026**2 * 0.076
    assert cup.mesh.volume == pytest.approx(np.pi * 0.03**2 * 0.08 - inside, rel=0.01)
    hulls = [trimesh.convex.convex_hull(hull) for hull in cup.hulls]
    middle = np.array([[0.0, 0.0, 0.04], [0.02, 0.0, 0.06], [0.0, 0.0, 0.006]])
    assert not any(hull.contains(middle).any() for hull in hulls)
    assert len(ring([(0.03, 0.0), (0.035, 0.0), (0.035, 0.01), (0.03, 0.01)]).hulls) >= 12


def test_polygons_fall_into_few_convex_parts() -> None:
    ell = np.array([(0.0, 0.0), (0.08, 0.0), (0.08, 0.02), (0.02, 0.02), (0.02, 0.06), (0.0, 0.06)])
    assert len(convex_parts([ell])) == 2
    assert len(convex_parts([circle(0.03, 32)])) == 1
    with_hole = extruded([circle(0.03, 6), circle(0.015, 24)], 0.02)
    assert with_hole.mesh.euler_number == 0  # A torus.
    assert 3 <= len(with_hole.hulls) <= 12


def test_parts_are_joined_and_moved() -> None:
    bar = rod((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), 0.01)
    head = moved(cuboid((0.02, 0.06, 0.02)), make_pose(rotation_z(0.1), (0.1, 0.0, 0.0)))
    both = union(bar, head)
    assert both.mesh.body_count == 1
    assert both.mesh.is_watertight
    assert len(both.hulls) == 2
    assert both.mesh.volume < bar.mesh.volume + head.mesh.volume


def test_a_bent_path_is_a_chain_of_hulls() -> None:
    angle = np.linspace(0.0, np.pi, 9)
    path = 0.03 * np.column_stack([np.cos(angle), np.zeros(9), np.sin(angle)])
    handle = swept(path, circle(0.005, 12), (0.0, 1.0, 0.0))
    assert len(handle.hulls) == 8
    assert handle.mesh.is_watertight
    assert handle.mesh.volume == pytest.approx(np.pi * 0.03 * np.pi * 0.005**2, rel=0.1)
    assert handle.mesh.bounds[1][2] == pytest.approx(0.035, abs=BULGE_M)
