"""Which mugs of a folder are usable: each is tried, and one that fails costs a line."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

from rich.console import Console

from split_drake.experiments.pool import WorkerPool
from split_drake.objects.mug_shape import InvalidMugError
from split_drake.objects.scanned.files import ReadMug
from split_drake.objects.scanned.mug_source import MugSource

# What is done with a mug, by name; it raises ValueError or RuntimeError where the mug is of no use.
Trial = Callable[[str, ReadMug], None]

# A mug takes seconds, a decomposition minutes.
_LIMIT_S = 1200.0


@dataclass(frozen=True)
class UsableMugs:
    """The mugs of a source, sorted.

    Attributes:
        source: of those that are usable.
        refused: {name, or file without one: one sentence that says why}, sorted.
        remarks: {name: what was assumed of its file}, of those of which anything was, sorted.
    """

    source: MugSource
    refused: dict[str, str] = field(default_factory=dict)
    remarks: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Verdict:
    """What came of one mug.

    Attributes:
        name: of the mug.
        fault: one sentence that says why it is refused; empty where it is usable.
        remarks: what was assumed of its file; empty where nothing was.
    """

    name: str
    fault: str
    remarks: str


def usable_mugs(
    source: MugSource, workers: int, console: Console, trial: Trial | None = None
) -> UsableMugs:
    """Return which mugs of a folder are usable, and print a line for each other one.

    Each is loaded, and gone through `trial` (pickled), in a process of its own; of a fixed split
    all are usable, unseen.

    Raises InvalidMugError, a line for each mug, where none is usable.
    """
    if source.folder is None:
        return UsableMugs(source)
    names = source.names()
    with console.status(f"checking {len(names)} mugs of {source.where}"):
        verdicts = mug_verdicts(source, workers, trial)
    faults = {verdict.name: verdict.fault for verdict in verdicts if verdict.fault}
    refused = dict(sorted({**source.unclear(), **faults}.items()))
    if len(faults) == len(names):
        raise InvalidMugError(
            "\n".join([f"{source.where} holds no usable mug:", *refused.values()])
        )
    for reason in refused.values():
        console.print(f"left out: {reason}", style="yellow", markup=False, soft_wrap=True)
    remarks = {verdict.name: verdict.remarks for verdict in verdicts if verdict.remarks}
    for name, remark in remarks.items():
        if name not in faults:
            console.print(f"{name}: {remark}", markup=False, soft_wrap=True)
    left_out = tuple(sorted({*source.left_out, *faults}))
    return UsableMugs(replace(source, left_out=left_out), refused, remarks)


def mug_verdicts(source: MugSource, workers: int, trial: Trial | None = None) -> list[Verdict]:
    """Return what comes of each mug of a source, sorted by name; see `usable_mugs`."""
    pool = WorkerPool(partial(_verdict, source, trial), workers, _crashed, limit_s=_LIMIT_S)
    return sorted(pool.run(source.names()), key=lambda verdict: verdict.name)


def _verdict(source: MugSource, trial: Trial | None, name: str) -> Verdict:
    try:
        mug = source.read(name)
        if trial is not None:
            trial(name, mug)
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        return Verdict(name, reason if name in reason else f"{name}: {reason}", "")
    return Verdict(name, "", "; ".join(mug.remarks))


def _crashed(name: str, reason: str) -> Verdict:
    return Verdict(name, f"{name}: while it was loaded, {reason}; expected a mug", "")
