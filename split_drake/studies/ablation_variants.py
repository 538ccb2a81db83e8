"""What the ablation compares: SPLIT with one of its ideas taken away at a time.

All networks are trained on equally many scenes, with the same seed, and evaluated on the same test
scenes.
"""

from dataclasses import dataclass, field
from pathlib import Path

from split_drake.pose_task import MUG_TASKS, PoseTask
from split_drake.split.network_config import SplitConfig

NOISE_M = 0.005
OTHER_NOISES_M = (0.002, 0.010)


@dataclass(frozen=True)
class Model:
    """A network that is trained for the ablation.

    Attributes:
        name: of its folder.
        network, tasks: what differs from the defaults is what the ablation is about.
    """

    name: str
    network: SplitConfig = field(default_factory=SplitConfig)
    tasks: tuple[str, ...] = tuple(task.name for task in MUG_TASKS)

    def folder(self, out: Path) -> Path:
        """Return the folder of its training run, of an ablation in `out`."""
        return out / "models" / self.name


def _model_of_task(task: PoseTask) -> Model:
    """Return a model that is trained for one task alone, with as many poses of it a scene."""
    return Model(f"only_{task}", tasks=(task.name,))


FULL = Model("full")
GLOBAL_LATENT = Model("global_latent", SplitConfig(context="global", score_frame="global"))
GLOBAL_LATENT_SAMPLE_FRAME = Model("global_latent_sample_frame", SplitConfig(context="global"))
GLOBAL_FRAME = Model("global_frame", SplitConfig(score_frame="global"))
ONE_PER_TASK = tuple(_model_of_task(task) for task in MUG_TASKS)

MODELS = (FULL, GLOBAL_LATENT, GLOBAL_LATENT_SAMPLE_FRAME, GLOBAL_FRAME, *ONE_PER_TASK)


@dataclass(frozen=True)
class Variant:
    """A row of the table.

    Attributes:
        name: of the row.
        change: what differs from SPLIT, in words.
        models: one for all tasks, or one each; none: the weights that ship.
        ranked: whether the evaluator ranks and rejects samples; otherwise chance ranks them.
        noise_m: standard deviation of the noise on the points.
    """

    name: str
    change: str
    models: tuple[Model, ...]
    ranked: bool = True
    noise_m: float = NOISE_M

    @property
    def folder_name(self) -> str:
        """Name of the folder of its evaluation."""
        return f"{self.name.replace(' ', '_').replace(',', '')}_{self.noise_m * 1000:.0f}mm"


VARIANTS = (
    Variant("full", "SPLIT", (FULL,)),
    Variant("global latent", "no local kernel, score in V's axes", (GLOBAL_LATENT,)),
    Variant("global latent, sample frame", "no local kernel", (GLOBAL_LATENT_SAMPLE_FRAME,)),
    Variant("global-frame score", "score in V's axes", (GLOBAL_FRAME,)),
    Variant("without evaluator", "samples ranked by chance", (FULL,), ranked=False),
    Variant("three models", "a model for each task", ONE_PER_TASK),
    *(Variant("full", "SPLIT", (FULL,), noise_m=noise_m) for noise_m in OTHER_NOISES_M),
    *(
        Variant("shipped weights", "trained for longer", (), noise_m=noise_m)
        for noise_m in (NOISE_M, *OTHER_NOISES_M)
    ),
)
