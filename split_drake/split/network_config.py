"""What it takes to rebuild a network."""

from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

import tyro

from split_drake.bad_input import require_numbers
from split_drake.scene import Workspace
from split_drake.split.close_up.config import CloseUpConfig
from split_drake.split.diffusion import NoiseSchedule

INPUT_CHANNELS = 2  # occupied; below the table

ContextKind = Literal["local", "global"]
ScoreFrame = Literal["sample", "global"]


@dataclass(frozen=True)
class SplitConfig:
    """What it takes to rebuild a network.

    The defaults are SPLIT; the other values of `context` and `score_frame` take away one of its two
    ideas each, locality and symmetry (paper IV-B), and exist for `split_drake.studies.ablate`.

    Attributes:
        channels: of the encoder's blocks; each halves the resolution.
        context_grids: which grids the context is made of: 0 is the input, i the output of block i.
        kernel_offset_m: distance of the six outer kernel points (paper: 8 cm).
        inner_offsets_m: distances of six further points each, of which the context has the features
            of `inner_grids` (none in the paper): fingers reach 4 cm aside, where 8 cm show little.
        inner_grids: those of the `context_grids` that are looked up there.
        width, layers: of the score and evaluator MLPs.
        frequencies: Gaussian Fourier features of log sigma, a sine and a cosine each.
        condition_width: of the vector that FiLM layers are conditioned on.
        resolution, edge_m: of the input grid.
        table_m: height of the table above V.
        noise: schedule that the score head was trained for.
        context: what scores are predicted from.  "local": features at the kernel's points around
            the pose.  "global": one latent of the whole scene and the numbers of the pose, as in
            SE(3)-DiffusionFields; `context_grids` and `kernel_offset_m` have no part in it.
        score_frame: the axes that the score head answers in: "sample", the pose's own, or "global",
            those of V, for which it is told the pose's rotation.
        close_up: of the network that takes a second look at the best grasps; None for none.  It is
            trained by itself, by `split_drake.tuning.train_close_up`.
    """

    channels: tuple[int, ...] = (16, 32, 64, 96, 128)
    context_grids: tuple[int, ...] = (0, 1, 2, 3, 5)
    kernel_offset_m: float = 0.08
    inner_offsets_m: tuple[float, ...] = ()
    inner_grids: tuple[int, ...] = (0, 1, 2)
    width: int = 256
    layers: int = 8
    frequencies: int = 32
    condition_width: int = 64
    resolution: int = 64
    edge_m: float = 0.3
    table_m: float = 0.05
    noise: NoiseSchedule = field(default_factory=NoiseSchedule)
    context: ContextKind = "local"
    score_frame: ScoreFrame = "sample"
    close_up: Annotated[CloseUpConfig | None, tyro.conf.Suppress] = None

    def __post_init__(self) -> None:
        require_numbers(self)
        needed = 2 ** (len(self.channels) + 1)
        if self.resolution < needed:
            raise ValueError(f"resolution is {self.resolution}; the blocks need {needed} or more")
        if not set(self.context_grids) <= set(range(len(self.channels) + 1)):
            raise ValueError(
                f"context_grids={self.context_grids}; expected numbers from 0 to "
                f"{len(self.channels)}"
            )
        if self.inner_offsets_m and not set(self.inner_grids) <= set(self.context_grids):
            raise ValueError(
                f"inner_grids={self.inner_grids}; expected some of the context's, "
                f"{self.context_grids}"
            )
        if self.inner_offsets_m and self.context == "global":
            raise ValueError(
                f"inner_offsets_m={self.inner_offsets_m}; expected none with the global context"
            )
        if self.layers < 3:
            raise ValueError(f"layers is {self.layers}; expected at least 3")
        for name, choices in (("context", ContextKind), ("score_frame", ScoreFrame)):
            if (value := getattr(self, name)) not in get_args(choices):
                raise ValueError(f"{name} is {value!r}; expected one of {get_args(choices)}")

    def require_cube_of(self, workspace: Workspace) -> None:
        """Raise ValueError where the grid is not as large and as deep as a workspace's cube."""
        if (self.edge_m, self.table_m) != (workspace.edge_m, workspace.depth_below_m):
            raise ValueError(
                f"the network's grid has edge_m={self.edge_m} and table_m={self.table_m}; the "
                f"workspace has edge_m={workspace.edge_m} and "
                f"depth_below_m={workspace.depth_below_m}: expected the same"
            )

    @property
    def latent_width(self) -> int:
        """Features of a scene in the global context: about as many parameters as the local one."""
        return 2 * self.width

    @property
    def pose_width(self) -> int:
        """How many of the `pose_numbers`, the last of them, stand at the end of a context."""
        if self.context == "global":
            return 12
        return 9 if self.score_frame == "global" else 0

    @property
    def inner_width(self) -> int:
        """Features of a pose's context at the inner points; they stand before the pose's own."""
        return 6 * len(self.inner_offsets_m) * sum(map(self._channels_of, self.inner_grids))

    @property
    def context_width(self) -> int:
        """Features of a pose's context: those of the scene, then numbers of the pose itself."""
        if self.context == "global":
            return self.latent_width + self.pose_width
        outer = 7 * sum(map(self._channels_of, self.context_grids))
        return outer + self.inner_width + self.pose_width

    def _channels_of(self, grid: int) -> int:
        return (INPUT_CHANNELS, *self.channels)[grid]
