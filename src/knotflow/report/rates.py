"""Success rates of methods on topological actions: read, drawn and tabled for Fig. 6 and Fig. 7."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import PercentFormatter

from knotflow.intervals import Interval, wilson
from knotflow.report.claims import NotMeasured
from knotflow.report.paper import ACTIONS, PRIMITIVES, Method, in_order
from knotflow.report.results import (
    AT_LEAST_ONE,
    COUNT,
    SHARE,
    TEXT,
    Results,
    ResultsError,
    refuse,
)
from knotflow.report.statistics import clustered_rate, clustered_ratio, mean_rate, rate_ratio
from knotflow.report.style import INK, MUTED, Picture, bare_axis, new_figure, render, styled
from knotflow.report.tables import NOTHING, listed, markdown_table, percent, times

#: Rates and limits are often written with three decimals.
TOLERANCE = 1e-3
ACTION = r"(?:R1|R2|C)\(-?\d+(?:,-?\d+)+\)"


class Rates:
    """How often each method reached each action's goal state.

    Args:
        table: method, action, trials, successes, a row a rate.
        starts: the same start by start, where it is known.
    """

    def __init__(self, table: pd.DataFrame, starts: pd.DataFrame | None = None) -> None:
        self._counts = {
            (row.method, row.action): (int(row.successes), int(row.trials))
            for row in table.itertuples()
        }
        groups = [] if starts is None else starts.groupby(["method", "action"])
        self._starts = {key: own.set_index("start").sort_index() for key, own in groups}
        self.methods = list(dict.fromkeys(table["method"]))
        self.actions = in_order(list(table["action"]))
        self.trials = sorted(set(table["trials"]))

    @property
    def intervals(self) -> str:
        """What its intervals are, in words."""
        if self._counts.keys() <= self._starts.keys():
            return "95 % intervals with the starts resampled"
        return "95 % Wilson intervals, rollouts taken as independent"

    def counts(self, method: str, action: str) -> tuple[int, int] | None:
        """Successes and trials of a method on an action, None where it was not measured."""
        return self._counts.get((method, action))

    def solved(self, method: str, action: str) -> tuple[int, int] | None:
        """Starts solved at least once, and all starts; None where they are not known."""
        own = self._starts.get((method, action))
        return None if own is None else (int((own["successes"] > 0).sum()), len(own))

    def interval(self, method: str, action: str) -> Interval:
        """The success rate with its interval. Raises KeyError where it was not measured."""
        own = self._starts.get((method, action))
        if own is None:
            return wilson(*self._counts[method, action])
        return clustered_rate(own["successes"], own["trials"])

    def ratio(self, method: str, base: str, action: str) -> Interval:
        """How many times as often `method` succeeds as `base`; nan where both never do."""
        top, bottom = self._starts.get((method, action)), self._starts.get((base, action))
        if top is not None and bottom is not None and top.index.equals(bottom.index):
            first, second = ((own["successes"], own["trials"]) for own in (top, bottom))
            return clustered_ratio(*first, *second)
        return rate_ratio(self.interval(method, action), self.interval(base, action))

    def shared_actions(self, *methods: str) -> list[str]:
        """The actions on which every one of `methods` was measured."""
        return [a for a in self.actions if all((m, a) in self._counts for m in methods)]


def read_rates(
    results: Results,
    experiment: str,
    name: str = "success_rates.csv",
    of_starts: str = "per_start.csv",
) -> Rates | None:
    """A table of success rates, and of their starts where one lies beside it; None before a run.

    Each rate has to agree with its counts, each written interval with Wilson's, and the starts
    have to sum to the rates.
    """
    numbers = {"trials": AT_LEAST_ONE, "successes": COUNT}
    columns = {"method": TEXT, "action": TEXT, **numbers}
    written = {"success_rate": SHARE, "ci_low": SHARE, "ci_high": SHARE}
    table = results.table(experiment, name, columns | written, key=("method", "action"))
    if table is None:
        return None
    check_counts(table)
    right = [wilson(row.successes, row.trials) for row in table.itertuples()]
    for column, values, meaning in (
        ("success_rate", [one.estimate for one in right], "the share"),
        ("ci_low", [one.low for one in right], "the lower 95 % Wilson limit"),
        ("ci_high", [one.high for one in right], "the upper 95 % Wilson limit"),
    ):
        problem = f"{{{column}}} disagrees with {{successes}}/{{trials}}: not {meaning}"
        refuse(table, column, (table[column] - values).abs() > TOLERANCE, problem)
    key = ("method", "action", "start")
    starts = results.table(experiment, of_starts, columns | {"start": TEXT}, key)
    if starts is not None:
        check_counts(starts)
        sums = starts.groupby(["method", "action"])[["successes", "trials"]].sum()
        for row in table.itertuples():
            own = (row.method, row.action)
            if own in sums.index and tuple(sums.loc[own]) != (row.successes, row.trials):
                raise ResultsError(
                    f"{starts.attrs['path']}, columns 'successes' and 'trials': the rows of "
                    f"{row.method} on {row.action} sum to {'/'.join(map(str, sums.loc[own]))}, "
                    f"{name} says {row.successes}/{row.trials}"
                )
    return Rates(table, starts)


def check_counts(table: pd.DataFrame) -> None:
    """Refuse a row of no topological action, or with more successes than trials."""
    unknown = ~table["action"].str.fullmatch(ACTION)
    refuse(table, "action", unknown, "'{action}' is no topological action such as 'C(2,0,1)'")
    many = table["successes"] > table["trials"]
    refuse(table, "successes", many, "{successes} of only {trials} trials")


def complete_rates(results: Results, experiment: str, methods: tuple[str, ...]) -> Rates:
    """The rates of a table that has all of `methods` on all eight actions.

    Raises:
        NotMeasured: one of them is missing.
    """
    rates = read_rates(results, experiment)
    missing = [m for m in methods if rates is None or m not in rates.methods]
    if rates is None or missing:
        raise NotMeasured(f"needs {listed(missing)} in {experiment}")
    shared = rates.shared_actions(*methods)
    if missing := [action for action in ACTIONS if action not in shared]:
        raise NotMeasured(f"needs {listed(missing)} of {listed(methods)} in {experiment}")
    return rates


def trials(rates: Rates) -> str:
    """Rollouts a bar: `400`, or `320 to 480` where bars differ."""
    least, most = rates.trials[0], rates.trials[-1]
    return f"{least:,}" if least == most else f"{least:,} to {most:,}"


def rate_table(rates: Rates, methods: Sequence[Method]) -> str:
    """Success rates, a line an action, a column a method; every bar of Fig. 6 as a number."""
    lines = [
        [f"`{action}`", *(_cell(rates, method.name, action) for method in methods)]
        for action in rates.actions
    ]
    if len(rates.actions) > 1:
        lines.append(["mean", *(_mean(rates, method.name) for method in methods)])
    return markdown_table(
        ["action", *(method.label for method in methods)], lines, "l" + "r" * len(methods)
    )


def _cell(rates: Rates, method: str, action: str) -> str:
    if (counts := rates.counts(method, action)) is None:
        return NOTHING
    solved = rates.solved(method, action)
    starts = f"<br>{solved[0]} of {solved[1]} starts" if solved else ""
    return f"{percent(rates.interval(method, action))}<br>{counts[0]:,} of {counts[1]:,}{starts}"


def _mean(rates: Rates, method: str) -> str:
    """Over all actions, which have starts of their own; nothing where one is missing."""
    if rates.shared_actions(method) != rates.actions:
        return NOTHING
    return percent(mean_rate([rates.interval(method, action) for action in rates.actions]))


def ratio_table(rates: Rates, pairs: Sequence[tuple[Method, Method]]) -> str:
    """How many times the first of each pair succeeds as often as the second, action by action."""
    header = ["action", *(f"{first.label} / {base.label}" for first, base in pairs)]
    lines = []
    for action in rates.actions:
        cells = [
            times(rates.ratio(first.name, base.name, action))
            if action in rates.shared_actions(first.name, base.name)
            else NOTHING
            for first, base in pairs
        ]
        lines.append([f"`{action}`", *cells])
    return markdown_table(header, lines, "l" + "r" * len(pairs))


def success_rates(rates: Rates, methods: Sequence[Method], name: str) -> Picture:
    """Fig. 6 and Fig. 7: a group of bars an action, separators between the four primitives.

    Whiskers are 95 % intervals, the number above each is the rate in per cent. A method that
    was not run has no bars and says so in the key.
    """
    actions = rates.actions
    run = [method for method in methods if method.name in rates.methods]
    width = min(0.8 / len(run), 0.3)
    with styled():
        figure = new_figure(3.7)
        axes = figure.add_subplot()
        for place, method in enumerate(run):
            offset = (place - (len(run) - 1) / 2) * width
            for group, action in enumerate(actions):
                _bar(axes, rates, method, action, group + offset, width)
        _separate_primitives(axes, actions)
        axes.set_xticks(range(len(actions)), actions)
        axes.set_xlim(-0.55, len(actions) - 0.45)
        axes.set_ylim(0, 1.13)
        axes.set_yticks(np.linspace(0, 1, 6))
        axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
        axes.set_ylabel("success rate")
        bare_axis(axes, grid="y")
        _key(axes, methods, {method.name for method in run})
        measured = ", ".join(method.label for method in run)
        alt = f"Success rate on {len(actions)} topological actions: {measured}"
        return render(figure, name, alt)


def _bar(axes: Axes, rates: Rates, method: Method, action: str, x: float, width: float) -> None:
    if rates.counts(method.name, action) is None:
        axes.annotate("–", (x, 0), (0, 3), textcoords="offset points", color=MUTED, ha="center")
        return
    rate = rates.interval(method.name, action)
    value, low, high = rate.estimate, rate.low, rate.high
    assert low is not None and high is not None
    axes.bar(x, value, width * 0.9, color=method.colour)
    axes.plot([x, x], [low, high], color=INK, linewidth=0.9, solid_capstyle="butt")
    percent = 100 * value
    axes.annotate(
        f"{percent:.1f}" if 0 < percent < 9.95 else f"{percent:.0f}",
        (x, high),
        (0, 2),
        textcoords="offset points",
        ha="center",
        fontsize=6.5,
        color=MUTED,
    )


def _separate_primitives(axes: Axes, actions: list[str]) -> None:
    left = 0
    for primitive in PRIMITIVES:
        count = sum(action in actions for action in primitive.actions)
        if not count:
            continue
        if left:
            axes.axvline(left - 0.5, color=INK, linewidth=0.8)
        # A name is written out where its group is wide enough for it.
        name = primitive.name if count > 1 or len(primitive.name) < 8 else primitive.name[0]
        axes.text(left + (count - 1) / 2, 1.09, name, ha="center", fontsize=8, color=MUTED)
        left += count
    if 0 < left < len(actions):
        axes.axvline(left - 0.5, color=INK, linewidth=0.8)


def _key(axes: Axes, methods: Sequence[Method], run: set[str]) -> None:
    handles = [
        Patch(
            facecolor=method.colour if method.name in run else "none",
            edgecolor=method.colour if method.name in run else MUTED,
            linestyle="-" if method.name in run else ":",
            label=method.label if method.name in run else f"{method.label} (not run yet)",
        )
        for method in methods
    ]
    key = axes.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=len(methods),
        frameon=False,
        fontsize=8.5,
        handlelength=1.1,
        handleheight=0.9,
        borderaxespad=0.3,
        columnspacing=1.6,
    )
    for text, method in zip(key.get_texts(), methods, strict=True):
        text.set_color(INK if method.name in run else MUTED)
