"""How many of all actions succeed how often, by kind and by the crossings of the start."""

from __future__ import annotations

from itertools import pairwise

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter

from knotflow.report.style import INK, MUTED, Picture, bare_axis, new_figure, render, styled

#: A success rate above it is often.
OFTEN = 0.7
#: The highest success rate of each bin, what it is called, and its colour.
BINS = (
    (0.0, "never", "#c9ced6"),
    (0.3, "up to 30 %", "#f0b25a"),
    (OFTEN, "up to 70 %", "#8fc1e3"),
    (1.0, "more often", "#0b5cad"),
)


def arranging(rates: pd.DataFrame) -> list[int]:
    """The numbers of arranging splines that the rates have a column for, fewest first."""
    return sorted(name for name in rates.columns if isinstance(name, int))


def binned(rates: pd.Series) -> list[float]:
    """The share of the actions in each of BINS."""
    below = [0, *(int((rates <= high).sum()) for high, _, _ in BINS)]
    return [(after - before) / len(rates) for before, after in pairwise(below)]


def by_kind(rates: pd.DataFrame, name: str) -> Picture:
    """How many actions succeed how often: a panel a class, two bars a number of crossings."""
    kinds = {kind: own for kind, own in rates.groupby("class")}
    order = sorted(kinds, key=lambda kind: (kind.startswith("Cross"), kind))
    widths = [kinds[kind]["crossings"].nunique() + 0.3 for kind in order]
    with styled():
        figure = new_figure(2.9)
        panels = figure.subplots(1, len(order), sharey=True, squeeze=False, width_ratios=widths)[0]
        for axes, kind in zip(panels, order, strict=True):
            _panel(axes, kinds[kind], arranging(rates))
            axes.set_title(kind, fontsize=8.5, color=INK)
        panels[0].set_ylabel("actions", color=MUTED)
        label = "most arranging splines, and below it the crossings of the start"
        figure.supxlabel(label, fontsize=8.5, color=MUTED)
        handles = [Patch(facecolor=colour, label=label) for _, label, colour in BINS]
        figure.legend(
            handles=handles, title="succeed", title_fontsize=8, alignment="left",
            loc="outside upper left", ncols=len(BINS), frameon=False, fontsize=8,
        )  # fmt: skip
        return render(figure, name, f"Success of {len(rates)} actions by class and crossings")


def _panel(axes: Axes, rates: pd.DataFrame, limits: list[int]) -> None:
    ticks: dict[float, str] = {}
    for place, (crossings, own) in enumerate(rates.groupby("crossings")):
        middle = place * (len(limits) + 0.8)
        for bar, most in enumerate(limits):
            x = middle + bar - (len(limits) - 1) / 2
            bottom = 0.0
            for share, (_, _, colour) in zip(binned(own[most]), BINS, strict=True):
                axes.bar(x, share, 0.88, bottom, color=colour)
                bottom += share
            ticks[x] = str(most)
        ticks[middle] = f"{ticks.get(middle, '')}\n{crossings}"
        axes.text(middle, 1.02, f"{len(own)}", ha="center", fontsize=7, color=MUTED)
    axes.set_xticks([*ticks], [*ticks.values()])
    axes.set_ylim(0, 1.08)
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1])
    axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
    bare_axis(axes, grid="y")
