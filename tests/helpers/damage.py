"""Files that are damaged in many ways, for readers that must say so."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from split_drake.bad_input import BadInputError


def times_told(path: Path, load: Callable[[Path], object], tries: int = 60) -> int:
    """Damage a file again and again; return how often `load` told of it, naming the file.

    Some damage is none that can be told, such as another time stamp.  What is raised but
    BadInputError, and a message without the path, fails the test.
    """
    content, rng, told = path.read_bytes(), np.random.default_rng(0), 0
    for _ in range(tries):
        damaged = bytearray(content)
        for at in rng.integers(len(damaged), size=rng.integers(1, 5)):
            damaged[at] ^= 1 << int(rng.integers(8))
        kept = len(damaged) if rng.random() < 0.7 else int(rng.integers(len(damaged)))
        path.write_bytes(damaged[:kept])
        try:
            load(path)
        except BadInputError as error:
            assert str(path) in str(error)
            told += 1
    path.write_bytes(content)
    return told
