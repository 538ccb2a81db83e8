"""The mug experiment's three figures, the paper's and ours."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from scenarios.trials.mug_tasks import MugTaskName
from scenarios.trials.records import success_rate, trial_run
from split_drake.experiments.run import CONFIG
from split_drake.experiments.statistics import Rate


@dataclass(frozen=True)
class MugFigure:
    """A figure of the experiment.

    Attributes:
        name: of its folder.
        title: how it is shown.
        task: that is carried out.
        detector: where poses come from.
        paper: successes of the paper's 40 trials.
    """

    name: str
    title: str
    task: MugTaskName
    detector: Literal["split", "oracle"]
    paper: Rate

    def read(self, out: Path, seeds: range) -> Rate | None:
        """Return the rate of those trials that were run in a folder of `out`; None of none."""
        folder = out / self.name
        if not (folder / CONFIG).is_file():
            return None
        records = [record for record in trial_run(folder).records() if record.seed in seeds]
        return success_rate(records) if records else None


MUG_FIGURES = (
    MugFigure("mugs-hang-oracle", "hang, true poses", "hang", "oracle", Rate(31, 40)),
    MugFigure("mugs-hang-split", "hang, SPLIT", "hang", "split", Rate(28, 40)),
    MugFigure("mugs-reorient-split", "reorient, SPLIT", "reorient", "split", Rate(37, 40)),
)
