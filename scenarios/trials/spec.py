"""What determines a trial."""

from dataclasses import dataclass, field, replace
from pathlib import Path

from planning.subgoal import Subgoal
from scenarios.trials.pose_noise import PoseNoise
from split_drake.bad_input import require_numbers
from split_drake.objects.mug_shape import MugShape
from split_drake.objects.scanned.mug_source import MugSource
from split_drake.station.config import StationConfig


@dataclass(frozen=True)
class TrialSpec:
    """Everything that determines a trial's outcome, and where it is recorded.

    Attributes:
        index: of the trial in its run.
        seed: of everything that the trial draws.
        mugs: that take turns by seed.
        task: to be reached.
        detector, planner, checkpoint, noise_m, record, evaluations: as in MugHangOptions.
        folder: of the run.
        station: layout, contact and control.
        mass_kg: of every mug, where not its own.
        pose_noise: on the poses of the oracle.
        feedback, check_plans, objects: as in MugHangOptions.
    """

    index: int
    seed: int
    mugs: MugSource
    task: Subgoal
    detector: str
    planner: str
    checkpoint: Path | None
    noise_m: float
    record: str
    folder: Path
    station: StationConfig
    mass_kg: float | None = None
    pose_noise: PoseNoise = field(default_factory=PoseNoise)
    feedback: bool = True
    check_plans: bool = False
    objects: int = 0
    evaluations: int = 4

    def __post_init__(self) -> None:
        require_numbers(self)

    def mug_names(self) -> tuple[str, ...]:
        """Return the source's mugs from this trial's on, each once."""
        names = self.mugs.names()
        first = self.seed % len(names)
        return names[first:] + names[:first]

    def load_mug(self, name: str) -> MugShape:
        """Return a mug of the source, as heavy as this trial wants it."""
        mug = self.mugs.load(name)
        if self.mass_kg is None:
            return mug
        return replace(mug, body=mug.body.with_mass(self.mass_kg))
