"""Sec. VI: ropes at rest, estimated from one RGB-D image."""

from __future__ import annotations

from typing import Any

import pandas as pd

from knotflow.intervals import wilson
from knotflow.report.results import AMOUNT, COUNT, FLAG, SHARE, TEXT, Column, Results
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import bootstrap
from knotflow.report.style import Picture, bare_axis, new_figure, render, styled
from knotflow.report.tables import NOTHING, estimate, markdown_table, percent

EXPERIMENT = "perception"
ERROR = Column("number", 0, optional=True)
"""Empty where no rope was found."""
COLUMNS = {"method": TEXT, "noise": AMOUNT, "crossings": COUNT, "rope": COUNT, "seconds": AMOUNT}
COLUMNS |= dict.fromkeys(("mean_error_mm", "p95_error_mm", "off_curve_error_mm"), ERROR)
COLUMNS["rope_iou"] = SHARE
COLUMNS |= dict.fromkeys(("state_correct", "head_correct", "doubtful"), FLAG)
PLANS = {"rope": TEXT, "planned_from": TEXT, "planned": FLAG, "tied": FLAG, "branches": COUNT}
PLANS |= {"seconds": AMOUNT, "mean_error_mm": ERROR}
STEPS = {"grid": COUNT, "milliseconds": AMOUNT}
GROUPS = ((0, 3), (4, 5))
"""Ropes are put together by their number of crossings, from and to."""
METHODS = {
    "rendering": "skeleton and rendering",
    "rendering_without_depth": "skeleton and rendering, without depth",
    "rendering_poor_start": "rendering from a poor start",
    "network": "network alone",
    "network_without_strands": "network alone, strands not followed",
    "network_without_strands_self_supervision": "the same, without self-supervision",
    "network_rendering": "network and rendering",
    "network_rendering_without_strands": "network and rendering, strands not followed",
    "network_rendering_without_strands_self_supervision": "the same, without self-supervision",
    "network_rendering_without_depth": "network and rendering, without depth",
    "network_tracing_rendering": "network, skeleton and rendering",
    "network_tracing_rendering_without_strands": (
        "network, skeleton and rendering, strands not followed"
    ),
    "network_tracing_rendering_plain_rope": "network, skeleton and rendering, head not coloured",
    "network_tracing_rendering_fine": "network, skeleton and rendering, 640 by 480 pixels",
}
"""Methods and what the report calls them."""
SHOWN = ("network_tracing_rendering", "rendering")
"""The figure's method is the first of these that was run."""
COLOURS = ("#009e73", "#0072b2", "#e69f00")


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure and the table."""
    key = ("method", "noise", "crossings", "rope")
    estimates = results.table(EXPERIMENT, "estimates.csv", COLUMNS, key)
    if estimates is None:
        return None
    lines = []
    for method, label in METHODS.items():
        of_method = estimates[estimates["method"] == method]
        if of_method.empty:
            lines.append([label, "not run", *[NOTHING] * 8])
        for noise, of in of_method.groupby("noise"):
            for low, high in GROUPS:
                some = of[of["crossings"].between(low, high)]
                if not some.empty:
                    lines.append([label, f"{noise:g}", *_line(some)])
    header = ["method", "noise", "crossings", "ropes", "mean error, mm", "off the curve, mm"]
    header += ["state right", "wrong states in doubt", "head right", "CPU time"]
    run = set(estimates["method"])
    images = estimates.drop_duplicates(["noise", "crossings", "rope"]).groupby("noise")
    steps = results.table("benchmark", "gradient_steps.csv", STEPS, ("grid",))
    shown = next((method for method in SHOWN if method in run), None)
    return {
        "table": markdown_table(header, lines, "llrrrrrrrr"),
        "shown": METHODS.get(shown or ""),
        "figure": shown and pictures.add(_figure(estimates[estimates["method"] == shown])),
        "sure": _sure(estimates[estimates["method"] == shown]),
        "pictures": pictures.stored(results, EXPERIMENT, "estimates", "Estimates of ropes"),
        "iou": [f"{of['rope_iou'].mean():.2f} at noise {noise:g}" for noise, of in images],
        "plans": _plans(results),
        "steps": None if steps is None else steps.to_dict("records"),
        "without_network": not any(method.startswith("network") for method in run),
    }


def _plans(results: Results) -> dict[str, dict[str, str]] | None:
    """Shares of ropes for which a plan was found, and tied the true rope, by what was planned
    from; None where nothing was."""
    plans = results.table(EXPERIMENT, "plans.csv", PLANS, ("rope", "planned_from"))
    if plans is None:
        return None
    return {
        str(planned_from): {"ropes": str(len(of))}
        | {
            column: percent(wilson(int(of[column].sum()), len(of)))
            for column in ("planned", "tied")
        }
        for planned_from, of in plans.groupby("planned_from")
    }


def _sure(shown: pd.DataFrame) -> list[dict[str, Any]]:
    """A line a level of noise: how many estimates are without a doubt, and of how many of these the
    state is right."""
    return [
        {"noise": f"{noise:g}", "ropes": len(of), "sure": len(sure)}
        | {"right": percent(wilson(int(sure["state_correct"].sum()), len(sure)))}
        for noise, of in shown.groupby("noise")
        if len(sure := of[~of["doubtful"]])
    ]


def _line(some: pd.DataFrame) -> list[str]:
    wrong = some[~some["state_correct"]]
    found = some.dropna(subset=["mean_error_mm"])
    errors = [
        estimate(bootstrap(found[name])) if len(found) else NOTHING
        for name in ("mean_error_mm", "off_curve_error_mm")
    ]
    return [
        f"{some['crossings'].min()} to {some['crossings'].max()}",
        str(len(some)),
        *errors,
        percent(wilson(int(some["state_correct"].sum()), len(some))),
        f"{int(wrong['doubtful'].sum())} of {len(wrong)}",
        percent(wilson(int(some["head_correct"].sum()), len(some))),
        f"{some['seconds'].median():.1f} s",
    ]


def _figure(shown: pd.DataFrame) -> Picture:
    """Share of states that are right, and mean error, by crossings; a line a level of noise."""
    with styled():
        figure = new_figure(2.6)
        right, error = figure.subplots(1, 2)
        levels = shown.groupby("noise")
        for colour, (noise, of) in zip(COLOURS, levels, strict=False):
            by = of.groupby("crossings")
            label = f"noise {noise:g}"
            states = 100 * by["state_correct"].mean()
            right.plot(states, marker="o", markersize=4, color=colour, label=label)
            error.plot(by["mean_error_mm"].median(), marker="o", markersize=4, color=colour)
        right.set(xlabel="crossings", ylabel="state right, %", ylim=(0, 103))
        error.set(xlabel="crossings", ylabel="error of a vertex, mm (median rope)", ylim=(0, None))
        for axes in (right, error):
            axes.set_xticks(sorted(shown["crossings"].unique()))
            bare_axis(axes, grid="y")
        right.legend(frameon=False, loc="lower left")
        alt = "States that are right, and errors, of estimated ropes by their number of crossings"
        return render(figure, "perception", alt)


SECTION = Section(
    EXPERIMENT,
    "Ropes from one image",
    "Sec. VI",
    "The shape and the topological state of ropes at rest, estimated from one simulated RGB-D "
    "image.",
    values,
)
