"""Training of the network that takes a second look, on grasps that were judged.

A step's batch depends on the seed and the step's number alone, so that any number of processes may
draw batches.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional
from torch.utils.data import DataLoader, Dataset

from split_drake.bad_input import BadInputError
from split_drake.evaluation.calibration import area_under_curve
from split_drake.experiments.run import CONFIG
from split_drake.files import interpreting, read_json_object, read_npz
from split_drake.scene import Workspace
from split_drake.split.close_up.choice import worth_a_look
from split_drake.split.close_up.config import CloseUpConfig
from split_drake.split.close_up.images import DepthTensor, close_ups
from split_drake.split.close_up.network import CloseUpNetwork
from split_drake.tuning.judged_views import BEST, DEPTH_UNIT_M

# Of each so many shards the last is not trained on, but tells what training has brought.
HELD_OUT = 10
# Of a batch's grasps of a scene, these are among the best by the first look.
BEST_SHARE = 0.75
# Half of the images have normal noise up to this; a quarter a smooth error as VGN's images have it
# (5 mm, drawn at a quarter of the resolution); the others none.  All have a scale that is off by
# as much as is left once a table has been fitted.
NORMAL_SHARE, MOST_NORMAL_M = 0.5, 0.007
SMOOTH_SHARE, SMOOTH_M, SMOOTH_PIXELS = 0.25, 0.005, 4
SCALE_ERROR = 0.001
MEASURED_NOISE_M = 0.005
GRADIENT_NORM = 1.0
# On CPUs the bfloat16 gradients of 3D convolutions are wrong on smaller volumes (oneDNN 3).
SMALLEST_AUTOCAST = 5
_ARRAYS = ("depths", "sizes", "focal_px", "center_px", "X_WCs", "sampled", "logits", "held")


@dataclass(frozen=True)
class JudgedViews:
    """Judged grasps of S scenes and their images in memory, see `judged_views`.

    Attributes:
        arrays: by their names.
        starts: (S,) where each scene's pixels begin.
        workspace: that the scenes were cropped to.
        checkpoint: SHA-256 of the file of the model that drew the grasps.
    """

    arrays: dict[str, np.ndarray]
    starts: NDArray[np.int_]
    workspace: Workspace
    checkpoint: str

    @classmethod
    def open(cls, folder: Path, held_out: bool) -> Self:
        """Read the shards of a folder that are held out, or those that are not.

        Raises BadInputError where some are missing, or too few to hold one out.
        """
        path = folder / CONFIG
        if not path.is_file():
            raise BadInputError(f"{path} does not exist; expected a folder of judged views")
        config = read_json_object(path, "what grasps were judged with")
        with interpreting(path, "a folder of judged views"):
            names, workspace = config["shards"], Workspace.from_fields(config["workspace"])
            checkpoint = str(config["checkpoint"])
        if len(names) < HELD_OUT:
            raise BadInputError(
                f"{folder} has {len(names)} shards; expected at least {HELD_OUT}, to hold one out"
            )
        paths = [
            folder / f"{name}.npz"
            for number, name in enumerate(names)
            if (number % HELD_OUT == HELD_OUT - 1) == held_out
        ]
        if missing := [path for path in paths if not path.is_file()]:
            raise BadInputError(
                f"{len(missing)} shards are missing, {missing[0]} the first; judge them first"
            )
        shards = [read_npz(path, "a shard of judged views", required=_ARRAYS) for path in paths]
        with interpreting(folder, "a folder of judged views"):
            arrays = {key: np.concatenate([shard[key] for shard in shards]) for key in _ARRAYS}
            pixels = arrays["sizes"].astype(int).prod(axis=1)
            if pixels.sum() != len(arrays["depths"]):
                raise ValueError("images have other sizes than their pixels")
        return cls(arrays, np.cumsum(pixels) - pixels, workspace, checkpoint)

    def __len__(self) -> int:
        return len(self.starts)

    def close_ups(
        self, scene: int, grasps: NDArray[np.int_], depth_m: Tensor, config: CloseUpConfig
    ) -> Tensor:
        """Return close-ups (N, 4, nx, ny, nz) of some grasps (N,) of a scene in a noisy image."""
        image = DepthTensor(
            depth_m,
            torch.tensor(self.arrays["focal_px"][scene]),
            torch.tensor(self.arrays["center_px"][scene]),
            torch.tensor(self.arrays["X_WCs"][scene]),
        )
        X_WGs = torch.tensor(self.arrays["sampled"][scene, grasps])
        return close_ups([image.smoothed()], X_WGs, self.workspace.p_WCenter[2], config)

    def depth_m(self, scene: int) -> Tensor:
        """Return a scene's image (H, W), without noise."""
        height, width = self.arrays["sizes"][scene]
        start = self.starts[scene]
        pixels = self.arrays["depths"][start : start + height * width].astype(np.float32)
        return torch.tensor(pixels.reshape(height, width) * np.float32(DEPTH_UNIT_M))


def with_some_noise(depth_m: Tensor, generator: torch.Generator) -> Tensor:
    """Return an image (H, W) with one of the kinds of noise that cameras have."""
    kind, size, scale = torch.rand(3, generator=generator).tolist()
    noise = torch.zeros_like(depth_m)
    if kind < NORMAL_SHARE:
        noise = size * MOST_NORMAL_M * torch.randn(depth_m.shape, generator=generator)
    elif kind < NORMAL_SHARE + SMOOTH_SHARE:
        height, width = (-(-side // SMOOTH_PIXELS) for side in depth_m.shape)
        coarse = SMOOTH_M * torch.randn((1, 1, height, width), generator=generator)
        fine = functional.interpolate(coarse, scale_factor=SMOOTH_PIXELS, mode="bilinear")
        noise = fine[0, 0, : depth_m.shape[0], : depth_m.shape[1]]
    noisy = depth_m * (1.0 + SCALE_ERROR * (2.0 * scale - 1.0)) + noise
    return torch.where(depth_m > 0.0, noisy.clamp_min(0.0), 0.0)


class CloseUpBatches(Dataset[tuple[Tensor, Tensor]]):
    """The batches of all steps: close-ups (B, 4, nx, ny, nz) and whether grasps hold (B,).

    Args:
        judged: what they are drawn from.
        config: what close-ups show.
        steps: how many batches.
        scenes, grasps: of a batch, and of each of its scenes.
        seed: of the draws, together with the step's number.
    """

    def __init__(
        self,
        judged: JudgedViews,
        config: CloseUpConfig,
        steps: range,
        scenes: int,
        grasps: int,
        seed: int,
    ) -> None:
        self._judged, self._config, self._steps = judged, config, steps
        self._scenes, self._grasps, self._seed = scenes, grasps, seed

    def __len__(self) -> int:
        return len(self._steps)

    def __getitem__(self, number: int) -> tuple[Tensor, Tensor]:
        rng = np.random.default_rng([self._seed, self._steps[number]])
        generator = torch.Generator().manual_seed(int(rng.integers(2**63)))
        shown, held = list[Tensor](), list[Tensor]()
        for scene in rng.integers(len(self._judged), size=self._scenes):
            grasps = self._some(rng)
            image = with_some_noise(self._judged.depth_m(scene), generator)
            cells = self._judged.close_ups(scene, grasps, image, self._config)
            # A hand is its own mirror image across both planes through its approach.
            mirrored = [axis for axis in (2, 3) if rng.random() < 0.5]
            shown.append(cells.flip(mirrored))
            held.append(torch.tensor(self._judged.arrays["held"][scene, grasps]).float())
        return torch.cat(shown), torch.cat(held)

    def _some(self, rng: np.random.Generator) -> NDArray[np.int_]:
        count = self._judged.arrays["held"].shape[1]
        best = min(BEST, count)
        first = rng.permutation(best)[: round(BEST_SHARE * self._grasps)]
        rest = rng.permutation(np.arange(best, count))[: self._grasps - len(first)]
        return np.concatenate([first, rest])


def train_steps(
    network: CloseUpNetwork,
    adam: torch.optim.Optimizer,
    batches: CloseUpBatches | Sequence[tuple[Tensor, Tensor]],
    workers: int,
    bfloat16: bool,
) -> Iterator[float]:
    """Train on all batches, which `workers` processes draw; yield the loss of each step.

    Large enough convolutions are computed in bfloat16 where that is asked for.
    """
    loader: DataLoader[tuple[Tensor, Tensor]] = DataLoader(
        cast("Dataset[tuple[Tensor, Tensor]]", batches), batch_size=None, num_workers=workers
    )
    network.train()
    halved = min(-(-count // 2) for count in network.config.cells)
    bfloat16 = bfloat16 and halved >= SMALLEST_AUTOCAST
    for shown, held in loader:
        with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16):
            logits = network(shown)
        loss = functional.binary_cross_entropy_with_logits(logits.float(), held)
        adam.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), GRADIENT_NORM)
        adam.step()
        yield loss.item()


@torch.no_grad()
def second_look(network: CloseUpNetwork, judged: JudgedViews, looks: int) -> dict[str, float]:
    """Return how well grasps are ranked by the first look, the second, and both.

    Of each scene `looks` of the best by the first look count, chosen by `worth_a_look`; images have
    5 mm of normal noise.  "auc" is over the grasps of all scenes, "top" the share of scenes
    whose best one holds; "any" that of scenes of which one does.
    """
    generator = torch.Generator().manual_seed(0)
    network.eval()
    chosen, second = [], []
    for scene in range(len(judged)):
        depth_m = judged.depth_m(scene)
        noise = MEASURED_NOISE_M * torch.randn(depth_m.shape, generator=generator)
        image = torch.where(depth_m > 0.0, (depth_m + noise).clamp_min(0.0), 0.0)
        sampled, first = (judged.arrays[name][scene, :BEST] for name in ("sampled", "logits"))
        chosen.append(worth_a_look(sampled, first, looks))
        shown = judged.close_ups(scene, chosen[-1], image, network.config)
        second.append(network(shown).numpy())
    rows, grasps = np.arange(len(judged))[:, None], np.stack(chosen)
    held = judged.arrays["held"][rows, grasps]
    logits = {"first": judged.arrays["logits"][rows, grasps], "second": np.stack(second)}
    logits["both"] = logits["first"] + logits["second"]
    rows = np.arange(len(held))
    found = {f"auc_{name}": area_under_curve(x.ravel(), held.ravel()) for name, x in logits.items()}
    found |= {f"top_{name}": float(held[rows, x.argmax(1)].mean()) for name, x in logits.items()}
    return found | {"any": float(held.any(axis=1).mean())}
