"""What worker processes allocate memory with: jemalloc, where it is installed.

In every step Drake's plant and contact solver make and free thousands of small arrays, on which the
C library's allocator spends a quarter of the time.  A process has its allocator from its start on.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from ctypes.util import find_library
from functools import lru_cache

_VARIABLE = "LD_PRELOAD"


def allocator_environment() -> Mapping[str, str]:
    """Return the environment variables of a process that is to allocate by jemalloc.

    There are none where jemalloc is not installed, or something else is loaded first already.
    """
    library = _jemalloc()
    return {} if library is None or os.environ.get(_VARIABLE) else {_VARIABLE: library}


@contextmanager
def starting_with_allocator() -> Iterator[None]:
    """Have the processes that are started meanwhile allocate by jemalloc, where it is installed."""
    added = allocator_environment()
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


@lru_cache(maxsize=1)
def _jemalloc() -> str | None:
    return find_library("jemalloc")
