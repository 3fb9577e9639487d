"""Plans executed open loop in other worlds, and knots in ropes of other sizes."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from knotflow.report import markdown as md
from knotflow.report.results import Results, refuse
from knotflow.report.section import COLOURS, Figures, Parts, bare_axis
from knotflow.statistics import Interval, clustered_rate

METHODS = {
    "shipped": "chosen in 16 worlds",
    "first_plan": "first plan",
    "exact_training": "trained in one world, chosen in 16",
    "neither": "trained in one world, first plan",
}
DISTURBANCES = {
    "pace": "pace",
    "level_1": "level 1, pace",
    "level_2": "level 2, pace",
    "twin_0": "twin 0",
    "twin_1": "twin 1",
    "twin_2": "twin 2",
}
COLUMNS = {"method": str, "disturbance": str, "rope_seed": int, "worlds": int, "tied": int}
COLUMNS |= {"simulated": int, "seconds": float}
LAB_ROPES = {"rope": str, "length": float, "diameter": float, "bending_length": float, "knot": str}
LAB_ROPES |= {"disturbance": str, "rope_seed": int, "solved": bool, "simulated": int}


def robustness(results: Results, figures: Figures) -> Parts:
    """Shares of worlds in which a plan ties, by way to plan and disturbance, and the effort."""
    key = ("method", "disturbance", "rope_seed")
    table = results.table("robustness", "robustness.csv", COLUMNS, key)
    refuse(table, table["tied"] > table["worlds"], "more worlds tied than there are")
    rates = {
        pair: clustered_rate(own["tied"], own["worlds"])
        for pair, own in table.groupby(["method", "disturbance"])
    }
    methods = [name for name in METHODS if name in set(table["method"])]
    rows = []
    for method in methods:
        own = table[table["method"] == method].drop_duplicates("rope_seed")
        rows.append(
            {"plan": METHODS[method]}
            | {label: md.percent(rates[method, one]) for one, label in DISTURBANCES.items()}
            | {"splines, median": f"{own['simulated'].median():.0f}"}
        )
    return {
        "figure": figures.draw(
            "robustness",
            f"Share of worlds in which an overhand plan ties open loop, {rows and len(own)} ropes.",
            2.6,
            lambda figure: _plot(figure, rates, methods),
        ),
        "rates": md.table(rows),
    }


def _plot(figure: Figure, rates: dict[tuple[str, str], Interval], methods: list[str]) -> None:
    axes = figure.add_subplot()
    width = 0.8 / len(methods)
    for number, (colour, method) in enumerate(zip(COLOURS, methods, strict=False)):
        for place, disturbance in enumerate(DISTURBANCES):
            rate = rates[method, disturbance]
            x = place + (number - (len(methods) - 1) / 2) * width
            label = METHODS[method] if place == 0 else None
            axes.bar(x, rate.estimate, width * 0.9, color=colour, label=label)
            axes.vlines(x, rate.low, rate.high, color="black", linewidth=0.8)
    axes.set_xticks(range(len(DISTURBANCES)), [*DISTURBANCES.values()])
    axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
    axes.set(ylabel="tied", ylim=(0, 1))
    bare_axis(axes, "y")
    axes.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def lab_ropes(results: Results, _: Figures) -> Parts:
    """How often each knot is tied in each rope, in the exact world and in one like it."""
    key = ("rope", "knot", "disturbance", "rope_seed")
    table = results.table("ropes", "ropes.csv", LAB_ROPES, key)
    rows = []
    for (name, length, diameter, bending, knot), own in table.groupby(
        ["rope", "length", "diameter", "bending_length", "knot"], sort=False
    ):
        exact, worlds = (own[own["disturbance"] == one] for one in ("exact", "level_1"))
        solved = exact[exact["solved"]]["simulated"]
        rows.append(
            {
                "rope": name,
                "size": f"{length:g} m by {1e3 * diameter:g} mm, {1e2 * bending:.2g} cm",
                "knot": knot.replace("_", " "),
                "planned": md.share(exact["solved"]),
                "splines, median": f"{solved.median():.0f}" if len(solved) else "-",
                "tied in a world of level 1": md.share(worlds["solved"]),
            }
        )
    return {"ropes": md.table(rows)}
