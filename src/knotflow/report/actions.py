"""Which of all topological actions the primitives can do, with and without arranging."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from knotflow.report import markdown as md
from knotflow.report.rates import check_counts
from knotflow.report.results import Results
from knotflow.report.section import COLOURS, Figures, Parts, bare_axis, per_cent
from knotflow.topology import TopologicalState, parse_action

EXPERIMENT = "actions"
COLUMNS = {"start": str, "action": str, "class": str, "arranging": int, "trials": int}
COLUMNS |= {"successes": int}
OFTEN = 0.7


def actions(results: Results, figures: Figures) -> Parts:
    """Totals, a figure by class and crossings, and the effect of touching an end."""
    table = results.table(EXPERIMENT, "actions.csv", COLUMNS, ("start", "action", "arranging"))
    check_counts(table)
    rates = success_rates(table)
    totals = [
        f"{_splines(most)} {(rates[most] > OFTEN).sum()} succeed in more than {100 * OFTEN:.0f} % "
        f"of their trials and {(rates[most] == 0).sum()} never did (mean "
        f"{100 * rates[most].mean():.1f} %)"
        for most in arranging(rates)
    ]
    trials = sorted(set(table["trials"]))
    return {
        "count": str(len(rates)),
        "trials": " to ".join(map(str, dict.fromkeys((trials[0], trials[-1])))),
        "totals": md.listed(totals),
        "figure": figures.draw(
            EXPERIMENT,
            f"Share of {len(rates)} actions whose success rate is at least that on the x axis, "
            "with and without arranging.",
            2.6,
            lambda figure: _plot(figure, rates),
        ),
        "segments": _by_segments(rates),
    }


def success_rates(table: pd.DataFrame) -> pd.DataFrame:
    """A row an action and start: class, crossings of the start, and a success rate in a column for
    each number of arranging splines; not measured is NaN."""
    crossings = {s: TopologicalState.parse(s).num_crossings for s in table["start"].unique()}
    table = table.assign(
        rate=table["successes"] / table["trials"], crossings=table["start"].map(crossings)
    )
    index = ["start", "action", "class", "crossings"]
    return table.pivot(index=index, columns="arranging", values="rate").reset_index()


def arranging(rates: pd.DataFrame) -> list[int]:
    """The numbers of arranging splines that the rates have a column for, fewest first."""
    return sorted(name for name in rates.columns if isinstance(name, int))


def _splines(most: int) -> str:
    return f"with up to {most} arranging splines" if most else "with one spline"


def _by_segments(rates: pd.DataFrame) -> str:
    """How often actions succeed by class, crossings of the start, and touching an end."""
    limits = arranging(rates)
    ends = [
        "none" if {0, 2 * crossings}.isdisjoint(parse_action(action).segments) else "an end"
        for action, crossings in zip(rates["action"], rates["crossings"], strict=True)
    ]
    rows = [
        {
            "class": str(kind),
            "crossings": str(crossings),
            "end touched": touched,
            "actions": str(len(own)),
        }
        | {f"mean {_splines(most)}": f"{md.whole(100 * own[most].mean())} %" for most in limits}
        | {"never": str(int((own[limits] == 0).all(axis=1).sum()))}
        for (kind, crossings, touched), own in rates.assign(touched=ends).groupby(
            ["class", "crossings", "touched"]
        )
    ]
    return md.table(rows)


def _plot(figure: Figure, rates: pd.DataFrame) -> None:
    axes = figure.add_subplot()
    for colour, most in zip(COLOURS, arranging(rates), strict=False):
        ordered = np.sort(rates[most].dropna())
        shares = 1 - np.arange(len(ordered)) / len(ordered)
        axes.step(ordered, shares, color=colour, linewidth=1.6, label=_splines(most))
    per_cent(axes.xaxis)
    per_cent(axes.yaxis)
    axes.set(xlabel="success rate", ylabel="share of actions", xlim=(0, 1), ylim=(0, 1))
    bare_axis(axes, "both")
    axes.legend(frameon=False)
