"""Tree searches: the tables of every experiment that plans, their figures and summaries."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator, PercentFormatter

from knotflow.report import markdown as md
from knotflow.report.rates import Method
from knotflow.report.results import Results, read_table
from knotflow.report.section import COLOURS, Figures, bare_axis
from knotflow.statistics import bootstrap
from knotflow.viz.style import INK, MUTED

OVERHAND_LIMIT = 3
"""The fewest branches that can tie an overhand: its path has three actions (Sec. VII-A4)."""
OUTCOME = {"branches": int, "solved": bool, "seconds": float, "path": str, "reason": str}
CHECKS = {"searches": str, "plan": str, "step": int, "passages": int, "steady": bool}
MOST_TRIED = 4
"""Lines of each method in the table of where branches went."""
SECONDS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600)
"""That the axis of a figure may name."""
STATE_NOTATION = (
    "A state is written as its crossings, each as over position, `o`, under position and sign, "
    "counted from head to tail."
)


def read_searches(
    results: Results, experiment: str, method: str = "goal", *, with_start: bool = True
) -> pd.DataFrame:
    """branches.csv, a row a search; empty where it was not run.

    `method` is the column of what is compared, called `method` in what is returned; `start` is ''
    where there is one kind only.
    """
    keys = {method: str, **({"start": str} if with_start else {}), "seed": int}
    table = results.table(experiment, "branches.csv", keys | OUTCOME, key=tuple(keys))
    if table is None:
        return pd.DataFrame(columns=["method", "start", "seed", *OUTCOME])
    return table.assign(method=table[method], start=table["start"] if with_start else "")


def select(searches: pd.DataFrame, method: str, start: str = "") -> pd.DataFrame:
    """The searches of one method from one kind of start, in the table's order."""
    return searches[(searches["method"] == method) & (searches["start"] == start)]


def sizes(searches: pd.DataFrame) -> list[float]:
    """Branches of each tree; one that gave up is larger than any bound."""
    return [
        float(branches) if solved else math.inf
        for branches, solved in zip(searches["branches"], searches["solved"], strict=True)
    ]


def checks(results: Results, experiment: str) -> str:
    """What became of the plans' steps when they were simulated again (checks.csv); '' without."""
    path = results.root / experiment / "checks.csv"
    if not path.is_file():
        return ""
    table = read_table(path, CHECKS, key=("searches", "plan", "step"), may_be_empty=True)
    if table.empty:  # no plan had a step
        return ""
    passed = int((table["passages"] > 0).sum())
    return (
        f"Of the {len(table)} steps of these plans, simulated again, {passed or 'none'} had a "
        f"strand pass through another; {md.rate(table['steady'])} also reached their state at half "
        "the time step and kept it afterwards."
    )


def branches_spent(results: Results, experiment: str, method: str) -> str:
    """Where most branches of each method went, and how many succeeded; '' without tried.csv."""
    keys = (method, "start", "state", "action")
    columns = dict.fromkeys(keys, str) | {"branches": int, "successes": int}
    tried = results.table(experiment, "tried.csv", columns, key=keys)
    if tried is None:
        return ""
    total = tried.groupby([method, "state", "action"], sort=False, as_index=False).sum()
    rows = [
        {
            method: str(name).replace("_", " "),
            "state": f"`{one.state}`",
            "action": f"`{one.action}`",
            "branches": f"{one.branches:,}",
            "succeeded": f"{one.successes:,}",
        }
        for name, own in total.groupby(method, sort=False)
        for one in own.nlargest(MOST_TRIED, "branches").itertuples()
    ]
    return md.table(rows, "The states and actions on which each spent most branches:")


def search_table(groups: Iterable[tuple[dict[str, str], pd.DataFrame]]) -> str:
    """A line for each group of searches that has any, after its first cells by column."""
    rows = []
    for first, own in groups:
        if own.empty:
            continue
        counts = own["branches"].tolist()
        columns = {
            "n": str(len(counts)),
            "fewest": f"{min(counts):,}",
            "median": f"{statistics.median(counts):,g}",
            "mean (95 %)": md.estimate(bootstrap(counts)),
            "SD": md.tenths(statistics.stdev(counts)) if len(counts) > 1 else md.NOTHING,
            "most": f"{max(counts):,}",
            "gave up": str((~own["solved"]).sum()),
            "time, median": md.duration(own["seconds"].median()),
        }
        rows.append(first | columns)
    return md.table(rows)


def tied_columns(searches: pd.DataFrame) -> dict[str, str]:
    """How many of the searches tied their goal, and the median effort of those."""
    tied = searches[searches["solved"]]
    return {
        "tied": md.share(searches["solved"]),
        "branches, median": f"{tied['branches'].median():,g}" if len(tied) else md.NOTHING,
        "time, median": md.duration(tied["seconds"].median()),
    }


def branches_figure(
    figures: Figures,
    name: str,
    searches: pd.DataFrame,
    methods: Sequence[Method],
    starts: Sequence[str],
    paper_largest: Mapping[tuple[str, str], float],
) -> str:
    """Branches of each tree search, their mean with its interval, and the paper's number.

    `paper_largest` has, by (start, method), what the paper reports: drawn as a diamond.
    """
    rows = [(start, method) for start in starts for method in methods]
    longest = max([2 * OVERHAND_LIMIT, *searches["branches"], *paper_largest.values()])

    def plot(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.axvline(OVERHAND_LIMIT, color=MUTED, linewidth=0.8, zorder=1)
        ticks = [place + 0.5 * (place // len(methods)) for place in range(len(rows))]
        for y, (start, method) in zip(ticks, rows, strict=True):
            _branch_row(axes, select(searches, method.name, start), method, y)
            if largest := paper_largest.get((start, method.name)):
                axes.plot(largest, y, "D", markersize=6, mfc="none", mec=INK, mew=1)
        labels = [f"{start}: {method.label}" if start else method.label for start, method in rows]
        axes.set_yticks(ticks, labels)
        axes.tick_params(axis="y", labelcolor=INK)
        axes.set_ylim(max(ticks) + 0.6, -0.6)
        axes.set_xscale("log")
        marks = [m * 10**k for k in range(8) for m in (1, 2, 5)]
        _log_axis(axes, [OVERHAND_LIMIT, *(m for m in marks if 3 < m <= longest * 1.2)], "{:,.0f}")
        axes.set_xlabel("branches evaluated until the knot is tied")
        bare_axis(axes, "x")

    caption = (
        f"Branches of {len(searches)} tree searches (dots, open where the search gave up), and "
        f"their mean with its 95 % bootstrap interval. The line at {OVERHAND_LIMIT} is the fewest "
        "possible"
    )
    caption += "; diamonds are the largest trees of the paper." if paper_largest else "."
    return figures.draw(name, caption, 0.85 + 0.45 * len(rows), plot)


def _branch_row(axes: Axes, searches: pd.DataFrame, method: Method, y: float) -> None:
    if searches.empty:
        axes.text(OVERHAND_LIMIT * 1.05, y, "not run", va="center", color=MUTED, fontsize=8.5)
        return
    heights = y + np.linspace(-0.3, 0.1, len(searches))  # so that equal counts do not hide
    for solved in (True, False):
        own, face = searches["solved"] == solved, method.colour if solved else "none"
        counts = searches["branches"][own]
        axes.plot(counts, heights[own], "o", markersize=4, mfc=face, mec=method.colour, alpha=0.8)
    mean = bootstrap(searches["branches"])
    if mean.low is not None and mean.high is not None:
        axes.plot([mean.low, mean.high], [y + 0.28] * 2, color=INK, linewidth=1.2)
    axes.plot(mean.estimate, y + 0.28, "|", color=INK, markersize=6, markeredgewidth=1.4)


def tied_over_time(
    figures: Figures, name: str, groups: Mapping[str, pd.DataFrame], compared: str
) -> str:
    """The share of goals tied after so many seconds, with its interval at the end, by group."""
    searches = pd.concat(groups.values())
    first, last = max(0.05, searches["seconds"].min()), searches["seconds"].max()

    def plot(figure: Figure) -> None:
        axes = figure.add_subplot()
        for place, (label, own) in enumerate(groups.items()):
            seconds = sorted(own["seconds"][own["solved"]])
            shares = [count / len(own) for count in (*range(len(seconds) + 1), len(seconds))]
            axes.step(
                [first, *seconds, last], shares, color=COLOURS[place % len(COLOURS)], where="post",
                linewidth=1.6, label=f"{label}: {md.rate(own['solved'])}",
            )  # fmt: skip
        axes.set_xscale("log")
        _log_axis(axes, [mark for mark in SECONDS if first <= mark <= last * 1.05], "{:g} s")
        axes.set_ylim(0, 1.04)
        axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
        axes.set_xlabel("search time")
        axes.set_ylabel("goals tied")
        bare_axis(axes, "both")
        figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=8)

    caption = (
        f"Share of goals tied over search time, by {compared}. In the legend, the share when all "
        "searches had ended, with its 95 % Wilson interval."
    )
    return figures.draw(name, caption, 2.7, plot)


def _log_axis(axes: Axes, marks: Sequence[float], form: str) -> None:
    axes.xaxis.set_major_locator(FixedLocator(marks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: form.format(value)))
