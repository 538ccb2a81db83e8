"""Small plots for pages, as SVG."""

import io
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from split_drake.experiments.statistics import Rate

_SIZE_IN = (4.2, 2.4)
_COLOUR = "#1f6f8b"
_FEW_BARS = 4


def rates_along(
    name: str, values: Sequence[float], outcomes: Sequence[bool], edges: Sequence[float]
) -> str:
    """Return a plot of rates with Wilson's 95% intervals over bins of a value.

    Args:
        name: of the value, with its unit.
        values, outcomes: of each trial.
        edges: of the bins; those without a trial are left out.
    """
    bins = np.digitize(values, edges[1:-1])
    rates = {
        number: Rate.of(outcome for outcome, at in zip(outcomes, bins, strict=True) if at == number)
        for number in range(len(edges) - 1)
    }
    found = {number: rate for number, rate in rates.items() if rate.trials}
    figure, axes = _axes()
    for number, rate in found.items():
        low, high = rate.wilson95
        axes.errorbar(
            number,
            100.0 * rate.value,
            yerr=[[100.0 * (rate.value - low)], [100.0 * (high - rate.value)]],
            fmt="o",
            color=_COLOUR,
        )
    labels = [f"{edges[n]:g}–{edges[n + 1]:g}\n{found[n].trials}" for n in found]  # noqa: RUF001
    axes.set_xticks(list(found), labels, fontsize=8)
    axes.set_ylim(-3.0, 103.0)
    axes.set_ylabel("successes, percent", fontsize=9)
    axes.set_xlabel(f"{name}; trials", fontsize=9)
    return _svg(figure)


def bars_of(name: str, values: Mapping[str, float]) -> str:
    """Return a plot of a bar for each value."""
    figure, axes = _axes()
    places = range(len(values))
    bars = axes.barh(places, list(values.values()), color=_COLOUR)
    axes.bar_label(bars, fmt="%.3g", fontsize=8, padding=2)
    axes.set_yticks(places, list(values), fontsize=8)
    # A few bars are no thicker than many.
    axes.set_ylim(max(len(values), _FEW_BARS) - 0.5, -0.5)
    axes.margins(x=0.15)
    axes.set_xlabel(name, fontsize=9)
    return _svg(figure)


def _axes() -> tuple[Figure, Axes]:
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    return figure, axes


def _svg(figure: Figure) -> str:
    """Return the figure as an element of a page, the same for the same figure."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]
