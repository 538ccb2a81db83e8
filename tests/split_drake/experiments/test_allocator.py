"""Workers allocate by jemalloc where it is installed, and nothing else changes."""

import os
from ctypes.util import find_library
from pathlib import Path

import pytest

from split_drake.experiments.allocator import allocator_environment, starting_with_allocator
from split_drake.experiments.pool import WorkerPool

needs_jemalloc = pytest.mark.skipif(find_library("jemalloc") is None, reason="needs jemalloc")


def has_jemalloc(item: int) -> bool:
    return "jemalloc" in Path("/proc/self/maps").read_text()


@needs_jemalloc
def test_workers_allocate_by_jemalloc() -> None:
    assert list(WorkerPool(has_jemalloc, workers=2).run(range(3))) == [True] * 3
    assert not has_jemalloc(0)


@needs_jemalloc
def test_what_is_preloaded_already_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LD_PRELOAD", "libc.so.6")
    assert not allocator_environment()
    with starting_with_allocator():
        assert os.environ["LD_PRELOAD"] == "libc.so.6"
    assert list(WorkerPool(has_jemalloc, workers=1).run([0])) == [False]


def test_the_environment_is_as_before_afterwards() -> None:
    before = dict(os.environ)
    with pytest.raises(ValueError, match="stop"), starting_with_allocator():
        raise ValueError("stop")
    assert dict(os.environ) == before
