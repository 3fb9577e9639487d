"""Trainings of the networks that see ropes and that predict them (Sec. VI)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from string import Formatter
from typing import Any

import pandas as pd

from knotflow.report.learning import COLOURS, LINES, panel
from knotflow.report.results import AMOUNT, AT_LEAST_ONE, Results
from knotflow.report.section import Pictures, Section
from knotflow.report.style import Picture, new_figure, render, styled

#: What a panel is of: the columns it draws, and what they are called.
Panels = Mapping[str, Mapping[str, str]]


def values(
    experiment: str, panels: Panels, line: str, results: Results, pictures: Pictures
) -> dict[str, Any] | None:
    """The learning curves, and the last validation in a line."""
    named = [name for _, name, _, _ in Formatter().parse(line) if name]
    columns = {column: AMOUNT for drawn in (*panels.values(), named) for column in drawn}
    columns["step"] = AT_LEAST_ONE
    curves = results.table(experiment, "curves.csv", columns, key=("step",))
    if curves is None:
        return None
    curves = curves.sort_values("step")
    last = curves.to_dict("records")[-1]
    return {
        "figure": pictures.add(_figure(curves.set_index("step"), panels, experiment)),
        "line": line.format(**last).replace("%", " %"),
    }


def _figure(curves: pd.DataFrame, panels: Panels, name: str) -> Picture:
    """A panel each: training pale, validations solid."""
    with styled():
        figure = new_figure(2.4)
        all_axes = figure.subplots(1, len(panels))
        for axes, (title, drawn) in zip(all_axes, panels.items(), strict=True):
            for colour, (column, label) in zip(COLOURS, drawn.items(), strict=False):
                style = LINES["validation_" if column.startswith("validation_") else ""]
                axes.plot(curves[column], color=colour, label=label, **style)
            rate = column == "validation_crossings"
            panel(axes, title, "gradient step", ticks=5, rate=rate)
            axes.xaxis.set_major_formatter("{x:,.0f}")
            axes.set_ylim(0, None)
            axes.legend(frameon=False, fontsize=7.5)
        return render(figure, name, f"Learning curves over {curves.index[-1]:,} gradient steps")


def _section(experiment: str, title: str, about: str, line: str, panels: Panels) -> Section:
    found = partial(values, experiment, panels, line)
    return Section(experiment, title, "Sec. VI", about, found, template="training")


PERCEPTION = _section(
    "perception_training",
    "Training: ropes from one image",
    "The network that proposes a first shape of a rope in an image learns from simulated ropes.",
    "After {step:,} gradient steps, vertices of ropes held out are off by "
    "{validation_error_mm:.1f} mm on the average (median rope {validation_median_mm:.1f} mm), and "
    "{validation_crossings:.1%} of crossings are the right way round.",
    {
        "loss": {"loss": "training", "validation_loss": "held out"},
        "error of a vertex, mm": {
            "validation_error_mm": "held out, mean",
            "validation_median_mm": "median rope",
        },
        "crossings the right way round": {"validation_crossings": "held out"},
    },
)
STRANDS = _section(
    "strand_training",
    "Training: strands of a rope",
    "The network that follows strands learns from windows along simulated ropes.",
    "After {step:,} gradient steps, {validation_headings:.1%} of steps along ropes held out go the "
    "right way within 0.3 radians, {validation_ends:.1%} of ends are recognised, and heights are "
    "off by {validation_height:.2f} radii.",
    {
        "loss": {"loss": "training", "validation_loss": "held out"},
        "error in height, radii": {"validation_height": "held out"},
    },
)
DYNAMICS = _section(
    "dynamics_training",
    "Training: dynamics of a rope",
    "The network that predicts dragged ropes learns from perturbed ones.",
    "After {step:,} gradient steps, predicted vertices of motions held out are off by "
    "{validation_1_mm:.1f} mm after 0.1 s, {validation_10_mm:.1f} mm after 1 s and "
    "{validation_25_mm:.1f} mm after 2.5 s.",
    {
        "error in training, mm": {"error_mm": "over longer and longer stretches"},
        "error of motions held out, mm": {
            "validation_25_mm": "after 2.5 s",
            "validation_10_mm": "after 1 s",
            "validation_1_mm": "after 0.1 s",
        },
    },
)
