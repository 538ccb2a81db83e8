"""SPLIT as a pose detector: a scene in, ranked pose sets out."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np
import torch
from torch import Tensor

from split_drake.pose_set import PoseSet
from split_drake.pose_task import PoseTask
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.inference import ScenePredictor
from split_drake.split.network import SplitNetwork
from split_drake.split.sampling import (
    Integrator,
    LangevinConfig,
    ReverseDiffusion,
    StepCallback,
    annealed_langevin,
    ignore,
)
from split_drake.split.se3 import compose, uniform_rotations

# Of the noise that is injected where samples are to spread, not to gather at the modes.
WIDE_TEMPERATURE = 0.5


@dataclass(frozen=True)
class SamplerConfig:
    """How poses are drawn and chosen.

    Attributes:
        samples: drawn for each task.
        langevin: the dynamics.
        start_margin_m: the samples start uniformly in the box around the scene's points, widened by
            this much.
        threshold: poses that the evaluator scores lower are rejected.  It was trained to accept
            poses perturbed by less than `BatchConfig.evaluator_limit`; scores
            rank poses but are no probabilities.  This threshold rejects a few poses in a hundred.
    """

    samples: int = 256
    langevin: LangevinConfig = field(default_factory=LangevinConfig)
    start_margin_m: float = 0.03
    threshold: float = 0.4

    def __post_init__(self) -> None:
        if self.samples < 1:
            raise ValueError(f"samples is {self.samples}; expected at least 1")
        if not 0.0 <= self.threshold < 1.0:
            raise ValueError(f"threshold is {self.threshold}; expected a score from 0, below 1")


@dataclass(frozen=True)
class ScoredSamples:
    """All poses drawn for one task, before any is rejected.

    Attributes:
        X_WPs: (N, 4, 4) poses in W, in no order.
        scores: (N,) in [0, 1], the evaluator's; higher is better.
    """

    X_WPs: Array
    scores: Array


class SplitDetector:
    """Pose sets by SPLIT's diffusion model (paper section IV).

    Args:
        network: what it predicts with.
        config: how samples are drawn and chosen.
        integrator: how they move, in place of the Langevin dynamics of `config`.
    """

    def __init__(
        self,
        network: SplitNetwork,
        config: SamplerConfig | None = None,
        integrator: Integrator | None = None,
    ) -> None:
        self._network = network.eval()
        self.config = config or SamplerConfig()
        langevin = partial(annealed_langevin, config=self.config.langevin)
        self._integrate: Integrator = integrator or langevin

    @classmethod
    def from_checkpoint(cls, path: Path | None = None, config: SamplerConfig | None = None) -> Self:
        """Return a detector with the weights in `path`, by default those of the project.

        Raises CheckpointError where the file cannot be used.
        """
        network, _ = load_checkpoint(default_weights() if path is None else path)
        return cls(network, config)

    def widened(self) -> "SplitDetector":
        """Return a detector with the same network whose samples spread further.

        80% of the true grasps of training mugs have a sample nearby, in place of 61%, and 85% of
        the grasps are good, in place of 92% (`split_drake.studies.sampler_study`).
        """
        langevin = replace(self.config.langevin, temperature=WIDE_TEMPERATURE)
        return SplitDetector(self._network, replace(self.config, langevin=langevin))

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask], rng: np.random.Generator
    ) -> dict[PoseTask, PoseSet]:
        """Return one pose set for each of `tasks`; empty where all samples were rejected."""
        pose_sets = {}
        for task, samples in self.sample(scene, tasks, rng).items():
            good = samples.scores >= self.config.threshold
            pose_sets[task] = PoseSet.ranked(task, samples.X_WPs[good], samples.scores[good])
        return pose_sets

    @torch.inference_mode()
    def sample(
        self,
        scene: Scene,
        tasks: Sequence[PoseTask],
        rng: np.random.Generator,
        callback: StepCallback | None = None,
    ) -> dict[PoseTask, ScoredSamples]:
        """Return all samples for each of `tasks`.

        Args:
            scene: its workspace must have the size that the network was trained on.
            tasks: those wanted, all sampled in one batch.
            rng: the only source of chance.
            callback: called with (step, X_VPs (tasks, samples, 4, 4)) before each step.
        """
        self._check_workspace(scene.workspace)
        if not tasks:
            return {}
        network, edge_m = self._network, self._network.config.edge_m
        generator = torch.Generator(network.device)
        generator.manual_seed(int(rng.integers(2**63)))
        predictor = ScenePredictor(network, torch.tensor(scene.grid()), tasks)
        process = ReverseDiffusion(
            predictor.score,
            network.config.noise,
            generator,
            confine=lambda p_VPs: p_VPs.clamp(0.0, edge_m),
            callback=callback or ignore,
        )
        X_VPs = self._integrate(process, self._start(scene, len(tasks), generator))
        scores = torch.sigmoid(predictor.evaluate(X_VPs).double()).cpu().numpy()
        X_WPs = X_VPs.double().cpu().numpy()
        X_WPs[..., :3, 3] += scene.workspace.p_WV
        return {task: ScoredSamples(X_WPs[i], scores[i]) for i, task in enumerate(tasks)}

    def _start(self, scene: Scene, tasks: int, generator: torch.Generator) -> Tensor:
        """Return uniformly random poses (tasks, samples, 4, 4) in V around the scene's points."""
        config, device = self._network.config, generator.device
        points = torch.tensor(scene.p_WSs - scene.workspace.p_WV, dtype=torch.float32).to(device)
        low = (points.amin(0) - self.config.start_margin_m).clamp(0.0, config.edge_m)
        high = (points.amax(0) + self.config.start_margin_m).clamp(0.0, config.edge_m)
        shape = (tasks, self.config.samples)
        share = torch.rand((*shape, 3), generator=generator, device=device)
        return compose(uniform_rotations(shape, generator), low + share * (high - low))

    def _check_workspace(self, workspace: Workspace) -> None:
        """Raise ValueError where the scene's cube is not the one the network was trained on."""
        config = self._network.config
        given = (workspace.edge_m, workspace.depth_below_m, Scene.RESOLUTION)
        trained = (config.edge_m, config.table_m, config.resolution)
        if not np.allclose(given, trained):
            raise ValueError(
                f"the scene has (edge_m, depth_below_m, resolution) = {given}; "
                f"the network was trained for {trained}"
            )
