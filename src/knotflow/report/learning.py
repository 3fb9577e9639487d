"""Learning curves of the primitives: read, and a figure for imitation and for reinforcement."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from knotflow.report.paper import PRIMITIVES, in_order
from knotflow.report.results import AT_LEAST_ONE, COUNT, NUMBER, TEXT, Results
from knotflow.report.style import INK, MUTED, Picture, bare_axis, new_figure, render, styled

#: Of the Okabe-Ito palette, by primitive, or by action within one.
COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00")
PANELS = {
    "loss_critic": "critic: cross-entropy",
    "loss_actor": "actor: REINFORCE loss",
    "critic_accuracy": "critic: judged rightly",
}
#: How a metric is drawn whose name has this in front.
LINES = {"": {"linewidth": 0.8, "alpha": 0.45}, "validation_": {"linewidth": 1.5}}
#: Metrics of a single action are called "policy_success/C(2,0,1)".
POLICY_SUCCESS = "policy_success/"
#: Rounds that a smoothed rate is the mean of; the attempts of one round are few.
SMOOTHED = 5
SHORT = {
    "3: Cross, an end goes over": "3: Cross, end over",
    "4: other Cross actions": "4: other Cross",
}

#: One metric of one primitive, its index the validation (imitation) or round from 1.
Curves = dict[tuple[int, str], pd.Series]


def read_curves(results: Results, experiment: str, name: str) -> Curves | None:
    """A table of learning curves, a row a value, by primitive and metric; steps begin at 0 there.

    None where it is not there.
    """
    columns = {"primitive": AT_LEAST_ONE, "step": COUNT, "metric": TEXT, "value": NUMBER}
    table = results.table(experiment, name, columns, key=("primitive", "metric", "step"))
    if table is None:
        return None
    groups = table.assign(step=table["step"] + 1).groupby(["primitive", "metric"], sort=False)
    return {
        (int(primitive), str(metric)): own.set_index("step")["value"].sort_index()
        for (primitive, metric), own in groups
    }


def by_action(curves: Curves, primitive: int) -> dict[str, pd.Series]:
    """The success rate of the policy's own attempts by action, in the order of Fig. 6."""
    found = {
        metric.removeprefix(POLICY_SUCCESS): curve
        for (number, metric), curve in curves.items()
        if number == primitive and metric.startswith(POLICY_SUCCESS)
    }
    return {action: found[action] for action in in_order(list(found))}


def imitation(curves: Curves, name: str) -> Picture:
    """Held-out demonstrations (solid) and training (pale), a colour a primitive."""
    with styled():
        figure = new_figure(2.65)
        for axes, metric in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
            for primitive in _primitives(curves):
                for held_out, style in LINES.items():
                    if (curve := curves.get((primitive, held_out + metric))) is not None:
                        axes.plot(curve, color=_colour(primitive), **style)
            panel(axes, PANELS[metric], "validation", ticks=5, rate=metric == "critic_accuracy")
            if metric == "loss_critic":
                axes.set_ylim(0, None)
        handles = [
            Line2D([], [], color=_colour(number), linewidth=1.5, label=_title(number))
            for number in _primitives(curves)
        ]
        figure.legend(
            handles=handles, loc="outside upper left", ncols=len(handles), frameon=False, fontsize=8
        )
        alt = f"Learning curves of the imitation of {len(handles)} primitives"
        return render(figure, name, alt)


def reinforcement(curves: Curves, name: str) -> Picture:
    """Success rate of the policy's own attempts, a panel a primitive, a colour an action."""
    primitives = _primitives(curves)
    with styled():
        figure = new_figure(2.65)
        panels = figure.subplots(1, len(primitives), sharey=True, squeeze=False)[0]
        for axes, primitive in zip(panels, primitives, strict=True):
            of_action = by_action(curves, primitive)
            for place, (action, curve) in enumerate(of_action.items()):
                _rounds(axes, curve, COLOURS[place % len(COLOURS)], action)
            panel(axes, _title(primitive), rate=True)
            axes.set_ylim(0, 1.04)
            rounds = max((curve.index[-1] for curve in of_action.values()), default=1)
            axes.set_xlim(0, rounds + 1)
            axes.set_yticks(np.linspace(0, 1, 6))
            axes.legend(loc="lower right", frameon=False, fontsize=7.5, handlelength=1.2)
        panels[0].set_ylabel("attempts that succeed", color=MUTED)
        actions = sum(len(by_action(curves, number)) for number in primitives)
        alt = f"Success rates of {actions} actions over the rounds of reinforcement"
        return render(figure, name, alt)


def smoothed(values: Sequence[float]) -> list[float]:
    """The mean over SMOOTHED rounds around each, fewer at the ends so that no end is bent."""
    half = SMOOTHED // 2
    reach = [min(half, i, len(values) - 1 - i) for i in range(len(values))]
    return [float(np.mean(values[i - r : i + r + 1])) for i, r in enumerate(reach)]


def _rounds(axes: Axes, curve: pd.Series, colour: str, label: str) -> None:
    """Single rounds as dots, their moving mean as a line."""
    axes.plot(curve.index, curve, "o", color=colour, markersize=2.2, alpha=0.45)
    axes.plot(curve.index, smoothed(curve.tolist()), color=colour, linewidth=1.6, label=label)


def panel(
    axes: Axes, title: str, over: str = "round", *, ticks: int = 4, rate: bool = False
) -> None:
    """What is common to the panels of learning curves; a `rate` is written in per cent."""
    axes.set_title(title, fontsize=8.5, color=INK)
    axes.set_xlabel(over)
    axes.xaxis.set_major_locator(MaxNLocator(ticks, integer=True))
    if rate:
        axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
    bare_axis(axes, grid="y")


def _primitives(curves: Curves) -> list[int]:
    return sorted({primitive for primitive, _ in curves})


def _colour(primitive: int) -> str:
    return COLOURS[(primitive - 1) % len(COLOURS)]


def _title(primitive: int) -> str:
    """`3: Cross, end over`: the paper's number, and a name that fits above a narrow panel."""
    known = {int(one.name.split(":")[0]): one.name for one in PRIMITIVES}
    name = known.get(primitive, str(primitive))
    return SHORT.get(name, name)
