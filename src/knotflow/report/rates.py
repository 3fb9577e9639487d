"""Success rates of methods on topological actions: read, drawn and tabled for Fig. 6 and Fig. 7."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from knotflow import statistics
from knotflow.report import markdown as md
from knotflow.report.results import NotMeasured, Results, refuse
from knotflow.report.section import Figures, bare_axis, per_cent
from knotflow.statistics import Interval
from knotflow.viz.style import INK, MUTED

PRIMITIVES = {
    "1: R1": ("R1(0,1,1)",),
    "2: R2": ("R2(0,0,1,1)",),
    "3: Cross, end over": ("C(0,1,1)", "C(0,2,1)", "C(2,1,-1)", "C(2,0,-1)"),
    "4: Cross, end under": ("C(2,0,1)", "C(2,4,1)"),
}
"""The four motion primitives (Sec. V-A) and the actions that each serves."""
ACTIONS = tuple(action for actions in PRIMITIVES.values() for action in actions)
"""All of these, in the order of Fig. 6."""


@dataclass(frozen=True)
class Method:
    """A method, or a way of training, that is compared with others."""

    name: str
    label: str
    colour: str


RANDOM = Method("random", "random", "#8a8f98")
ICP = Method("icp", "ICP", "#e69f00")
IMITATION = Method("imitation", "imitation", "#56b4e9")
REINFORCEMENT = Method("reinforcement", "imitation + RL", "#0072b2")
ARRANGED = Method("reinforcement_arranged", "shipped + arranging", "#009e73")
"""Beyond the paper: the shipped primitives, which may arrange the rope first."""
EXTRA_COLOURS = ("#cc79a7", "#d55e00", "#f0e442")


def with_extras(methods: Sequence[Method], found: Sequence[str]) -> list[Method]:
    """The paper's methods in its order, then those of `found` that it does not have."""
    known = {method.name for method in methods}
    extras = [name for name in dict.fromkeys(found) if name not in known | {ARRANGED.name}]
    return [
        *methods,
        *([ARRANGED] if ARRANGED.name in found else []),
        *(
            Method(name, name.replace("_", " "), colour)
            for name, colour in zip(extras, EXTRA_COLOURS, strict=False)
        ),
    ]


def in_order(actions: Sequence[str]) -> list[str]:
    """`actions` without repeats, the eight of Fig. 6 first and in its order."""
    found = list(dict.fromkeys(actions))
    return [a for a in ACTIONS if a in found] + [a for a in found if a not in ACTIONS]


class Rates:
    """How often each method reached each action's goal state, by training and start."""

    def __init__(self, table: pd.DataFrame) -> None:
        self.counts = {
            key: (_by_training(own, "successes"), _by_training(own, "trials"))
            for key, own in table.groupby(["method", "action"], sort=False)
        }
        """Successes and trials by method and action, a row a training and a column a start."""
        self.methods = list(dict.fromkeys(table["method"]))
        self.actions = in_order(list(table["action"]))
        trials = sorted({int(tried.to_numpy().sum()) for _, tried in self.counts.values()})
        self.trials = f"{trials[0]:,}" if len(trials) == 1 else f"{trials[0]:,} to {trials[-1]:,}"

    def by_training(self, method: str, action: str) -> pd.Series:
        """The success rate of each training."""
        hits, trials = self.counts[method, action]
        return hits.sum(axis=1) / trials.sum(axis=1)

    def solved(self, method: str, action: str) -> pd.Series:
        """Whether a spline succeeded, by start."""
        return (self.counts[method, action][0] > 0).any()

    def interval(self, method: str, action: str) -> Interval:
        """The success rate with its interval. Raises KeyError where it was not measured."""
        return statistics.clustered_rate(*self.counts[method, action])

    def mean(self, method: str) -> Interval:
        """The mean over all actions."""
        return statistics.clustered_mean([self.counts[method, action] for action in self.actions])

    def gain(self, method: str, base: str) -> Interval:
        """By how many points the mean over the actions of both is above the base's."""
        shared = self.shared_actions(method, base)
        gain = statistics.clustered_gain(
            *([self.counts[one, action] for action in shared] for one in (method, base))
        )
        return Interval(100 * gain.estimate, 100 * gain.low, 100 * gain.high)

    def trainings_mean(self, method: str, actions: Sequence[str] = ()) -> pd.Series:
        """The mean over `actions`, by default all, of each training."""
        rates = [self.by_training(method, action) for action in actions or self.actions]
        return pd.concat(rates, axis=1).mean(axis=1)

    def ratio(self, method: str, base: str, action: str) -> Interval:
        """How many times as often `method` succeeds as `base`; nan where both never do."""
        return statistics.clustered_ratio(*self.counts[method, action], *self.counts[base, action])

    def shared_actions(self, *methods: str) -> list[str]:
        """The actions on which every one of `methods` was measured."""
        return [a for a in self.actions if all((m, a) in self.counts for m in methods)]

    def table(self, methods: Sequence[Method]) -> str:
        """Success rates, a line an action, a column a method, with the mean at the end."""
        rows = [
            {"action": f"`{action}`"} | {m.label: self._cell(m.name, action) for m in methods}
            for action in self.actions
        ]
        if len(self.actions) > 1:
            rows.append({"action": "mean"} | {m.label: self._mean(m.name) for m in methods})
        return md.table(rows)

    def _cell(self, method: str, action: str) -> str:
        if (method, action) not in self.counts:
            return md.NOTHING
        hits, trials = (int(one.to_numpy().sum()) for one in self.counts[method, action])
        each = [md.whole(100 * rate) for rate in self.by_training(method, action)]
        trained = f"<br>trainings {' / '.join(each)}" if len(each) > 1 else ""
        return f"{md.percent(self.interval(method, action))}<br>{hits:,} of {trials:,}{trained}"

    def _mean(self, method: str) -> str:
        """Over all actions; nothing where one is missing."""
        measured = self.shared_actions(method) == self.actions
        return md.percent(self.mean(method)) if measured else md.NOTHING

    def ratio_table(self, pairs: Sequence[tuple[Method, Method]]) -> str:
        """How many times as often the first of each pair succeeds as the second; '' without."""

        def cell(first: str, base: str, action: str) -> str:
            shared = action in self.shared_actions(first, base)
            return md.times(self.ratio(first, base, action)) if shared else md.NOTHING

        rows = [
            {"action": f"`{action}`"}
            | {f"{m.label} / {base.label}": cell(m.name, base.name, action) for m, base in pairs}
            for action in (self.actions if pairs else ())
        ]
        return md.table(rows, "Ratios of success rates, with 95 % intervals:")

    def figure(self, figures: Figures, methods: Sequence[Method], name: str, of: str) -> str:
        """Bars in groups of an action, with a separator between the four primitives.

        A method that was not run has no bars and says so in the key.
        """
        caption = (
            f"{of}: success rate in per cent of splines sampled for each action, {self.trials} "
            "rollouts a bar. Whiskers are 95 % intervals with starts and trainings resampled, dots "
            "are single trainings."
        )
        return figures.draw(name, caption, 3.7, lambda figure: self._plot(figure, methods))

    def _plot(self, figure: Figure, methods: Sequence[Method]) -> None:
        axes = figure.add_subplot()
        run = [method for method in methods if method.name in self.methods]
        width = min(0.8 / len(run), 0.3)
        for place, method in enumerate(run):
            offset = (place - (len(run) - 1) / 2) * width
            for group, action in enumerate(self.actions):
                self._bar(axes, method, action, group + offset, width)
        left = 0
        for primitive, actions in PRIMITIVES.items():
            count = sum(action in self.actions for action in actions)
            if count and left:
                axes.axvline(left - 0.5, color=INK, linewidth=0.8)
            if count:
                label = primitive if count > 1 else primitive.partition(": ")[2]
                axes.text(left + (count - 1) / 2, 1.09, label, ha="center", fontsize=8, color=MUTED)
            left += count
        axes.set_xticks(range(len(self.actions)), self.actions)
        axes.set_xlim(-0.55, len(self.actions) - 0.45)
        axes.set_ylim(0, 1.13)
        axes.set_yticks(np.linspace(0, 1, 6))
        per_cent(axes.yaxis)
        axes.set_ylabel("success rate")
        bare_axis(axes, "y")
        handles = [
            Patch(facecolor=method.colour, label=method.label)
            if method in run
            else Patch(facecolor="none", edgecolor=MUTED, ls=":", label=f"{method.label} (not run)")
            for method in methods
        ]
        figure.legend(
            handles=handles, loc="outside upper left", ncols=len(methods), frameon=False,
            fontsize=8.5, handlelength=1.1, handleheight=0.9, columnspacing=1.6,
        )  # fmt: skip

    def _bar(self, axes: Axes, method: Method, action: str, x: float, width: float) -> None:
        above = {"textcoords": "offset points", "ha": "center", "color": MUTED, "fontsize": 6.5}
        if (method.name, action) not in self.counts:
            axes.annotate(md.NOTHING, (x, 0), (0, 3), **above)  # type: ignore[arg-type]
            return
        rate = self.interval(method.name, action)
        axes.bar(x, rate.estimate, width * 0.9, color=method.colour)
        axes.plot([x, x], [rate.low, rate.high], color=INK, linewidth=0.9, solid_capstyle="butt")
        each = self.by_training(method.name, action)
        if len(each) > 1:
            across = x + width * 0.22 * np.linspace(-1, 1, len(each))
            axes.scatter(across, each, 5, "white", edgecolors=INK, linewidths=0.5, zorder=3)
        value = 100 * rate.estimate
        label = f"{value:.1f}" if 0 < value < 9.95 else md.whole(value)
        axes.annotate(label, (x, rate.high), (0, 2), **above)  # type: ignore[arg-type]


def _by_training(table: pd.DataFrame, column: str) -> pd.DataFrame:
    return table.pivot(index="training_seed", columns="start", values=column)


@lru_cache(maxsize=8)  # several claims and figures ask for the same ones
def read_rates(results: Results, experiment: str, name: str = "per_start.csv") -> Rates:
    """A table of trials and successes by method, action, training and start."""
    key = ("method", "action", "training_seed", "start")
    columns = dict.fromkeys(key, str) | {"trials": int, "successes": int}
    table = results.table(experiment, name, columns, key)
    check_counts(table)
    return Rates(table)


def check_counts(table: pd.DataFrame) -> None:
    """Refuse a row without trials or with more successes than trials."""
    wrong = (table["successes"] > table["trials"]) | (table["trials"] < 1)
    refuse(table, wrong, "{successes} successes of {trials} trials")


def complete_rates(results: Results, experiment: str, methods: Sequence[str]) -> Rates:
    """The rates of a table that has all of `methods` on all of its actions.

    Raises:
        NotMeasured: one of them is missing.
    """
    rates = read_rates(results, experiment)
    if missing := [method for method in methods if method not in rates.methods]:
        raise NotMeasured(f"needs {md.listed(missing)} in {experiment}")
    shared = rates.shared_actions(*methods)
    if missing := [action for action in rates.actions if action not in shared]:
        raise NotMeasured(f"needs {md.listed(missing)} of {md.listed(methods)} in {experiment}")
    return rates
