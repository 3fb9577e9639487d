"""Tree searches: the tables of every experiment that plans, their figures and summaries."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from numpy.typing import ArrayLike, NDArray

from knotflow.report import markdown as md
from knotflow.report.rates import Method
from knotflow.report.results import Results
from knotflow.report.section import COLOURS, Figures, bare_axis, optional, per_cent
from knotflow.statistics import Interval, hierarchical, weighted_median
from knotflow.viz.style import INK, MUTED

OVERHAND_LIMIT = 3
"""The fewest that can tie an overhand: its path has three actions (Sec. VII-A4)."""
OUTCOME = {"kept": int, "simulated": int, "solved": bool, "seconds": float, "path": str}
OUTCOME |= {"reason": str}
CHECKS = {"searches": str, "plan": str, "step": int, "passages": int, "steady": bool}
MOST_TRIED = 4
"""Lines of each method in the table of where branches went."""
MARKS = [m * 10**k for k in range(8) for m in (1, 2, 5)]
"""Numbers of splines that the axis of a figure may name."""
LARGEST = "the paper's largest"
SEARCH_MARKS: dict[str, dict[str, Any]] = {
    "a search": {"marker": "o", "ls": "", "ms": 3.5},
    "median, 95 % interval": {"marker": "|", "ms": 6, "mew": 1.4, "linewidth": 1.2},
    LARGEST: {"marker": "D", "ls": "", "ms": 6, "mfc": "none", "mec": INK, "mew": 1},
}
"""Marks in the figure of kept splines."""
STATE_NOTATION = (
    "A state is written as its crossings, each as over position, `o`, under position and sign, "
    "counted from head to tail."
)


def read_searches(
    results: Results, experiment: str, column: str = "goal", *axes: str
) -> pd.DataFrame:
    """branches.csv, a row a search.

    `column` has what is compared, called `method` in what is returned; `axes` are further columns,
    such as training_seed, which is '' where they lack it.
    """
    keys = {column: str, "start": str, **dict.fromkeys(axes, str), "seed": int}
    table = results.table(experiment, "branches.csv", keys | OUTCOME, key=tuple(keys))
    seeds = table["training_seed"] if "training_seed" in axes else ""
    return table.assign(method=table[column], training_seed=seeds)


def select(searches: pd.DataFrame, method: str, start: str = "") -> pd.DataFrame:
    """The searches of one method, from one kind of start if it is named, in the table's order."""
    own = searches[searches["method"] == method]
    return own[own["start"] == start] if start else own


def sizes(searches: pd.DataFrame) -> NDArray[np.float64]:
    """Splines kept by each search; one that gave up is larger than any bound."""
    return searches["kept"].to_numpy(float, copy=True) + np.where(searches["solved"], 0.0, math.inf)


def resampled(searches: pd.DataFrame, values: ArrayLike, statistic: Callable[..., Any]) -> Interval:
    """A statistic of a value a search, with trainings and searches resampled.

    Random ropes are resampled instead of searches, as every training has the same.
    """
    starts = searches["seed"] if set(searches["start"]) == {"random"} else None
    return hierarchical(values, searches["training_seed"], starts, statistic)


def median_size(searches: pd.DataFrame) -> Interval:
    """Median of `sizes`, infinite where half of the searches gave up."""
    return resampled(searches, sizes(searches), weighted_median)


def count(value: float) -> str:
    """A number of splines: `1,428`, `3.5`, or ∞ for a search that gave up."""
    return "∞" if math.isinf(value) else f"{value:,g}"


def effort(searches: pd.DataFrame) -> tuple[str, str]:
    """Range and median of the splines kept and of those simulated."""
    kept, simulated = sizes(searches), searches["simulated"]
    middle = md.estimate(median_size(searches), count)
    return (
        f"{count(kept.min())} to {count(kept.max())} kept, median {middle}",
        f"({min(simulated):,} to {max(simulated):,} simulated, median {count(simulated.median())})",
    )


def search_words(results: Results, experiment: str, node: str = "searches") -> str:
    """How the nodes of that name searched, from their resolved configuration; '' without it."""
    planner = results.setting(experiment, "planner", node)
    if not isinstance(planner, dict) or "rule" not in planner:
        return ""
    paper, batch = planner["rule"] == "paper", planner["batch"]
    most = 0 if paper else planner["arranging"]
    guessed = 0.0 if paper else planner["guess_fraction"]
    parts = [
        "by the paper's rule"
        if paper
        else "by the posterior rule (where the fewest further splines are expected)",
        "one spline at a time" if batch == 1 else f"{batch} splines at a time",
        f"with up to {most} arranging splines in a row" if most else "without arranging splines",
        f"{100 * guessed:g} % guesses where little succeeds" if guessed else "without guesses",
        "with the next action's value where primitives have learned it"
        if planner["use_next_value"]
        else "without the next action's value",
    ]
    return (
        f"These searches grow {md.listed(parts)}; they give up after {planner['max_branches']:,} "
        f"simulated splines or {md.duration(planner['max_seconds'])}."
    )


@optional
def checks(results: Results, experiment: str) -> str:
    """What became of the plans' steps when they were simulated again (checks.csv)."""
    key = ("searches", "plan", "step")
    table = results.table(experiment, "checks.csv", CHECKS, key, may_be_empty=True)
    if table.empty:  # no plan had a step
        return ""
    passed = int((table["passages"] > 0).sum())
    return (
        f"Of the {len(table):,} steps of these plans, simulated again, {passed or 'none'} had a "
        f"strand pass through another; {md.rate(table['steady'])} also reached their state at half "
        "the time step and kept it afterwards."
    )


@optional
def splines_spent(
    results: Results, experiment: str, method: str, methods: Sequence[Method] = ()
) -> str:
    """Where most splines of each method went, and how many succeeded."""
    labels = {one.name: one.label for one in methods}
    keys = (method, "start", "state", "action")
    columns = dict.fromkeys(keys, str) | {"simulated": int, "successes": int}
    tried = results.table(experiment, "tried.csv", columns, key=keys)
    total = tried.groupby([method, "state", "action"], sort=False, as_index=False).sum()
    rows = [
        {
            method: labels.get(str(name), str(name).replace("_", " ")),
            "state": f"`{one.state}`",
            "action": f"`{one.action}`",
            "simulated": f"{one.simulated:,}",
            "succeeded": f"{one.successes:,}",
        }
        for name, own in total.groupby(method, sort=False)
        for one in own.nlargest(MOST_TRIED, "simulated").itertuples()
    ]
    return md.table(rows, "The states and actions on which each spent most splines:")


def search_table(groups: Iterable[tuple[dict[str, str], pd.DataFrame]]) -> str:
    """A line for each group of searches that has any, after its first cells by column."""
    rows = []
    for first, own in groups:
        if own.empty:
            continue
        kept, simulated = sizes(own), own["simulated"]
        columns = {
            "trainings": str(own["training_seed"].nunique()),
            "n": str(len(own)),
            "gave up": str((~own["solved"]).sum()),
            "kept: fewest": count(kept.min()),
            "median (95 %)": md.estimate(median_size(own), count),
            "mean ± SD": mean_spread(own),
            "most": count(kept.max()),
            "simulated: median": count(simulated.median()),
            "at most": count(simulated.max()),
            "time, median": md.duration(own["seconds"].median()),
        }
        rows.append(first | columns)
    return md.table(rows)


def mean_spread(searches: pd.DataFrame) -> str:
    """Mean and standard deviation of the splines kept, as the paper has them; none gave up."""
    if not searches["solved"].all():
        return md.NOTHING
    spread = md.tenths(searches["kept"].std()) if len(searches) > 1 else "?"
    return f"{md.tenths(searches['kept'].mean())} ± {spread}"


def tied_columns(searches: pd.DataFrame) -> dict[str, str]:
    """How many of the searches tied their goal, and the median effort of those."""
    tied = searches[searches["solved"]]
    efforts = {
        f"{name}, median": count(tied[name].median()) if len(tied) else md.NOTHING
        for name in ("kept", "simulated")
    }
    time = {"time, median": md.duration(tied["seconds"].median())}
    return {"tied": md.share(searches["solved"])} | efforts | time


def branches_figure(
    figures: Figures,
    name: str,
    searches: pd.DataFrame,
    methods: Sequence[Method],
    starts: Sequence[str],
    paper_largest: Mapping[tuple[str, str], float],
) -> str:
    """Splines kept by each tree search, their median with its interval, and the paper's number.

    `paper_largest` has, by (start, method), what the paper reports: drawn as a diamond.
    """
    rows = [(start, method) for start in starts for method in methods]
    longest = max([2 * OVERHAND_LIMIT, *searches["kept"], *paper_largest.values()])

    def plot(figure: Figure) -> None:
        axes = figure.add_subplot()
        axes.axvline(OVERHAND_LIMIT, color=MUTED, linewidth=0.8, zorder=1)
        ticks = [place + 0.5 * (place // len(methods)) for place in range(len(rows))]
        for y, (start, method) in zip(ticks, rows, strict=True):
            _branch_row(axes, select(searches, method.name, start), method, y, 1.3 * longest)
            if largest := paper_largest.get((start, method.name)):
                axes.plot(largest, y, **SEARCH_MARKS[LARGEST])
        labels = [f"{start}: {method.label}" if start else method.label for start, method in rows]
        axes.set_yticks(ticks, labels)
        axes.tick_params(axis="y", labelcolor=INK)
        axes.set_ylim(max(ticks) + 0.6, -0.6)
        axes.set_xscale("log")
        _log_axis(axes, [OVERHAND_LIMIT, *(m for m in MARKS if 3 < m <= longest * 1.2)])
        axes.set_xlabel("splines kept until the knot is tied")
        bare_axis(axes, "x")
        for label, style in SEARCH_MARKS.items():
            if paper_largest or label != LARGEST:
                axes.plot([], [], color=INK, label=label, **style)
        figure.legend(loc="outside upper right", ncols=3, frameon=False, fontsize=8)

    caption = (
        f"Splines kept by {len(searches)} tree searches (dots, a row for each training, with its "
        "seed; open where the search gave up), and their median with its 95 % interval over "
        "trainings and searches. "
        f"The line at {OVERHAND_LIMIT} is the fewest possible"
    )
    caption += (
        "; diamonds are the largest trees of the paper, after RL its bound of fewer than five."
        if paper_largest
        else "."
    )
    return figures.draw(name, caption, 1.15 + 0.45 * len(rows), plot)


def _branch_row(axes: Axes, searches: pd.DataFrame, method: Method, y: float, right: float) -> None:
    """A method's searches at height y; `right` stands for a search that gave up."""
    if searches.empty:
        axes.text(OVERHAND_LIMIT * 1.05, y, "not run", va="center", color=MUTED, fontsize=8.5)
        return
    trainings = [own for _, own in searches.groupby("training_seed", sort=False)]
    for number, training in enumerate(trainings):
        low, high = np.array([number, number + 0.8]) * 0.45 / len(trainings) + y - 0.32
        heights = np.linspace(low, high, len(training))  # so that equal counts do not hide
        for solved in (True, False):
            own, face = training["solved"] == solved, method.colour if solved else "none"
            axes.plot(
                training["kept"][own], heights[own], "o",
                markersize=3.5, mfc=face, mec=method.colour, alpha=0.8,
            )  # fmt: skip
        if seed := training["training_seed"].iloc[0]:
            axes.annotate(
                f"training {seed}", (1, heights.mean()), (2, 0), ("axes fraction", "data"),
                "offset points", va="center", color=MUTED, fontsize=5,
            )  # fmt: skip
    middle = median_size(searches)
    limits = np.minimum([middle.low, middle.high], right)
    axes.plot(limits, [y + 0.28] * 2, color=INK, linewidth=1.2)
    axes.plot(min(middle.estimate, right), y + 0.28, "|", color=INK, ms=6, mew=1.4)


def tied_by_splines(
    figures: Figures, name: str, groups: Mapping[str, pd.DataFrame], compared: str
) -> str:
    """The share of goals tied after so many simulated splines, by group, and in the end."""
    searches = pd.concat(groups.values())
    first, last = searches["simulated"].min(), searches["simulated"].max()

    def plot(figure: Figure) -> None:
        axes = figure.add_subplot()
        for place, (label, own) in enumerate(groups.items()):
            spent = sorted(own["simulated"][own["solved"]])
            shares = [count / len(own) for count in (*range(len(spent) + 1), len(spent))]
            axes.step(
                [first, *spent, last], shares, color=COLOURS[place % len(COLOURS)], where="post",
                linewidth=1.6, label=f"{label}: {md.rate(own['solved'])}",
            )  # fmt: skip
        axes.set_xscale("log")
        _log_axis(axes, [mark for mark in MARKS if first <= mark <= last * 1.05])
        axes.set_ylim(0, 1.04)
        per_cent(axes.yaxis)
        axes.set_xlabel("splines simulated")
        axes.set_ylabel("goals tied")
        bare_axis(axes, "both")
        figure.legend(loc="outside upper left", ncols=2, frameon=False, fontsize=8)

    caption = (
        f"Share of goals tied over the number of simulated splines, by {compared}. In the legend, "
        "the share when all searches had ended, with its 95 % Wilson interval."
    )
    return figures.draw(name, caption, 2.7, plot)


def _log_axis(axes: Axes, marks: Sequence[float]) -> None:
    axes.xaxis.set_major_locator(FixedLocator(marks))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter("{x:,.0f}")
