"""Objects in several sizes."""

import numpy as np
import pytest

from split_drake.data.clutter.sizes import SizedSource, clutter_source
from tests.split_drake.data.clutter.conftest import Blocks


def test_each_size_comes_from_its_own_part_of_the_range() -> None:
    sized = SizedSource(Blocks(), count=3, scales=(0.6, 0.9))
    assert sized.names()[:4] == ("bar*0", "can*0", "slab*0", "bar*1")
    whole = Blocks().load("bar").body.mesh.extents
    for size, (low, high) in enumerate(((0.6, 0.7), (0.7, 0.8), (0.8, 0.9))):
        shape = sized.load(f"bar*{size}")
        ratios = shape.body.mesh.extents / whole
        assert low <= ratios[0] <= high
        np.testing.assert_allclose(ratios, ratios[0])
        assert shape.name == f"bar*{size}"
        again = sized.load(f"bar*{size}").body.mesh
        np.testing.assert_array_equal(again.extents, shape.body.mesh.extents)


@pytest.mark.parametrize("name", ["bar", "bar*", "bar*2", "bar*-1", "*0"])
def test_names_of_no_copy_are_refused(name: str) -> None:
    with pytest.raises((ValueError, KeyError)):
        SizedSource(Blocks(), count=2).load(name)


def test_impossible_ranges_are_named() -> None:
    for count, scales in ((0, (0.7, 1.0)), (1, (0.0, 1.0)), (1, (1.0, 0.7))):
        with pytest.raises(ValueError, match="expected at least one size, and 0 < lowest"):
            SizedSource(Blocks(), count, scales)


def test_the_hash_tells_sizes_apart() -> None:
    hashes = {
        SizedSource(Blocks(), 2).sha256(),
        SizedSource(Blocks(), 3).sha256(),
        SizedSource(Blocks(), 2, (0.5, 1.0)).sha256(),
    }
    assert len(hashes) == 3
    assert clutter_source("train").sha256() != clutter_source("test").sha256()
