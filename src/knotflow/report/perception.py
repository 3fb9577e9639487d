"""Ropes at rest, estimated from one RGB-D image (Sec. VI)."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from knotflow.report import markdown as md
from knotflow.report.results import Results
from knotflow.report.section import COLOURS, Figures, Parts, bare_axis
from knotflow.statistics import bootstrap

EXPERIMENT = "perception"
COLUMNS = {"method": str, "noise": float, "crossings": int, "rope": int, "seconds": float}
COLUMNS |= dict.fromkeys(("mean_error_mm", "off_curve_error_mm", "rope_iou"), float)
COLUMNS |= dict.fromkeys(("state_correct", "head_correct", "doubtful"), bool)
KEY = ("method", "noise", "crossings", "rope")
PLANS = {"rope": str, "planned_from": str, "planned": bool, "tied": bool}
GROUPS = ((0, 3), (4, 5))
"""Ropes are grouped by their number of crossings, from and to."""
BASES = {
    "rendering": "skeleton + rendering",
    "rendering_poor_start": "rendering from a poor start",
    "network": "network",
    "network_rendering": "network + rendering",
    "network_tracing_rendering": "network + skeleton + rendering",
    "network_tracing_rendering_plain_rope": "network + skeleton + rendering, head not coloured",
    "network_tracing_rendering_fine": "network + skeleton + rendering, finer images",
}
"""Methods and what the report calls them; ablations are called after what they leave out."""
SHOWN = ("network_tracing_rendering", "rendering")
"""The figure's method is the first of these that was run."""


def perception(results: Results, figures: Figures) -> Parts | None:
    """Accuracy by crossings, the table of methods, ambiguity, and plans from estimates."""
    table = results.table(EXPERIMENT, "estimates.csv", COLUMNS, KEY)
    if table is None:
        return None
    run = set(table["method"])
    shown = next((method for method in SHOWN if method in run), table["method"].iloc[0])
    own = table[table["method"] == shown]
    label = _label(shown)
    images = table.drop_duplicates(["noise", "crossings", "rope"]).groupby("noise")
    overlap = [f"{one['rope_iou'].mean():.2f} at noise {noise:g}" for noise, one in images]
    return {
        "figure": figures.draw(
            EXPERIMENT,
            f"State accuracy and vertex error by number of crossings, {label}.",
            2.6,
            lambda figure: _plot(figure, own),
        ),
        "methods": _method_table(table),
        "unambiguous": _unambiguous(own, label),
        "examples": figures.own(
            EXPERIMENT,
            "estimates.png",
            "Estimates at noise 1, a row a number of crossings: the image, the estimate over it, "
            "and its error along the rope. Vertices that the image does not show are ringed.",
        ),
        "overlap": md.listed(overlap),
        "plans": _plans(results),
    }


def _label(method: str) -> str:
    base, _, without = method.partition("_without_")
    parts = {"depth": "depth", "strands": "strand tracing"}
    parts["strands_self_supervision"] = "strand tracing and self-supervision"
    name = BASES.get(base, base.replace("_", " "))
    return f"{name}, without {parts.get(without, without)}" if without else name


def _method_table(table: pd.DataFrame) -> str:
    rows = [
        {"method": _label(str(method))} | _line(noise, some)
        for (method, noise), own in table.groupby(["method", "noise"], sort=False)
        for low, high in GROUPS
        if len(some := own[own["crossings"].between(low, high)])
    ]
    return md.table(rows)


def _line(noise: float, some: pd.DataFrame) -> dict[str, str]:
    wrong = some[~some["state_correct"]]
    found = some.dropna(subset=["mean_error_mm"])
    vertex, curve = (
        md.estimate(bootstrap(found[name])) if len(found) else md.NOTHING
        for name in ("mean_error_mm", "off_curve_error_mm")
    )
    return {
        "noise": f"{noise:g}",
        "crossings": f"{some['crossings'].min()} to {some['crossings'].max()}",
        "ropes": str(len(some)),
        "vertex error, mm": vertex,
        "curve error, mm": curve,
        "state accuracy": md.rate(some["state_correct"]),
        "flagged": f"{wrong['doubtful'].sum()} of {len(wrong)}",
        "head accuracy": md.rate(some["head_correct"]),
        "CPU time": f"{some['seconds'].median():.1f} s",
    }


def _unambiguous(shown: pd.DataFrame, label: str) -> str:
    """For each level of noise, how many estimates are unambiguous, and how many of these right."""
    parts = [
        f"{md.rate(sure['state_correct'])} at noise {noise:g} ({len(sure)} of {len(own)} ropes)"
        for noise, own in shown.groupby("noise")
        if len(sure := own[~own["doubtful"]])
    ]
    if not parts:
        return ""
    return (
        "An estimate reports whether it is ambiguous. The state accuracy of unambiguous estimates "
        f"by {label} is {md.listed(parts)}."
    )


def _plans(results: Results) -> str:
    """Shares of ropes with a plan, and of plans that tie the true rope; '' without plans."""
    plans = results.table(EXPERIMENT, "plans.csv", PLANS, ("rope", "planned_from"))
    if plans is None:
        return ""
    parts = [
        f"from {planned_from} shapes, {md.rate(own['planned'])} of {len(own)} random ropes had a "
        f"plan and {md.rate(own['tied'])} were tied"
        for planned_from, own in plans.groupby("planned_from")
    ]
    return f"Plans for the overhand, executed in simulation on the true rope: {'; '.join(parts)}."


def _plot(figure: Figure, shown: pd.DataFrame) -> None:
    """State accuracy and median vertex error by crossings, a line a level of noise."""
    accuracy, error = figure.subplots(1, 2)
    for colour, (noise, own) in zip(COLOURS, shown.groupby("noise"), strict=False):
        by = own.groupby("crossings")
        style = {"marker": "o", "markersize": 4, "color": colour, "label": f"noise {noise:g}"}
        accuracy.plot(100 * by["state_correct"].mean(), **style)
        error.plot(by["mean_error_mm"].median(), **style)
    accuracy.set(xlabel="crossings", ylabel="state accuracy, %", ylim=(0, 103))
    error.set(xlabel="crossings", ylabel="vertex error, mm (median rope)", ylim=(0, None))
    for axes in (accuracy, error):
        axes.set_xticks(sorted(shown["crossings"].unique()))
        bare_axis(axes, "y")
    accuracy.legend(frameon=False, loc="lower left")
