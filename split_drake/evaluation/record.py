"""What is kept of an evaluated scene: one JSON line each."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from split_drake.data.object_scenes import feature_visible
from split_drake.poses import Array


@dataclass(frozen=True)
class Scored:
    """Scores of samples, and whether each is good.

    Attributes:
        scores: (N,) in [0, 1], to four decimals.
        good: N times "1" or "0".
    """

    scores: tuple[float, ...]
    good: str

    @classmethod
    def of(cls, scores: Array, good: NDArray[np.bool_]) -> Self:
        """Return samples with scores (N,) that are `good` (N,) or not."""
        return cls(
            tuple(np.round(scores, 4).tolist()), "".join("1" if flag else "0" for flag in good)
        )

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Self:
        """Return the samples of which `fields` are the parsed JSON."""
        return cls(tuple(fields["scores"]), fields["good"])

    @property
    def flags(self) -> NDArray[np.bool_]:
        """(N,): whether each sample is good."""
        return np.array([flag == "1" for flag in self.good], dtype=bool)


@dataclass(frozen=True)
class TaskRecord:
    """A task in one scene.

    Attributes:
        checks: what the top-ranked sample, or the scene, passes, by name.
        values: figures of the top-ranked sample, or of the scene, by name.
        tallies: (hits, of how many) samples or true poses, by name.
        samples: all of them, judged geometrically.
        tried: those that were tried in physics; None where none were to be.
    """

    checks: Mapping[str, bool]
    values: Mapping[str, float]
    tallies: Mapping[str, tuple[int, int]]
    samples: Scored
    tried: Scored | None = None

    @classmethod
    def from_fields(cls, fields: dict[str, Any]) -> Self:
        """Return the record of which `fields` are the parsed JSON."""
        tried = fields["tried"]
        return cls(
            checks=fields["checks"],
            values=fields["values"],
            tallies={name: (hits, total) for name, (hits, total) in fields["tallies"].items()},
            samples=Scored.from_fields(fields["samples"]),
            tried=None if tried is None else Scored.from_fields(tried),
        )


@dataclass(frozen=True)
class SceneRecord:
    """What became of one scene.

    Attributes:
        index: of the scene, which with the seed says all about it.
        subject: name of the object.
        feature_points: how many of the points without noise lie on the part that poses are told
            by, as in `ObjectScene`.
        detect_s: wall time of the detection.
        tasks: {name: record}.
    """

    index: int
    subject: str
    feature_points: int
    detect_s: float
    tasks: Mapping[str, TaskRecord]

    @property
    def visible(self) -> bool:
        """Whether the part that poses are told by shows."""
        return bool(feature_visible(self.feature_points))

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Self:
        """Return the record that a line of JSON holds."""
        tasks = {name: TaskRecord.from_fields(f) for name, f in fields["tasks"].items()}
        return cls(**{**fields, "tasks": tasks})
