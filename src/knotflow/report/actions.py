"""Which of all actions the primitives can do, with and without arranging."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter

from knotflow.report.results import AT_LEAST_ONE, COUNT, TEXT, Results, refuse
from knotflow.report.section import Pictures, Section
from knotflow.report.style import INK, MUTED, Picture, bare_axis, new_figure, render, styled
from knotflow.report.tables import markdown_table
from knotflow.topology import TopologicalState, all_states, parse_action
from knotflow.topology.symmetry import distinct_actions, representative

EXPERIMENT = "actions"
KEY = ("start", "action", "arranging")
COLUMNS = {"start": TEXT, "action": TEXT, "class": TEXT, "arranging": COUNT}
COLUMNS |= {"trials": AT_LEAST_ONE, "successes": COUNT}
MOST_CROSSINGS = 3
"""Of the states that the actions lead to."""
#: A success rate above it is often.
OFTEN = 0.7
#: The highest success rate of each bin, what it is called, and its colour.
BINS = (
    (0.0, "never", "#c9ced6"),
    (0.3, "up to 30 %", "#f0b25a"),
    (OFTEN, "up to 70 %", "#8fc1e3"),
    (1.0, "more often", "#0b5cad"),
)


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The picture by kind and crossings, totals in words, and what touches an end."""
    table = results.table(EXPERIMENT, "actions.csv", COLUMNS, key=KEY)
    if table is None:
        return None
    refuse(
        table,
        "successes",
        table["successes"] > table["trials"],
        "{successes} of only {trials} trials",
    )
    rates = success_rates(table)
    return {
        "figure": pictures.add(by_kind(rates, EXPERIMENT)),
        "totals": [
            {
                "arranging": most,
                "often": int((rates[most] > OFTEN).sum()),
                "never": int((rates[most] == 0).sum()),
                "mean": f"{100 * rates[most].mean():.1f} %",
            }
            for most in arranging(rates)
        ],
        "actions": len(rates),
        "untried": max(0, _all_actions() - len(rates)),
        "segments": _by_segments(rates),
    }


def success_rates(table: pd.DataFrame) -> pd.DataFrame:
    """A row an action and start: class, crossings of the start, and a success rate in a column for
    each number of arranging splines; not measured is NaN."""
    starts = table["start"].drop_duplicates()
    crossings = {start: TopologicalState.parse(start).num_crossings for start in starts}
    table = table.assign(
        rate=table["successes"] / table["trials"], crossings=table["start"].map(crossings)
    )
    one = ["start", "action", "class", "crossings"]
    return table.pivot(index=one, columns="arranging", values="rate").reset_index()


def _all_actions() -> int:
    """All actions that lead to at most MOST_CROSSINGS, up to Mirror and Reverse."""
    states = [state for count in range(MOST_CROSSINGS) for state in all_states(count)]
    return sum(
        onward.num_crossings <= MOST_CROSSINGS
        for state in states
        if representative(state)[0] == state
        for _, onward in distinct_actions(state)
    )


def _by_segments(rates: pd.DataFrame) -> str:
    """How often actions succeed by class, crossings of the start, and whether they touch an end."""
    limits = arranging(rates)
    end = [
        not {0, 2 * crossings}.isdisjoint(parse_action(action).segments)
        for action, crossings in zip(rates["action"], rates["crossings"], strict=True)
    ]
    where = ["an end" if one else "none" for one in end]
    lines = [
        [kind, str(crossings), segments, str(len(own)),
         *(f"{100 * own[most].mean():.0f} %" for most in limits),
         str(int((own[limits] == 0).all(axis=1).sum()))]
        for (kind, crossings, segments), own in rates.assign(where=where).groupby(
            ["class", "crossings", "where"]
        )
    ]  # fmt: skip
    header = ["kind", "crossings", "end touched", "actions", *map(_splines, limits), "never done"]
    return markdown_table(header, lines, "lrl" + "r" * (len(limits) + 2))


def _splines(most: int) -> str:
    return f"mean, {most} arranging" if most else "mean, one spline"


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


SECTION = Section(
    EXPERIMENT,
    "All actions",
    "Not in the paper",
    "Which actions the primitives can do, among all that lead to at most three crossings, from "
    "ropes that searches brought into the start state.",
    values,
)
