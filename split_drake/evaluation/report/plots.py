"""Pictures of an evaluation: reliability of the evaluator's scores, and errors of the poses."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from split_drake.evaluation.judgement import GOOD_POSITION_M, GOOD_ROTATION_RAD
from split_drake.evaluation.record import SceneRecord

# The errors that are shown of the tasks that have them: name, unit, what counts as good, shown to.
_ERRORS = (
    ("position_mm", "position error, mm", 1000.0 * GOOD_POSITION_M, 20.0),
    ("axis_deg", "axis error, degrees", float(np.degrees(GOOD_ROTATION_RAD)), 30.0),
    ("rotation_deg", "rotation error, degrees", float(np.degrees(GOOD_ROTATION_RAD)), 30.0),
)


def plot_reliability(metrics: Mapping[str, Any], tasks: Sequence[str], path: Path) -> None:
    """Write how the share of good samples follows the score, above how many samples there are."""
    figure = Figure(figsize=(6.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    for task in tasks:
        for name, style in (("calibration", "-"), ("calibration_in_physics", "--")):
            calibration = metrics["tasks"][task][name]
            if calibration is None:
                continue
            bins = calibration["bins"]
            judge = "in physics" if style == "--" else "geometrically"
            label = f"{task}, {judge}: error {calibration['expected_error']:.3f}"
            (line,) = above.plot(bins["scores"], bins["shares"], style, marker=".", label=label)
            below.plot(bins["scores"], bins["counts"], style, color=line.get_color())
    above.set(ylabel="share good", title="Reliability of the evaluator", ylim=(0, 1.02))
    below.set(xlabel="score", ylabel="samples", yscale="log", xlim=(0, 1))
    if above.lines[1:]:
        above.legend()
    figure.savefig(path, dpi=150)


def plot_errors(records: Sequence[SceneRecord], tasks: Sequence[str], path: Path) -> None:
    """Write how the errors of the top-ranked poses of some tasks are distributed.

    Solid lines are scenes that show the object's feature, dashed ones scenes that don't.
    """
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    for axes, (name, label, good, limit) in zip(figure.subplots(1, 3), _ERRORS, strict=True):
        for number, task in enumerate(tasks):
            for visible, style in ((True, "-"), (False, "--")):
                values = _errors(records, task, name, visible)
                if values:
                    group = task if visible else f"{task}, feature hidden"
                    axes.ecdf(values, ls=style, color=f"C{number}", label=group)
        axes.axvline(good, color="0.7", linewidth=1)
        axes.set(xlabel=label, ylabel="share of scenes", xlim=(0, limit), ylim=(0, 1.02))
        if axes.lines[1:]:
            axes.legend(loc="lower right")
    figure.savefig(path, dpi=150)


def _errors(records: Sequence[SceneRecord], task: str, name: str, visible: bool) -> list[float]:
    """Return the error of that name in the scenes where there is one."""
    values = [record.tasks[task].values for record in records if record.visible == visible]
    return [each[name] for each in values if name in each]
