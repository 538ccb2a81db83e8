"""SPLIT's heads at many poses of one scene: what sampling spends its time on.

`ScenePredictor` returns what `SplitNetwork.score` and `evaluate` do for the contexts of the same
poses, up to rounding, in less than half the time on a CPU.
"""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from split_drake.pose_task import PoseTask
from split_drake.split.context import CORNERS, FeatureTables, in_pose_axes, pose_numbers
from split_drake.split.inference.layers import ReadyLinear
from split_drake.split.inference.network import InferenceHead, InferenceNetwork
from split_drake.split.network import SplitNetwork


class _LookedUp:
    """Grids whose features are interpolated at points: all in one go, as many small steps.

    Points are the innermost dimension of what is worked out, so that steps run along memory.

    Args:
        tables: of one scene.
        numbers: of G grids.
        points: how many of a pose's points, the first ones, each grid is looked up at.
    """

    def __init__(
        self, tables: FeatureTables, numbers: Sequence[int], points: Sequence[int]
    ) -> None:
        # The encoder may leave the channels outermost; looking up wants rows in one piece.
        self._tables = [tables.tables[number].contiguous() for number in numbers]
        self._points = points
        self._edge_m = tables.edge_m
        device = self._tables[0].device
        sizes = torch.tensor([tables.sizes[number] for number in numbers], device=device)
        strides = torch.stack([sizes**2, sizes, torch.ones_like(sizes)])  # (3, G)
        corners = torch.tensor(CORNERS, device=device)
        self._sizes = sizes.to(self._tables[0])[:, None]
        self._strides = strides[:, :, None]
        self._steps = (corners[..., None] * strides).sum(1)[:, :, None]  # (8, G, 1)

    def features(self, p_VQs: Tensor) -> list[Tensor]:
        """Return each grid's features (N, K' * C) at the first K' of points (N, K, 3) in V."""
        p = p_VQs.reshape(-1, 3).T[:, None]
        cells = (p * (self._sizes / self._edge_m) - 0.5).clamp_(min=0.0)  # (3, G, N * K)
        cells = torch.minimum(cells, self._sizes - 1.0)
        low = torch.minimum(cells.floor(), self._sizes - 2.0)
        high_share = cells - low
        x, y, z = torch.stack([1.0 - high_share, high_share], 1)  # each (2, G, N * K)
        weights = (x[:, None, None] * y[:, None] * z).flatten(0, 2)  # (8, G, N * K)
        rows = (low.long() * self._strides).sum(0) + self._steps
        found = []
        for number, (table, points) in enumerate(zip(self._tables, self._points, strict=True)):
            r, w = (
                each[:, number].T.reshape(*p_VQs.shape[:2], -1)[:, :points].reshape(-1, 8)
                for each in (rows, weights)
            )
            features = functional.embedding_bag(r, table, per_sample_weights=w, mode="sum")
            found.append(features.reshape(len(p_VQs), -1))
        return found


class _Folded:
    """A grid of fewer cells than channels.

    Interpolation is linear, and so is a head's first layer: the layer is applied to the cells, once
    a scene, and only the cells' n^3 interpolation weights are left to find at each point.
    """

    def __init__(self, table: Tensor, size: int, edge_m: float) -> None:
        self._table, self._size, self._edge_m = table, size, edge_m

    def features(self, p_VQs: Tensor) -> Tensor:
        """Return the weights (Q, n^3) of the cells at points (Q, 3) in V."""
        cells = (p_VQs * (self._size / self._edge_m) - 0.5).clamp(0.0, self._size - 1.0)
        every = torch.arange(self._size, device=cells.device)
        x, y, z = (1.0 - (cells[..., None] - every).abs()).clamp(min=0.0).unbind(1)
        return (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).flatten(1)

    def weights(self, columns: Tensor) -> Tensor:
        """Return weights (..., n^3) of a linear layer, given those (..., C) for channels."""
        return columns @ self._table.T


class _Context:
    """The grids of one scene, each in the form that asks less of a head's first layer.

    Features are ordered by grids first, and not as a network's contexts by shells of points.
    """

    def __init__(self, network: SplitNetwork, tables: FeatureTables) -> None:
        config = network.config
        self._kernel = torch.cat([network.kernel, network.inner_kernel])
        self._outer, self._inner = len(network.kernel), len(network.inner_kernel)
        self._channels = [table.shape[1] for table in tables.tables]
        grids = config.context_grids if config.context == "local" else ()
        looked_up_inside = config.inner_grids if self._inner else ()
        self._inside = [grids.index(grid) for grid in looked_up_inside]
        self._folded: dict[int, _Folded] = {}
        for number, (table, size) in enumerate(zip(tables.tables, tables.sizes, strict=True)):
            if size**3 < table.shape[1]:
                self._folded[number] = _Folded(table, size, tables.edge_m)
        others = [n for n in range(len(self._channels)) if n not in self._folded]
        points = [self._points_of(number) for number in others]
        self._looked_up = _LookedUp(tables, others, points) if others else None

    @property
    def width(self) -> int:
        """Features of a network's context at the points, without the pose's own numbers."""
        inside = sum(self._channels[number] for number in self._inside)
        return self._outer * sum(self._channels) + self._inner * inside

    def weights(self, columns: Tensor) -> list[Tensor]:
        """Return a first layer's weights for the `features`, given those of a network's context."""
        outer, inner = columns.split([self.width - self._inner_width, self._inner_width], 1)
        parts = list(outer.unflatten(1, (self._outer, -1)).split(self._channels, -1))
        channels = [self._channels[number] for number in self._inside]
        if self._inner:
            of_inside = inner.unflatten(1, (self._inner, -1)).split(channels, -1)
            for number, part in zip(self._inside, of_inside, strict=True):
                parts[number] = torch.cat([parts[number], part], 1)
        folded = self._folded
        return [
            (folded[number].weights(part) if number in folded else part).flatten(1)
            for number, part in enumerate(parts)
        ]

    def features(self, X_VPs: Tensor) -> list[Tensor]:
        """Return what the grids show, each (N, F), around poses (N, 4, 4)."""
        p_VQs = X_VPs[:, None, :3, 3] + self._kernel @ X_VPs[:, :3, :3].mT
        looked_up = iter(self._looked_up.features(p_VQs) if self._looked_up else ())
        return [
            self._folded_features(number, p_VQs) if number in self._folded else next(looked_up)
            for number in range(len(self._channels))
        ]

    @property
    def _inner_width(self) -> int:
        return self._inner * sum(self._channels[number] for number in self._inside)

    def _points_of(self, number: int) -> int:
        return self._outer + (self._inner if number in self._inside else 0)

    def _folded_features(self, number: int, p_VQs: Tensor) -> Tensor:
        points = p_VQs[:, : self._points_of(number)].flatten(0, 1)
        return self._folded[number].features(points).reshape(len(p_VQs), -1)


class ScenePredictor:
    """What SPLIT predicts for poses of one scene and some tasks; for inference only.

    Args:
        network: made ready.
        occupied: (r, r, r) occupancy of the scene, indexed [x, y, z].
        tasks: T of the network's.
    """

    @torch.no_grad()
    def __init__(
        self, network: InferenceNetwork, occupied: Tensor, tasks: Sequence[PoseTask]
    ) -> None:
        self._network, self._split = network, network.network
        tables = self._split.encode(occupied[None].to(self._split.device), network.encoder)
        self._context = _Context(self._split, tables)
        heads = (network.score_head, network.evaluator_head)
        self._score_layer, self._evaluator_layer = (self._first_layer(head) for head in heads)
        self._tasks = [self._split.tasks.index(task) for task in tasks]

    @torch.no_grad()
    def score(self, X_VPs: Tensor, sigma: float) -> Tensor:
        """Return sigma * score (T, N, 6) of poses (T, N, 4, 4), in their frames."""
        first = self._score_layer(self._features(X_VPs)).view(*X_VPs.shape[:2], -1)
        head = self._network.score_head
        score = torch.stack(
            [
                head.outputs(each, self._network.score_layers(task, sigma))
                for each, task in zip(first, self._tasks, strict=True)
            ]
        )
        if self._split.config.score_frame == "global":
            return in_pose_axes(score, X_VPs[..., :3, :3])
        return score

    @torch.no_grad()
    def evaluate(self, X_VPs: Tensor) -> Tensor:
        """Return logits (T, N) that poses (T, N, 4, 4) are right."""
        first = self._evaluator_layer(self._features(X_VPs)).view(*X_VPs.shape[:2], -1)
        head = self._network.evaluator_head
        logits = [
            head.outputs(each, self._network.evaluator_layers(task))[:, 0]
            for each, task in zip(first, self._tasks, strict=True)
        ]
        return torch.stack(logits)

    def _first_layer(self, head: InferenceHead) -> ReadyLinear:
        """Return a head's first layer, for what `_features` returns."""
        weight, bias = head.first
        of_points, of_pose = weight.tensor_split([self._context.width], 1)
        return ReadyLinear(torch.cat([*self._context.weights(of_points), of_pose], 1), bias)

    def _features(self, X_VPs: Tensor) -> Tensor:
        """Return what the heads' first layers see, (T * N, F), of poses (T, N, 4, 4)."""
        config, X_VPs = self._split.config, X_VPs.flatten(0, 1)
        parts = self._context.features(X_VPs)
        if config.pose_width:
            parts.append(pose_numbers(X_VPs, config.edge_m)[:, -config.pose_width :])
        return torch.cat(parts, 1)
