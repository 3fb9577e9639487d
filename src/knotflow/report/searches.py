"""Tree searches: branches.csv of every experiment that plans, its figure and its table."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from knotflow.intervals import wilson
from knotflow.report.paper import OVERHAND_LIMIT, Method
from knotflow.report.results import AMOUNT, COUNT, FLAG, NOTE, TEXT, Results
from knotflow.report.statistics import bootstrap
from knotflow.report.style import INK, MUTED, PAPER, Picture, bare_axis, new_figure, render, styled
from knotflow.report.tables import (
    NOTHING,
    duration,
    estimate,
    markdown_table,
    percent,
    tenths,
)

#: Points across, of a dot that stands for all searches of its line.
LARGEST_DOT = 17.0
#: What a search found: its path, and the knot type that an independent library finds.
FOUND = ("path", "knot_type", "confirmed", "reason")
#: The steps of plans, simulated again.
CHECKS = {"searches": TEXT, "plan": TEXT, "step": COUNT, "action": TEXT, "passages": COUNT}
CHECKS |= {"reproduced": FLAG, "steady": FLAG}
#: Lines of each method in the table of where branches went.
MOST_TRIED = 4


def read_searches(
    results: Results, experiment: str, method: str = "goal", *, with_start: bool = True
) -> pd.DataFrame | None:
    """branches.csv, a row a search; None where it was not run.

    `method` is the column of what is compared, called `method` in what is returned; `start` is ''
    where there is one kind only.
    """
    keys = {method: TEXT, **({"start": TEXT} if with_start else {}), "seed": COUNT}
    columns = keys | {"branches": COUNT, "solved": FLAG, "seconds": AMOUNT}
    columns |= dict.fromkeys(FOUND, NOTE)
    table = results.table(experiment, "branches.csv", columns, key=tuple(keys))
    if table is None:
        return None
    return table.assign(method=table[method], start=table["start"] if with_start else "")


def of(searches: pd.DataFrame | None, method: str, start: str = "") -> pd.DataFrame:
    """The searches of one method from one kind of start, in the table's order; empty for None."""
    if searches is None:
        return pd.DataFrame(columns=["method", "start", "seed", "branches", "solved", "seconds"])
    return searches[(searches["method"] == method) & (searches["start"] == start)]


def sizes(searches: pd.DataFrame) -> list[float]:
    """Branches of each tree; one that gave up is larger than any bound."""
    return (
        searches["branches"].astype(float).where(searches["solved"].astype(bool), math.inf).tolist()
    )


def confirmation(results: Results, experiment: str, searches: pd.DataFrame) -> str:
    """How many of the tied ropes an independent library found to be the knot they should be, and
    what became of their steps when they were simulated again (checks.csv, where there is one)."""
    confirmed = [check for check in searches["confirmed"] if check]
    if not confirmed:
        return "No rope was tied."
    unchecked = sum(check not in ("yes", "no") for check in confirmed)
    missing = f"; {unchecked} were not checked" if unchecked else ""
    share = f"{confirmed.count('yes')} of {len(confirmed)} tied ropes"
    words = f"An independent library (topoly) confirms the knot type of {share}{missing}."
    checks = results.table(experiment, "checks.csv", CHECKS, key=("searches", "plan", "step"))
    if checks is None or checks.empty:
        return words
    passed = int((checks["passages"] > 0).sum())
    steady = wilson(int(checks["steady"].sum()), len(checks))
    return (
        f"{words} Of the {len(checks)} steps of these plans, simulated again, {passed or 'none'} "
        f"had a strand pass through another, and {percent(steady)} reached their state at half the "
        "time step, too, and still had it 3 s later."
    )


def spent(results: Results, experiment: str, method: str) -> str:
    """Where most branches of each method went, and how many succeeded; empty without tried.csv."""
    keys = (method, "start", "state", "action")
    columns = dict.fromkeys(keys, TEXT) | {"branches": COUNT, "successes": COUNT}
    tried = results.table(experiment, "tried.csv", columns, key=keys)
    if tried is None:
        return ""
    total = tried.groupby([method, "state", "action"], sort=False, as_index=False).sum()
    lines = [
        [name, f"`{one.state}`", f"`{one.action}`", f"{one.branches:,}", f"{one.successes:,}"]
        for name, own in total.groupby(method, sort=False)
        for one in own.nlargest(MOST_TRIED, "branches").itertuples()
    ]
    return markdown_table(["", "state", "action", "branches", "succeeded"], lines, "lllrr")


def search_table(header: Sequence[str], lines: Sequence[tuple[Sequence[str], pd.DataFrame]]) -> str:
    """A line for each group of searches; `lines` has its first cells, under `header`, and it."""
    columns = ("n", "fewest", "median", "mean (95 %)", "SD", "most", "gave up", "time, median")
    cells = []
    for first, own in lines:
        counts = own["branches"].tolist()
        cells.append(
            [
                *first,
                str(len(counts)),
                f"{min(counts):,}",
                f"{statistics.median(counts):,g}",
                estimate(bootstrap(counts)),
                tenths(statistics.stdev(counts)) if len(counts) > 1 else NOTHING,
                f"{max(counts):,}",
                str((~own["solved"]).sum()),
                duration(own["seconds"].median()),
            ]
        )
    return markdown_table([*header, *columns], cells, "l" * len(header) + "r" * len(columns))


def branches(
    searches: pd.DataFrame,
    methods: Sequence[Method],
    starts: Sequence[str],
    name: str,
    paper_largest: Mapping[tuple[str, str], float],
) -> Picture:
    """Branches of each tree search, their mean with its interval, the paper's number.

    `paper_largest` has, by (start, method), what the paper reports: drawn as a diamond. Open dots
    are searches that gave up.
    """
    lines = [(start, method) for start in starts for method in methods]
    longest = max([*searches["branches"].tolist(), *map(int, paper_largest.values())])
    with styled():
        figure = new_figure(0.85 + 0.5 * len(lines) + 0.3 * (len(starts) - 1))
        axes = figure.add_subplot()
        axes.set_xscale("log")
        right = max(longest, 2 * OVERHAND_LIMIT)
        # Room for the largest dot on the line of the limit.
        left = OVERHAND_LIMIT * (right / OVERHAND_LIMIT) ** -0.035
        axes.set_xlim(left, right * 1.25)
        axes.axvline(OVERHAND_LIMIT, color=MUTED, linewidth=0.8, zorder=1)
        ticks, labels = [], []
        for place, (start, method) in enumerate(lines):
            y = place + 0.7 * (place // len(methods))
            ticks.append(y)
            labels.append(f"{start}: {method.label}" if start else method.label)
            _branch_line(axes, of(searches, method.name, start), method, y)
            if (start, method.name) in paper_largest:
                axes.plot(
                    paper_largest[start, method.name],
                    y,
                    "D",
                    markersize=6,
                    markerfacecolor="none",
                    markeredgecolor=INK,
                    markeredgewidth=1,
                )
        axes.set_yticks(ticks, labels)
        axes.tick_params(axis="y", labelcolor=INK)
        axes.set_ylim(max(ticks) + 0.6, -0.6)
        _count_axis(axes, right)
        axes.set_xlabel("branches evaluated until the knot is tied")
        bare_axis(axes, grid="x")
        alt = f"Branches of {len(searches)} tree searches, by " + (
            "method and start" if len(starts) > 1 else "primitives"
        )
        return render(figure, name, alt)


def _branch_line(axes: Axes, searches: pd.DataFrame, method: Method, y: float) -> None:
    if searches.empty:
        axes.text(OVERHAND_LIMIT * 1.05, y, "not run yet", va="center", color=MUTED, fontsize=8.5)
        return
    # Equal counts are one dot, its area their share, with their number above it.
    equal = Counter(zip(searches["branches"], searches["solved"], strict=True))
    for (count, solved), times in equal.items():
        size = max(4.0, LARGEST_DOT * math.sqrt(times / len(searches)))
        axes.plot(
            count,
            y,
            "o",
            markersize=size,
            markerfacecolor=method.colour if solved else PAPER,
            markeredgecolor=method.colour,
            markeredgewidth=0.9,
            alpha=0.85,
        )
        if times > 1:
            axes.annotate(
                f"{times}",
                (count, y),
                (0.35 * size + 1.5, 0.35 * size),
                textcoords="offset points",
                fontsize=6.5,
                color=MUTED,
            )
    mean = bootstrap(searches["branches"])
    if mean.low is not None and mean.high is not None:
        axes.plot([mean.low, mean.high], [y + 0.4] * 2, color=INK, linewidth=1.2)
    axes.plot(mean.estimate, y + 0.4, "|", color=INK, markersize=6, markeredgewidth=1.4)


def _count_axis(axes: Axes, longest: float) -> None:
    marks = [3, 4, 5, 6, 8, 10, 12, 15] if longest <= 16 else [3, 5, 10, 20, 50, 100, 200, 500]
    marks += [m * 10**k for k in range(3, 9) for m in (1, 2, 5)] if longest > 500 else []
    axes.xaxis.set_major_locator(FixedLocator([m for m in marks if m <= longest * 1.2]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
