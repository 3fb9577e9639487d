"""States drawn at random among all of three and of four crossings, from random ropes."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator, PercentFormatter

from knotflow.intervals import Interval, wilson
from knotflow.report.learning import COLOURS
from knotflow.report.results import AMOUNT, COUNT, FLAG, NOTE, TEXT, Results, refuse
from knotflow.report.searches import FOUND, confirmation
from knotflow.report.section import Pictures, Section
from knotflow.report.style import MUTED, Picture, bare_axis, new_figure, render, styled
from knotflow.report.tables import NOTHING, duration, markdown_table, percent

EXPERIMENT = "goals"
COLUMNS = {"set": TEXT, "goal": TEXT, "rope_seed": COUNT}
COLUMNS |= {"solved": FLAG, "branches": COUNT, "seconds": AMOUNT} | dict.fromkeys(FOUND, NOTE)
#: Seconds that the axis of the figure may name.
MARKS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60, 120, 300, 600)


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """A line for each set, its share over time, and every goal that was not tied."""
    table = results.table(EXPERIMENT, "goals.csv", COLUMNS, key=("set", "goal"))
    if table is None:
        return None
    unexplained = ~table["solved"] & (table["reason"] == "")
    refuse(table, "reason", unexplained, "is empty, but {goal} was not tied")
    sets = {str(name): own for name, own in table.groupby("set", sort=False)}
    missed = table[~table["solved"]]
    return {
        "figure": pictures.add(tied_over_time(_named(sets), EXPERIMENT)),
        "table": _table(sets),
        "confirmation": confirmation(results, EXPERIMENT, table),
        "missed": len(missed),
        "reasons": _reasons(missed),
    }


def _named(sets: dict[str, pd.DataFrame]) -> dict[str, pd.DataFrame]:
    return {f"{name} crossings": own for name, own in sets.items()}


def share_tied(searches: pd.DataFrame) -> Interval:
    """How many of the searches tied their goal, with its Wilson interval."""
    return wilson(int(searches["solved"].sum()), len(searches))


def _table(sets: dict[str, pd.DataFrame]) -> str:
    lines = []
    for name, own in sets.items():
        tied = own[own["solved"]]
        confirmed = sum(tied["confirmed"] == "yes")
        lines.append(
            [
                name,
                f"{percent(share_tied(own))}<br>{len(tied)} of {len(own)}",
                f"{tied['branches'].median():,g}" if len(tied) else NOTHING,
                duration(tied["seconds"].median() if len(tied) else None),
                f"{confirmed} of {len(tied)}",
            ]
        )
    header = ["crossings", "tied", "branches, median", "time, median", "type confirmed"]
    return markdown_table(header, lines, "lrrrr")


def _reasons(missed: pd.DataFrame) -> str:
    lines = [
        [one.set, f"`{one.goal}`", str(one.rope_seed), f"{one.branches:,}", one.reason]
        for one in missed.itertuples()
    ]
    header = ["crossings", "goal", "rope", "branches", "why the search ended"]
    return markdown_table(header, lines, "llrrl")


def tied_over_time(sets: dict[str, pd.DataFrame], name: str) -> Picture:
    """The share of goals tied after so many seconds, and its interval at the end, a line a label.

    The end is the longest search: where one gave up, that is about the limit.
    """
    searches = pd.concat(sets.values())
    first, last = max(0.05, searches["seconds"].min()), searches["seconds"].max()
    last = max(last, 2 * first)
    stretch = last / first  # of the axis, which is logarithmic
    with styled():
        figure = new_figure(2.7)
        axes = figure.add_subplot()
        axes.set_xscale("log")
        axes.set_xlim(first * stretch**-0.02, last * stretch ** (0.02 + 0.06 * len(sets)))
        for place, (label, own) in enumerate(sets.items()):
            colour, rate = COLOURS[place % len(COLOURS)], share_tied(own)
            assert rate.low is not None and rate.high is not None
            seconds = sorted(own["seconds"][own["solved"]])
            steps = [first, *seconds, last]
            shares = [number / len(own) for number in range(len(seconds) + 1)]
            axes.step(
                steps, [*shares, shares[-1]], color=colour, where="post",
                linewidth=1.6, label=label,
            )  # fmt: skip
            end = last * stretch ** (0.015 + 0.06 * place)
            axes.plot([end, end], [rate.low, rate.high], color=colour, linewidth=1.2)
            axes.plot(end, rate.estimate, "o", color=colour, markersize=4)
            axes.annotate(
                f"{100 * rate.estimate:.0f} %", (end, rate.estimate), (4, 0),
                textcoords="offset points", va="center", fontsize=7.5, color=MUTED,
            )  # fmt: skip
        axes.xaxis.set_major_locator(FixedLocator([m for m in MARKS if m <= last * 1.05]))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g} s"))
        axes.set_ylim(0, 1.04)
        axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
        axes.set_xlabel("time of the search")
        axes.set_ylabel("goals tied", color=MUTED)
        bare_axis(axes, grid="both")
        figure.legend(loc="outside upper left", ncols=4, frameon=False, fontsize=8)
        return render(figure, name, f"Share of {len(searches)} searches that tied over time")


SECTION = Section(
    EXPERIMENT,
    "Goals drawn at random",
    "Not in the paper",
    "How many of all states a rope can be brought into: goals drawn at random among all 528 with "
    "three crossings and all 7,968 with four, each from a random rope of its own. No primitive was "
    "trained on them as a set.",
    values,
)
