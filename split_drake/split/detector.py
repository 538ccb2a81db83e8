"""SPLIT as a pose detector: a scene in, ranked pose sets out."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Self

import numpy as np
import torch
from torch import Tensor

from split_drake.bad_input import (
    BadInputError,
    require_count,
    require_number,
    require_numbers,
)
from split_drake.pose_set import Acceptance, PoseSet, ScoredPoses, accepted_poses
from split_drake.pose_task import GRASP, PoseTask, find_tasks
from split_drake.poses import Array
from split_drake.scene import Scene, Workspace
from split_drake.split.checkpoint import default_weights, load_checkpoint
from split_drake.split.close_up.choice import worth_a_look
from split_drake.split.close_up.images import shown_by
from split_drake.split.inference.network import InferenceNetwork
from split_drake.split.inference.scene import ScenePredictor
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
from split_drake.split.threads import use_one_thread

# Of the noise that is injected where samples are to spread, not to gather at the modes.
WIDE_TEMPERATURE = 0.5
ACCEPTANCE = Acceptance(least=0.4, enough=0.7)


@dataclass(frozen=True)
class SamplerConfig:
    """How poses are drawn and chosen.

    Attributes:
        samples: drawn for each task.
        langevin: the dynamics.
        start_margin_m: the samples start uniformly in the box around the scene's points, widened by
            this much.
        close_ups: so many of the best grasps, unlike each other, get a second look, where the
            network can take one and the scene has depth images.  The others then have a score of 0.
            0 looks leave all scores as they are.
        acceptance: which poses are kept, by the evaluator's scores.  It was trained to accept poses
            perturbed by less than `BatchConfig.evaluator_limit`; scores rank poses but are no
            probabilities.

    By default the score is evaluated four times.  The evaluator then doubts half of the grasps, and
    these are rejected: of the others as many are good as of 16 evaluations, to a point, and they
    cover as many true grasps (BUILD-notes, split_drake/studies, has the tables).
    """

    samples: int = 256
    langevin: LangevinConfig = field(default_factory=LangevinConfig)
    start_margin_m: float = 0.03
    close_ups: int = 24
    acceptance: Acceptance = ACCEPTANCE

    def __post_init__(self) -> None:
        require_numbers(self)
        if self.samples < 1:
            raise BadInputError(f"samples is {self.samples}; expected at least 1")
        require_number("start_margin_m", self.start_margin_m, 0.0, 1.0)
        require_count("close_ups", self.close_ups)


# What figures of earlier commits were measured with; few of its samples are rejected.
SIXTEEN_EVALUATIONS = SamplerConfig(
    langevin=LangevinConfig(
        steps=15, temperature=0.2, final_sigma=0.06, first_sigma=None, last_sigma=None
    ),
    acceptance=Acceptance(least=0.4, enough=0.4),
)
# By how often the score is evaluated.
SAMPLERS = {each.langevin.evaluations: each for each in (SamplerConfig(), SIXTEEN_EVALUATIONS)}
# In clutter, where what counts is the best of the grasps, and that no object goes without one.  The
# least score is chosen on training objects: what is left at the end of a round has none better.
CLUTTER_SAMPLER = SamplerConfig(acceptance=Acceptance(least=0.25, enough=0.4))
# What figures in clutter of earlier commits were measured with: of four evaluations, and of eight.
ONE_LOOK = replace(CLUTTER_SAMPLER, close_ups=0)
EIGHT_EVALUATIONS = SamplerConfig(
    langevin=replace(SIXTEEN_EVALUATIONS.langevin, steps=7),
    close_ups=0,
    acceptance=Acceptance(least=0.25, enough=0.25),
)


class SplitDetector:
    """Pose sets by SPLIT's diffusion model (paper section IV).

    Attributes:
        tasks: that it knows.
        workspace: the cube that its scenes must be cropped to, wherever that stands.
        config: how samples are drawn and chosen.

    Args:
        network: what it predicts with.  Weights and device must stay as they are: after a change
            another detector is to be made.
        workspace: that it was trained on.
        config: how samples are drawn and chosen.
        integrator: how they move, in place of the Langevin dynamics of `config`.

    Raises ValueError where the network's grid is not the workspace's cube.
    """

    def __init__(
        self,
        network: SplitNetwork | InferenceNetwork,
        workspace: Workspace,
        config: SamplerConfig | None = None,
        integrator: Integrator | None = None,
    ) -> None:
        if isinstance(network, SplitNetwork):
            network = InferenceNetwork(network.eval())
        self._ready, self._network = network, network.network
        self._network.config.require_cube_of(workspace)
        self.tasks = self._network.tasks
        self.workspace = workspace
        self.config = config or SamplerConfig()
        langevin = partial(annealed_langevin, config=self.config.langevin)
        self._integrate: Integrator = integrator or langevin

    @classmethod
    def from_checkpoint(cls, path: Path | None = None, config: SamplerConfig | None = None) -> Self:
        """Return a detector with the weights in `path`, by default those of the project.

        Raises CheckpointError where the file cannot be used.
        """
        network, info = load_checkpoint(default_weights() if path is None else path)
        return cls(network, info.workspace, config)

    @property
    def acceptance(self) -> Acceptance:
        """Which scores are accepted."""
        return self.config.acceptance

    def thorough(self) -> "SplitDetector":
        """Return a detector with the same network that takes 16 evaluations, and is slower.

        However this one samples and accepts.
        """
        return self._with_sixteen(SIXTEEN_EVALUATIONS.langevin)

    def widened(self) -> "SplitDetector":
        """Return a thorough detector whose samples spread further.

        80% of the true grasps of training mugs have a sample nearby, in place of 61%, and 85% of
        the grasps are good, in place of 92% (`split_drake.studies.sampler_study`).
        """
        return self._with_sixteen(
            replace(SIXTEEN_EVALUATIONS.langevin, temperature=WIDE_TEMPERATURE)
        )

    def _with_sixteen(self, langevin: LangevinConfig) -> "SplitDetector":
        """Return a detector of as many samples, from as wide a box, and the long sampler's rest."""
        config = replace(
            SIXTEEN_EVALUATIONS,
            samples=self.config.samples,
            start_margin_m=self.config.start_margin_m,
            close_ups=self.config.close_ups,
            langevin=langevin,
        )
        return SplitDetector(self._ready, self.workspace, config)

    def detect(
        self, scene: Scene, tasks: Sequence[PoseTask | str], rng: np.random.Generator
    ) -> dict[str, PoseSet]:
        """Return a pose set for each of `tasks`, by their names; empty where all were rejected.

        Raises UnknownTaskError naming the checkpoint's tasks, for any other.
        """
        known = find_tasks(tasks, self.tasks, "the checkpoint")
        return accepted_poses(self.sample(scene, known, rng), known, self.acceptance)

    @torch.inference_mode()
    def sample(
        self,
        scene: Scene,
        tasks: Sequence[PoseTask | str],
        rng: np.random.Generator,
        callback: StepCallback | None = None,
    ) -> dict[str, ScoredPoses]:
        """Return all samples for each of `tasks`, by their names.

        Where grasps are looked at twice, those that are not have a score of 0.

        Args:
            scene: its workspace must have the size that the network was trained on.
            tasks: those wanted, or their names; all sampled in one batch.
            rng: the only source of chance.
            callback: called with (step, X_VPs (tasks, samples, 4, 4)) before each step.
        """
        self._check_workspace(scene.workspace)
        known = find_tasks(tasks, self.tasks, "the checkpoint")
        if not known:
            return {}
        network, edge_m = self._network, self._network.config.edge_m
        generator = torch.Generator(network.device)
        generator.manual_seed(int(rng.integers(2**63)))
        predictor = ScenePredictor(self._ready, torch.tensor(scene.grid()), known)
        process = ReverseDiffusion(
            predictor.score,
            network.config.noise,
            generator,
            confine=lambda p_VPs: p_VPs.clamp(0.0, edge_m),
            callback=callback or ignore,
        )
        X_VPs = self._integrate(process, self._start(scene, len(known), generator))
        logits = predictor.evaluate(X_VPs).double().cpu()
        X_WPs = X_VPs.double().cpu().numpy()
        X_WPs[..., :3, 3] += scene.workspace.p_WV
        if GRASP in known:
            number = known.index(GRASP)
            logits[number] = self._looked_at_again(scene, X_WPs[number], logits[number])
        scores = torch.sigmoid(logits).numpy()
        return {task.name: ScoredPoses(X_WPs[i], scores[i]) for i, task in enumerate(known)}

    def _looked_at_again(self, scene: Scene, X_WGs: Array, logits: Tensor) -> Tensor:
        """Return the logits (N,) of grasps (N, 4, 4) after a second look at the best of them.

        It is told from other things than the first, so that their logits are added.
        """
        network = self._network.close_up
        if network is None or not scene.views or not self.config.close_ups:
            return logits
        best = worth_a_look(X_WGs, logits.numpy(), self.config.close_ups)
        seen = shown_by(scene.views, scene.workspace, X_WGs[best], network.config)
        again = torch.full_like(logits, -torch.inf)
        again[best] = logits[best] + network(seen.to(self._network.device)).double().cpu()
        return again

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
        """Raise ValueError where the scene's cube is not the one the network was trained on.

        Nor where another height counts as table: that changes which points are seen.
        """
        trained = self.workspace
        names = ("edge_m", "depth_below_m", "table_clearance_m")
        given = (*(getattr(workspace, name) for name in names), Scene.RESOLUTION)
        known = (*(getattr(trained, name) for name in names), self._network.config.resolution)
        if not np.allclose(given, known):
            raise ValueError(
                f"the scene has ({', '.join(names)}, resolution) = {given}; "
                f"the network was trained for {known}"
            )


def single_threaded_detector(
    path: Path | None = None, config: SamplerConfig | None = None
) -> SplitDetector:
    """Return a detector of this process, on one thread: results depend on their number."""
    use_one_thread()
    return SplitDetector.from_checkpoint(path, config)
