"""Learning curves: a figure for imitation, one for reinforcement, one for joint finetuning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from knotflow.report.learning.records import EPISODE_SUCCESS, POLICY_SUCCESS, Curve, Curves
from knotflow.report.paper import PRIMITIVES, in_order
from knotflow.report.style import INK, MUTED, PAPER, Picture, bare_axis, new_figure, render, styled

#: Of the Okabe-Ito palette, by primitive, or by action within one.
COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7")
PANELS = (
    ("loss_critic", "critic: cross-entropy"),
    ("loss_actor", "actor: REINFORCE loss"),
    ("critic_accuracy", "critic: judged rightly"),
)
#: Rounds that a smoothed rate is the mean of; the attempts of one round are few.
SMOOTHED = 5


def imitation(curves: Curves, name: str) -> Picture:
    """Validation (solid) and training (pale), a colour a primitive; a dot where weights were kept.

    Actor and critic each keep the weights of their own lowest validation loss.
    """
    with styled():
        figure = new_figure(2.65)
        for axes, (metric, title) in zip(figure.subplots(1, len(PANELS)), PANELS, strict=True):
            for primitive in curves.primitives:
                colour = COLOURS[(primitive - 1) % len(COLOURS)]
                training = curves.get(primitive, metric)
                if training:
                    axes.plot(
                        training.steps, training.values, color=colour, linewidth=0.8, alpha=0.45
                    )
                held_out = curves.get(primitive, f"validation_{metric}")
                if held_out:
                    axes.plot(held_out.steps, held_out.values, color=colour, linewidth=1.5)
                    _kept(axes, held_out, curves.get(primitive, "validation_loss_critic"), colour)
            axes.set_title(title, fontsize=8.5, color=INK)
            axes.set_xlabel("validation")
            axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
            if metric == "critic_accuracy":
                axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
            elif metric == "loss_critic":
                axes.set_ylim(0, None)
            bare_axis(axes, grid="y")
        handles = [
            Line2D([], [], color=COLOURS[(n - 1) % len(COLOURS)], linewidth=1.5, label=_title(n))
            for n in curves.primitives
        ]
        figure.legend(
            handles=handles, loc="outside upper left", ncols=len(handles), frameon=False, fontsize=8
        )
        alt = f"Learning curves of the imitation of {len(curves.primitives)} primitives"
        return render(figure, name, alt)


def _kept(axes: Axes, curve: Curve, critic: Curve | None, colour: str) -> None:
    """A dot where the weights behind a curve were kept."""
    deciding = critic if curve.metric == "validation_critic_accuracy" else curve
    if deciding is None:
        return
    step = deciding.lowest[0]
    value = dict(zip(curve.steps, curve.values, strict=True)).get(step)
    if value is not None:
        axes.plot(
            step, value, "o", markersize=5, color=colour, markeredgecolor=PAPER, markeredgewidth=0.9
        )


def reinforcement(curves: Curves, name: str) -> Picture:
    """Success rate of the policy's own attempts, a panel a primitive, a colour an action.

    Dots are single rounds, the line is their moving mean.
    """
    with styled():
        figure = new_figure(2.65)
        panels = figure.subplots(1, len(curves.primitives), sharey=True, squeeze=False)[0]
        for axes, primitive in zip(panels, curves.primitives, strict=True):
            of_action = curves.by_action(primitive, POLICY_SUCCESS)
            for place, action in enumerate(in_order(list(of_action))):
                curve, colour = of_action[action], COLOURS[place % len(COLOURS)]
                axes.plot(
                    *(curve.steps, curve.values, "o"), color=colour, markersize=2.2, alpha=0.45
                )
                axes.plot(
                    *(curve.steps, smoothed(curve.values)),
                    color=colour,
                    linewidth=1.6,
                    label=action,
                )
            axes.set_title(_title(primitive), fontsize=8.5, color=INK)
            axes.set_xlabel("round")
            rounds = max((curve.steps[-1] for curve in of_action.values()), default=1)
            axes.set_xlim(0, rounds + 1)
            axes.set_ylim(0, 1.04)
            axes.set_yticks(np.linspace(0, 1, 6))
            axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
            axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
            bare_axis(axes, grid="y")
            key = axes.legend(loc="lower right", frameon=False, fontsize=7.5, handlelength=1.2)
            for text in key.get_texts():
                text.set_color(INK)
        panels[0].set_ylabel("attempts that succeed", color=MUTED)
        actions = sum(len(curves.by_action(n, POLICY_SUCCESS)) for n in curves.primitives)
        alt = f"Success rates of {actions} actions over the rounds of reinforcement"
        return render(figure, name, alt)


def joint(curves: Curves, name: str) -> Picture:
    """How many episodes tied the rope, and of each step how many of the policy's own attempts.

    Dots are single rounds, lines their moving mean.
    """
    found: dict[str, Curve] = {}
    for curve in curves:
        if curve.metric == EPISODE_SUCCESS:
            found["all steps"] = curve
    for primitive in curves.primitives:
        found |= curves.by_action(primitive, POLICY_SUCCESS)
    with styled():
        figure = new_figure(2.4)
        axes = figure.add_subplot()
        for colour, (label, curve) in zip((INK, *COLOURS), found.items(), strict=False):
            axes.plot(*(curve.steps, curve.values, "o"), color=colour, markersize=2.2, alpha=0.45)
            axes.plot(
                *(curve.steps, smoothed(curve.values)), color=colour, linewidth=1.6, label=label
            )
        axes.set_xlabel("round")
        axes.set_ylabel("share that succeeds", color=MUTED)
        axes.set_ylim(0, 1.04)
        axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        bare_axis(axes, grid="y")
        figure.legend(loc="outside upper left", ncols=len(found), frameon=False, fontsize=8)
        return render(figure, name, "Success of episodes and of their steps by round")


def smoothed(values: Sequence[float]) -> list[float]:
    """The mean over SMOOTHED rounds around each, fewer at the ends so that no end is bent."""
    half = SMOOTHED // 2
    reach = [min(half, i, len(values) - 1 - i) for i in range(len(values))]
    return [float(np.mean(values[i - r : i + r + 1])) for i, r in enumerate(reach)]


def _title(primitive: int) -> str:
    """`3: Cross, end over`: the paper's number, and a name that fits above a narrow panel."""
    short = {
        "3: Cross, an end goes over": "3: Cross, end over",
        "4: other Cross actions": "4: other Cross",
    }
    known = {int(one.name.split(":")[0]): one.name for one in PRIMITIVES}
    told = known.get(primitive, str(primitive))
    return short.get(told, told)
