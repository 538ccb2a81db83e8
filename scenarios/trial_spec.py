"""What determines a trial."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

from planning.problem import Subgoal
from split_drake.data.mugs import Split, mug_names

if TYPE_CHECKING:
    from scenarios.mug_hang import MugHangOptions


@dataclass(frozen=True)
class TrialSpec:
    """Everything that determines a trial's outcome, and where it is recorded.

    Attributes:
        index: of the trial in its run.
        seed: of everything that the trial draws.
        mugs: split that the shapes come from; its mugs take turns by seed.
        task: to be reached.
        detector, planner, checkpoint, noise_m, record: as in MugHangOptions.
        folder: of the run.
    """

    index: int
    seed: int
    mugs: Split
    task: Subgoal
    detector: str
    planner: str
    checkpoint: Path | None
    noise_m: float
    record: str
    folder: Path

    @classmethod
    def of(cls, options: "MugHangOptions", index: int, folder: Path) -> Self:
        """Return trial `index` of a run."""
        return cls(
            index=index,
            seed=options.seed + index,
            mugs=options.mugs,
            task=Subgoal(options.task),
            detector=options.detector,
            planner=options.planner,
            checkpoint=options.checkpoint,
            noise_m=options.noise_m,
            record=options.record,
            folder=folder,
        )

    def mug_names(self) -> tuple[str, ...]:
        """Return the split's mugs from this trial's on, each once."""
        names = mug_names(self.mugs)
        first = self.seed % len(names)
        return names[first:] + names[:first]
