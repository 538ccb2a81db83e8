"""SPLIT's network: scene encoder, local context, score and evaluator heads (paper IV-C).

What looks at grasps closely (`close_up`) is not in the paper.

Everything here is relative to the corner V of the workspace, so that the workspace may stand
anywhere: poses are X_VP, the table is at `SplitConfig.table_m` along z.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from split_drake.pose_task import PoseTask
from split_drake.split.close_up.network import CloseUpNetwork
from split_drake.split.context import FeatureTables, in_pose_axes, point_kernel, pose_numbers
from split_drake.split.network_config import INPUT_CHANNELS, SplitConfig

_CLOSE_UP = "close_up."


class ConvLayer(nn.Sequential):
    """A 3x3x3 convolution, batch normalisation and ReLU."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__(
            nn.Conv3d(inputs, outputs, 3, stride=stride, padding=1, bias=False),
            nn.BatchNorm3d(outputs),
            nn.ReLU(),
        )


class ConvBlock(nn.Module):
    """A convolution of stride 2, and (`refine`) a residual one at the lower resolution."""

    # On CPUs the bfloat16 gradients of 3D convolutions are wrong on the smallest volumes (oneDNN 3)
    # and several times slower than float32 for strided ones: neither runs under autocast.
    SMALLEST_AUTOCAST = 8

    def __init__(self, inputs: int, outputs: int, refine: bool) -> None:
        super().__init__()
        self.reduce = ConvLayer(inputs, outputs, stride=2)
        self.refine = ConvLayer(outputs, outputs, stride=1) if refine else None

    def forward(self, x: Tensor) -> Tensor:
        """Return (B, outputs, n/2, n/2, n/2) float32 for `x` (B, inputs, n, n, n) float32."""
        with torch.autocast(x.device.type, enabled=False):
            x = self.reduce(x)
        if self.refine is None:
            return x
        fine = torch.is_autocast_enabled(x.device.type) and x.shape[-1] >= self.SMALLEST_AUTOCAST
        with torch.autocast(x.device.type, torch.bfloat16, enabled=fine):
            return x + self.refine(x)


class Encoder(nn.Module):
    """Feature grids at falling resolutions, as in IF-Net."""

    def __init__(self, channels: Sequence[int]) -> None:
        super().__init__()
        inputs = (INPUT_CHANNELS, *channels)
        # At half the input's resolution a second convolution would cost more than all others.
        self.blocks = nn.ModuleList(
            ConvBlock(inputs[i], inputs[i + 1], refine=i > 0) for i in range(len(channels))
        )

    def forward(self, x: Tensor) -> list[Tensor]:
        """Return the input (B, 2, r, r, r) and the output of each block, finest first."""
        grids = [x]
        for block in self.blocks:
            grids.append(block(grids[-1]))
        return grids


class SceneLatent(nn.Sequential):
    """One vector of a whole scene, from all cells of its coarsest grid."""

    def __init__(self, config: SplitConfig) -> None:
        cells = (config.resolution // 2 ** len(config.channels)) ** 3
        super().__init__(
            nn.Flatten(),
            nn.Linear(config.channels[-1] * cells, config.latent_width),
            nn.SiLU(),
            nn.Linear(config.latent_width, config.latent_width),
        )


class FilmMlp(nn.Module):
    """A residual MLP whose hidden layers are scaled and shifted by a condition (FiLM)."""

    def __init__(self, inputs: int, conditions: int, outputs: int, width: int, layers: int) -> None:
        super().__init__()
        self.width = width
        self.input = nn.Linear(inputs, width)
        self.hidden = nn.ModuleList(nn.Linear(width, width) for _ in range(layers - 2))
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(layers - 2))
        self.output = nn.Linear(width, outputs)
        self.film = nn.Linear(conditions, (layers - 1) * 2 * width)
        nn.init.normal_(self.film.weight, std=0.02)
        nn.init.zeros_(self.film.bias)
        nn.init.normal_(self.output.weight, std=1e-3)
        nn.init.zeros_(self.output.bias)

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """Return (G, N, outputs) for `x` (G, N, inputs) and conditions (G, conditions)."""
        film = self.film(condition).view(len(condition), -1, 2, 1, self.width)
        scale, shift = film[:, :, 0] + 1.0, film[:, :, 1]  # (G, layers - 1, 1, width)
        h = functional.silu(torch.addcmul(shift[:, 0], self.input(x), scale[:, 0]))
        for i, (linear, norm) in enumerate(zip(self.hidden, self.norms, strict=True), start=1):
            h = h + functional.silu(torch.addcmul(shift[:, i], linear(norm(h)), scale[:, i]))
        return self.output(h)


class SplitNetwork(nn.Module):
    """Encoder, score head and evaluator head for some tasks.

    Args:
        config: its architecture.
        tasks: T of them, whose order is that of the indices below.
    """

    kernel: Tensor
    inner_kernel: Tensor
    frequencies: Tensor

    def __init__(self, config: SplitConfig, tasks: Sequence[PoseTask]) -> None:
        super().__init__()
        self.config = config
        self.tasks = tuple(tasks)
        condition = config.condition_width
        self.encoder = Encoder(config.channels)
        self.latent = SceneLatent(config) if config.context == "global" else None
        self.score_condition = nn.Sequential(
            nn.Linear(len(self.tasks) + 2 * config.frequencies, condition),
            nn.SiLU(),
            nn.Linear(condition, condition),
            nn.SiLU(),
        )
        self.evaluator_condition = nn.Sequential(nn.Linear(len(self.tasks), condition), nn.SiLU())
        shape = (config.width, config.layers)
        self.score_head = FilmMlp(config.context_width, condition, 6, *shape)
        self.evaluator_head = FilmMlp(config.context_width, condition, 1, *shape)
        kernel = point_kernel(config.kernel_offset_m)
        # A latent is the same at all points: the centre is enough.
        self.register_buffer("kernel", kernel if config.context == "local" else kernel[:1])
        inner = [point_kernel(offset_m)[1:] for offset_m in config.inner_offsets_m]
        # The configuration tells them, so that they need not be kept with the weights.
        points = torch.cat([torch.zeros(0, 3), *inner])
        self.register_buffer("inner_kernel", points, persistent=False)
        self.register_buffer("frequencies", torch.randn(config.frequencies))
        self.close_up = CloseUpNetwork(config.close_up) if config.close_up is not None else None

    def take_over(self, other: "SplitNetwork") -> None:
        """Take over the weights of a network of the same architecture that knows all these tasks.

        The heads see tasks one-hot: of their first layers the columns of these tasks are taken.
        The other network may do without inner points: these start without a say.  Its close-ups
        are taken over where they are of the same kind; otherwise this network's stay as they are.

        Raises ValueError where the architecture is another, or a task is missing.
        """
        own, given = (replace(each.config, close_up=None) for each in (self, other))
        without = replace(own, inner_offsets_m=(), inner_grids=given.inner_grids)
        widened = given == without != own
        if not widened and given != own:
            raise ValueError(f"the other network is of another architecture, {given}, not {own}")
        unknown = [task.name for task in self.tasks if task not in other.tasks]
        if unknown:
            raise ValueError(f"the other network does not know {', '.join(unknown)}")
        columns = torch.tensor([other.tasks.index(task) for task in self.tasks])
        weights = dict(other.state_dict())
        if self.config.close_up != other.config.close_up:
            weights = {n: value for n, value in weights.items() if not n.startswith(_CLOSE_UP)}
            weights |= {n: v for n, v in self.state_dict().items() if n.startswith(_CLOSE_UP)}
        for name in ("score_condition.0.weight", "evaluator_condition.0.weight"):
            of_tasks, rest = weights[name].tensor_split([len(other.tasks)], 1)
            weights[name] = torch.cat([of_tasks[:, columns.to(of_tasks.device)], rest], 1)
        if widened:
            for name in ("score_head.input.weight", "evaluator_head.input.weight"):
                weights[name] = self._with_inner_columns(weights[name])
        self.load_state_dict(weights)

    def _with_inner_columns(self, weight: Tensor) -> Tensor:
        """Return a first layer's weight (width, inputs) with columns of 0 for the inner points."""
        outer, of_pose = weight.tensor_split([weight.shape[1] - self.config.pose_width], 1)
        inner = weight.new_zeros(len(weight), self.config.inner_width)
        return torch.cat([outer, inner, of_pose], 1)

    @property
    def device(self) -> torch.device:
        """Where the parameters are."""
        return self.kernel.device

    def encode(
        self, occupied: Tensor, encoder: Callable[[Tensor], list[Tensor]] | None = None
    ) -> FeatureTables:
        """Return features of scenes given by their occupancy (B, r, r, r), indexed [x, y, z].

        `encoder` takes the place of the network's own.
        """
        config = self.config
        voxel_m = config.edge_m / config.resolution
        heights_m = (torch.arange(config.resolution, device=occupied.device) + 0.5) * voxel_m
        below = (heights_m < config.table_m).expand(occupied.shape)
        x = torch.stack([occupied, below], -1).float()  # PyTorch's "channels last"
        grids = (encoder or self.encoder)(x.permute(0, 4, 1, 2, 3))
        if self.latent is not None:
            chosen = [self.latent(grids[-1])[:, :, None, None, None]]
        else:
            chosen = [grids[i] for i in config.context_grids]
        return FeatureTables.from_grids(chosen, config.edge_m)

    def local_context(self, tables: FeatureTables, X_VPs: Tensor) -> Tensor:
        """Return the context (B, N, context_width) of poses (B, N, 4, 4)."""
        parts = [tables.around(X_VPs, self.kernel)]
        if len(self.inner_kernel):
            parts.append(self.inner_tables(tables).around(X_VPs, self.inner_kernel))
        if self.config.pose_width:
            parts.append(pose_numbers(X_VPs, tables.edge_m)[..., -self.config.pose_width :])
        return torch.cat(parts, -1)

    def inner_tables(self, tables: FeatureTables) -> FeatureTables:
        """Return those of a scene's tables that are looked up at the inner points."""
        grids = self.config.context_grids
        return tables.only([grids.index(grid) for grid in self.config.inner_grids])

    def score(self, context: Tensor, tasks: Tensor, sigma: Tensor) -> Tensor:
        """Return sigma * score (G, N, 6) in the poses' frames, units [length_m, rad].

        Args:
            context: (G, N, context_width): G groups, each of one task and one sigma.
            tasks: (G,) indices into the network's tasks.
            sigma: (G,) noise levels.
        """
        angle = torch.log(sigma)[:, None] * self.frequencies
        one_hot = functional.one_hot(tasks, len(self.tasks)).to(angle)
        condition = torch.cat([one_hot, angle.sin(), angle.cos()], -1)
        score = self.score_head(context, self.score_condition(condition))
        if self.config.score_frame == "sample":
            return score
        return in_pose_axes(score, context[..., -9:].unflatten(-1, (3, 3)))

    def evaluate(self, context: Tensor, tasks: Tensor) -> Tensor:
        """Return logits (G, N) that poses are right, for contexts (G, N, ...), tasks (G,)."""
        one_hot = functional.one_hot(tasks, len(self.tasks)).to(context)
        return self.evaluator_head(context, self.evaluator_condition(one_hot))[..., 0]
