"""Learning curves: of the primitives, and of the networks (Sec. V-B, VI)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from knotflow.report import markdown as md
from knotflow.report.rates import PRIMITIVES, check_counts, in_order
from knotflow.report.results import Results
from knotflow.report.section import COLOURS, Figures, Parts, bare_axis, optional, per_cent
from knotflow.viz.style import INK

NAMES = {number: name for number, name in enumerate(PRIMITIVES, 1)}
NAMES |= {5: "5: arranging, state kept", 6: "6: undoing"}
"""The primitives by number: the paper's four, and those beyond it."""
QUANTITIES = {
    "headings": "headings right",
    "height": "height error, radii",
    "ends": "ends recognised",
    "error mm": "error, mm",
} | {f"{steps} mm": f"error after {0.1 * steps:g} s, mm" for steps in (1, 10, 25)}
"""What a network's curves are called."""
SHARES = ("headings right", "ends recognised")
"""Those in per cent."""
IMITATION = {
    "critic: cross-entropy": "loss_critic",
    "actor: REINFORCE loss": "loss_actor",
    "critic: accuracy": "critic_accuracy",
}
POLICY_SUCCESS = "policy_success"
"""Metric of a primitive; that of a single action is called "policy_success/C(2,0,1)"."""
PALE = {"linewidth": 0.8, "alpha": 0.45}
DOTS = {"linestyle": "", "marker": "o", "markersize": 2.2, "alpha": 0.45}
SMOOTHED = 5
"""Rounds that a smoothed rate is the mean of."""

Curves = dict[tuple[int, str], pd.Series]
"""By primitive and metric, its index the validation or round from 1."""


@dataclass(frozen=True)
class Line:
    """A curve of a panel; without a label it is not in the legend."""

    curve: pd.Series
    colour: str
    label: str = ""
    style: Mapping[str, Any] | None = None


def draw_curves(
    figures: Figures,
    name: str,
    caption: str,
    panels: Mapping[str, Sequence[Line]],
    over: str = "round",
    rates: Sequence[str] = (),
    *,
    legend: bool = False,
    same_scale: bool = False,
) -> str:
    """A figure of learning curves, a panel a title; `over` is what is at the x axis. '' without.

    Panels named in `rates` are in per cent; `legend` shows the first one's above all.
    """

    def plot(figure: Figure) -> None:
        grid = figure.subplots(1, len(panels), squeeze=False, sharey=same_scale)[0]
        for axes, lines in zip(grid, panels.values(), strict=True):
            for line in lines:
                style = line.style or {"linewidth": 1.5}
                axes.plot(line.curve, color=line.colour, label=line.label or None, **style)
        for axes, title in zip(grid, panels, strict=True):
            axes.set_title(title, fontsize=8.5, color=INK)
            axes.set_xlabel(over)
            axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
            axes.xaxis.set_major_formatter("{x:,.0f}")
            axes.yaxis.set_major_formatter("{x:,.5g}")
            axes.set_ylim(min(0, axes.get_ylim()[0]), 1.04 if title in rates else None)
            if title in rates:
                per_cent(axes.yaxis)
            bare_axis(axes, "y")
            handles, labels = axes.get_legend_handles_labels()
            if labels and not (legend and labels == grid[0].get_legend_handles_labels()[1]):
                axes.legend(handles, labels, frameon=False, fontsize=7.5, handlelength=1.2)
        if legend:
            style = {"ncols": 4, "frameon": False, "fontsize": 8}
            figure.legend(*grid[0].get_legend_handles_labels(), loc="outside upper left", **style)

    return figures.draw(name, caption, 2.65, plot) if any(panels.values()) else ""


def read_curves(results: Results, experiment: str, name: str) -> Curves:
    """A table of learning curves, a row a value."""
    columns = {"primitive": int, "step": int, "metric": str, "value": float}
    table = results.table(experiment, name, columns, key=("primitive", "metric", "step"))
    groups = table.assign(step=table["step"] + 1).groupby(["primitive", "metric"], sort=False)
    return {
        (int(primitive), str(metric)): own.set_index("step")["value"].sort_index()
        for (primitive, metric), own in groups
    }


def smoothed(curve: pd.Series) -> pd.Series:
    """The moving mean over SMOOTHED rounds, fewer at the ends."""
    return curve.rolling(SMOOTHED, center=True, min_periods=1).mean()


@optional
def imitation(results: Results, figures: Figures, experiment: str) -> str:
    """Loss and accuracy on held-out and training demonstrations; '' without curves."""
    curves = read_curves(results, experiment, "curves_imitation.csv")
    panels: dict[str, list[Line]] = {
        title: [
            Line(curves[number, before + metric], COLOURS[number - 1], label, style)
            for number in sorted({number for number, _ in curves})
            for before, label, style in (("", "", PALE), ("validation_", NAMES[number], None))
            if (number, before + metric) in curves
        ]
        for title, metric in IMITATION.items()
    }
    caption = (
        "Learning curves of imitation by primitive, on held-out demonstrations (solid) and on "
        "training batches (pale). The last weights are kept."
    )
    rates = ["critic: accuracy"]
    steps = results.setting(experiment, "steps", "imitation")
    over = f"validation, every {steps} gradient steps" if steps else "validation"
    return draw_curves(figures, "imitation", caption, panels, over, rates, legend=True)


@optional
def reinforcement(results: Results, figures: Figures, experiment: str) -> str:
    """The success rate of the policy's own attempts, a panel a primitive; '' without curves."""
    curves = read_curves(results, experiment, "curves_reinforcement.csv")
    panels: dict[str, list[Line]] = {}
    for number, title in NAMES.items():
        own = {metric.partition("/")[2]: curve for (n, metric), curve in curves.items()
               if n == number and metric.startswith(f"{POLICY_SUCCESS}/")}  # fmt: skip
        for colour, action in zip(COLOURS, in_order([*own]), strict=False):
            dots, mean = Line(own[action], colour, "", DOTS), smoothed(own[action])
            panels.setdefault(title, []).extend([dots, Line(mean, colour, action)])
    caption = (
        "Success rate of the policy's own attempts over the rounds of reinforcement, on the start "
        f"shapes of each round (dots) and as a moving mean of {SMOOTHED} rounds. These are starts "
        "of training, some of them left by failed attempts and harder than the unseen ones."
    )
    return draw_curves(figures, "reinforcement", caption, panels, rates=[*panels])


@optional
def joint(results: Results, figures: Figures, experiment: str) -> str:
    """Joint finetuning; '' without curves."""
    curves = read_curves(results, experiment, "curves_joint.csv")
    return _episodes(figures, "joint_training", "Joint finetuning with the first seed.", curves)


@optional
def _on_knots(results: Results, figures: Figures) -> str:
    """Finetuning on knots; '' without curves."""
    curves = read_curves(results, "library_training", "knot_curves.csv")
    return _episodes(figures, "knot_finetuning", "Finetuning on knots.", curves)


def _episodes(figures: Figures, name: str, title: str, curves: Curves) -> str:
    """The policy's own success by primitive, and that of whole episodes."""
    tied = curves.get((1, "tied"))  # primitive 1's curves count whole episodes
    panels = {
        "success of the policy's own splines": _own_success(curves),
        "episodes that reached their goal": []
        if tied is None
        else [Line(tied, COLOURS[0], "", DOTS), Line(smoothed(tied), COLOURS[0])],
    }
    caption = (
        f"{title} Left, the success rate of the policy's own splines along the paths of the DAG, "
        "as moving means. Right, the share of a round's episodes, exploration included, that "
        "reached their goal, and its moving mean."
    )
    return draw_curves(figures, name, caption, panels, rates=[*panels], legend=True)


def _own_success(curves: Curves) -> list[Line]:
    """The success rate of the policy's own splines by primitive."""
    lines = []
    for number, label in NAMES.items():
        if (curve := curves.get((number, POLICY_SUCCESS))) is not None:
            stretch = max(1, len(curve) // 60)  # of hundreds of rounds
            mean = curve.rolling(stretch).mean().dropna()[::stretch]
            lines.append(Line(smoothed(mean), COLOURS[number - 1], label))
    return lines


def library(results: Results, figures: Figures) -> Parts:
    """What trains the shipped primitives: success by primitive, pairs and trials, episodes."""
    curves = read_curves(results, "library_training", "curves.csv")
    pairs = [
        Line(curves[1, metric], colour, label)  # primitive 1's curves count them
        for colour, metric, label in (
            (COLOURS[-1], "pairs_tried", "tried"),
            (COLOURS[0], "pairs_solved", "succeeded at least once"),
        )
        if (1, metric) in curves
    ]
    caption = (
        "Self-play. Left, the success rate of the policy's own splines, as moving means: trials "
        "are drawn where there is most to learn, so the rates fall where harder actions come "
        "within reach. Right, the number of pairs of state and action that were tried, and that "
        "succeeded at least once."
    )
    panels = {
        "success of the policy's own splines": _own_success(curves),
        "pairs of state and action": pairs,
    }
    name, rates = "library_training", [*panels][:1]
    drawn = draw_curves(figures, name, caption, panels, rates=rates, legend=True)
    return {"self_play": md.join(drawn, _trials(results), _on_knots(results, figures))}


@optional
def _trials(results: Results) -> str:
    """How much was tried, and how much of it succeeded; '' without trials.csv."""
    columns = {"start": str, "action": str, "trials": int, "successes": int, "recent_rate": float}
    table = results.table("library_training", "trials.csv", columns, key=("start", "action"))
    check_counts(table)
    return (
        f"Self-play spent {table['trials'].sum():,} trials on {len(table):,} pairs of state and "
        f"action, counted up to Mirror and Reverse; {(table['successes'] > 0).sum():,} succeeded "
        f"at least once, and {(table['recent_rate'] > 0.5).sum():,} in more than half of the last "
        "trials."
    )


def network(experiment: str, results: Results, figures: Figures) -> Parts:
    """A network's learning curves, and where they ended."""
    table = results.table(experiment, "curves.csv", {"step": int}, key=("step",))
    curves = table.astype(float).sort_values("step").set_index("step")
    panels: dict[str, list[Line]] = {}
    for column in curves:
        quantity = str(column).removeprefix("validation_")
        held_out = quantity != column
        label, colour = ("held out", COLOURS[0]) if held_out else ("training", COLOURS[-1])
        line = Line(curves[column], colour, label, None if held_out else PALE)
        quantity = quantity.replace("_", " ")
        panels.setdefault(QUANTITIES.get(quantity, quantity), []).append(line)
    last = {"gradient steps": f"{curves.index[-1]:,.0f}"}
    for title, lines in panels.items():
        value = lines[-1].curve.iloc[-1]
        written = f"{100 * value:.1f} %" if title in SHARES else md.number(value)
        last[f"{title}, {lines[-1].label}"] = written
    caption = "Learning curves, in training (pale) and held out. The last weights are kept."
    drawn = draw_curves(figures, experiment, caption, panels, "gradient step", SHARES)
    return {"curves": md.join(drawn, md.table([last]))}
