"""A data set as tensors on one device, from which scenes and their true poses are drawn."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
import torch
from torch import Tensor

from split_drake.data.grasp_candidates import GraspState


class SceneArrays(Protocol):
    """What a data set offers for S scenes of M mugs, in W; L grasp candidates a mug."""

    @property
    def clouds(self) -> np.ndarray:
        """(S, 2000, 3) points without noise."""

    @property
    def X_WOs(self) -> np.ndarray:
        """(S, 4, 4) poses of the mugs."""

    @property
    def mug_index(self) -> np.ndarray:
        """(S,) which mug each scene shows."""

    @property
    def X_OGs(self) -> np.ndarray:
        """(M, L, 4, 4) candidates."""

    @property
    def qualities(self) -> np.ndarray:
        """(M, L) how likely a true grasp is to be drawn, relative to the others of its mug."""

    @property
    def grasp_states(self) -> np.ndarray:
        """(S, L) what each candidate is in each scene: a `GraspState`."""

    @property
    def handles(self) -> np.ndarray:
        """(S, 2, 4, 4) the two equivalent handle poses."""

    @property
    def uprights(self) -> np.ndarray:
        """(S, 1, 4, 4) true upright poses."""


@dataclass(frozen=True)
class TrainingScenes:
    """Scenes relative to the workspace's corner V.

    Grasps stay in their mug's frame until they are drawn, so that 30,000 scenes take 0.8 GB.

    Attributes:
        p_VSs: (S, 2000, 3) points.
        X_VOs: (S, 4, 4).
        mug_index: (S,).
        X_OGs: (M, L, 4, 4).
        qualities: (M, L).
        grasp_states: (S, L) uint8.
        X_VHs: (S, 2, 4, 4).
        X_VUs: (S, 1, 4, 4).
    """

    p_VSs: Tensor
    X_VOs: Tensor
    mug_index: Tensor
    X_OGs: Tensor
    qualities: Tensor
    grasp_states: Tensor
    X_VHs: Tensor
    X_VUs: Tensor

    @classmethod
    def from_arrays(cls, arrays: SceneArrays, p_WV: np.ndarray, device: torch.device) -> Self:
        """Return the scenes of a data set whose workspace has its corner at `p_WV` (3,).

        Raises ValueError where a scene has no true or no false grasp.
        """
        _require_drawable(arrays)
        offset = torch.tensor(p_WV, dtype=torch.float32, device=device)

        def floats(values: np.ndarray) -> Tensor:
            return torch.tensor(values, dtype=torch.float32, device=device)

        def poses(X_Ws: np.ndarray) -> Tensor:
            X = floats(X_Ws)
            X[..., :3, 3] -= offset
            return X

        return cls(
            p_VSs=floats(arrays.clouds).sub_(offset),
            X_VOs=poses(arrays.X_WOs),
            mug_index=torch.tensor(arrays.mug_index, dtype=torch.long, device=device),
            X_OGs=floats(arrays.X_OGs),
            qualities=floats(arrays.qualities),
            grasp_states=torch.tensor(arrays.grasp_states, dtype=torch.uint8, device=device),
            X_VHs=poses(arrays.handles),
            X_VUs=poses(arrays.uprights),
        )

    def __len__(self) -> int:
        return len(self.p_VSs)

    def true_grasps(self, chosen: Tensor, count: int, generator: torch.Generator) -> Tensor:
        """Return grasps (B, count, 4, 4) in V of scenes (B,), in proportion to their quality."""
        true = self.grasp_states[chosen] == GraspState.TRUE
        return self._grasps(chosen, self.qualities[self.mug_index[chosen]] * true, count, generator)

    def false_grasps(self, chosen: Tensor, count: int, generator: torch.Generator) -> Tensor:
        """Return grasps (B, count, 4, 4) in V that do not hold, or not in those scenes (B,)."""
        false = self.grasp_states[chosen] == GraspState.FALSE
        return self._grasps(chosen, false.float(), count, generator)

    def handles(self, chosen: Tensor, count: int, generator: torch.Generator) -> Tensor:
        """Return handle poses (B, count, 4, 4) in V of the scenes (B,)."""
        return _pick(self.X_VHs[chosen], count, generator)

    def uprights(self, chosen: Tensor, count: int, generator: torch.Generator) -> Tensor:
        """Return upright poses (B, count, 4, 4) in V of the scenes (B,)."""
        return _pick(self.X_VUs[chosen], count, generator)

    def _grasps(
        self, chosen: Tensor, weights: Tensor, count: int, generator: torch.Generator
    ) -> Tensor:
        """Return candidates (B, count, 4, 4) in V, drawn with probabilities ~ weights (B, L)."""
        if count == 0:  # which torch.multinomial refuses
            return self.X_OGs.new_empty((len(chosen), 0, 4, 4))
        drawn = torch.multinomial(weights, count, replacement=True, generator=generator)
        X_OGs = self.X_OGs[self.mug_index[chosen][:, None], drawn]
        return self.X_VOs[chosen][:, None] @ X_OGs


def _pick(X: Tensor, count: int, generator: torch.Generator) -> Tensor:
    """Return `count` random poses of each scene, (B, count, 4, 4) of (B, N, 4, 4)."""
    index = torch.randint(X.shape[1], (len(X), count), generator=generator, device=X.device)
    return X[torch.arange(len(X), device=X.device)[:, None], index]


def _require_drawable(arrays: SceneArrays) -> None:
    """Raise ValueError naming a scene without true, or without false grasps."""
    true = (arrays.grasp_states == GraspState.TRUE) & (arrays.qualities[arrays.mug_index] > 0.0)
    false = arrays.grasp_states == GraspState.FALSE
    for states, kind in ((true, "true grasp of positive quality"), (false, "false grasp")):
        if len(missing := np.flatnonzero(~states.any(axis=1))):
            raise ValueError(
                f"{len(missing)} of {len(states)} scenes, {missing[0]} the first, have no {kind}; "
                "expected at least one in each"
            )
