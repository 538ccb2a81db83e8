"""Random damage to values, to trees of values, and to bytes."""

import copy
from typing import Any

import numpy as np

WEIRD: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    1.5,
    -0.0,
    1e-300,
    1e38,
    -1e300,
    10**30,
    float("nan"),
    float("inf"),
    float("-inf"),
    "",
    "x",
    "nan",
    "../../etc/passwd",
    [],
    [[]],
    {},
    [0.0, 0.0, 0.0],
    {"a": 1},
)


def pick(rng: np.random.Generator, values: tuple[Any, ...]) -> Any:
    """Return one of the values, as it is and not as NumPy would have it."""
    return values[int(rng.integers(len(values)))]


def mutated(tree: Any, rng: np.random.Generator) -> Any:
    """Return a tree of dicts and lists with one to three of its places changed."""
    result = copy.deepcopy(tree)
    for _ in range(int(rng.integers(1, 4))):
        result = _changed(result, rng)
    return result


def _changed(node: Any, rng: np.random.Generator) -> Any:
    keys = list(node) if isinstance(node, dict) else range(len(node)) if _listed(node) else ()
    if not len(keys) or rng.random() < 0.1:
        return _other(node, rng)
    key = keys[int(rng.integers(len(keys)))]
    chance = rng.random()
    if chance < 0.1:
        del node[key]
    elif chance < 0.17 and isinstance(node, dict):
        node[pick(rng, ("extra", "X_WC", "center", 3, ""))] = pick(rng, WEIRD)
    elif chance < 0.17:
        node.append(pick(rng, WEIRD))
    else:
        node[key] = _changed(node[key], rng)
    return node


def _listed(node: Any) -> bool:
    return isinstance(node, list) and len(node) > 0


def _other(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, float) and rng.random() < 0.5:
        return value * float(pick(rng, (-1.0, 1e-3, 1e3, 1.001, 1e30)))
    return pick(rng, WEIRD)


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with some bits flipped, and often an end cut off, or a piece twice.

    One in four is whole: so many that each target gets some by any luck.
    """
    if rng.random() < 0.25:
        return content
    result = bytearray(content)
    for at in rng.integers(max(len(result), 1), size=int(rng.integers(0, 6))):
        if len(result):
            result[at] ^= 1 << int(rng.integers(8))
    chance, middle = rng.random(), int(rng.integers(len(result) + 1))
    if chance < 0.3:
        return bytes(result[:middle])
    if chance < 0.4:
        return bytes(result[middle:] + result)
    return bytes(result)


def odd_array(shape: tuple[int, ...], scale: float, rng: np.random.Generator) -> np.ndarray:
    """Return an array of about that shape, some of whose entries are no usual numbers."""
    if rng.random() < 0.1:
        shape = tuple(int(n) for n in rng.integers(0, 5, size=int(rng.integers(0, 4))))
    values = rng.normal(0.0, scale, shape)
    for odd in (np.nan, np.inf, -np.inf, 1e38, -1.0, 65.535, 1e-30):
        if rng.random() < 0.15:
            values = np.where(rng.random(values.shape) < 0.2, odd, values)
    kind = pick(rng, ("float64", "float64", "float32", "int64", "bool", "uint16", "str"))
    with np.errstate(invalid="ignore", over="ignore"):
        return values.astype(kind)
