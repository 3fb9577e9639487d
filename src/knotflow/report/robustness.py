"""Plans executed open loop in other worlds, and knots in ropes of other sizes."""

from __future__ import annotations

import pandas as pd

from knotflow.report import markdown as md
from knotflow.report.results import Results, refuse
from knotflow.report.section import COLOURS, Figures, Parts, tied_bars
from knotflow.statistics import bootstrap, clustered_rate

METHODS = {
    "shipped": "chosen in 16 worlds and 32 others",
    "first_plan": "first plan",
    "exact_training": "trained in one world, chosen",
    "neither": "trained in one world, first",
}
PAIRS = (
    ("shipped", "first_plan", "plan chosen in 16 worlds and 32 others, minus the first one"),
    ("exact_training", "neither", "the same, of primitives trained in one world"),
    ("first_plan", "neither", "primitives trained in many worlds, minus in one: first plans"),
)
"""Methods that are compared, and what that tells."""
DISTURBANCES = {
    "twin_0": "none",
    "pace": "pace",
    "level_1": "level 1, pace",
    "level_2": "level 2, pace",
    "twin_1": "level 1, gripper",
    "twin_2": "level 2, gripper",
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
    series = {
        METHODS[method]: (colour, dict(enumerate(rates[method, one] for one in DISTURBANCES)))
        for colour, method in zip(COLOURS, methods, strict=False)
    }
    return {
        "figure": figures.draw(
            "robustness",
            f"Share of worlds in which an overhand plan ties open loop, {rows and len(own)} ropes. "
            "Whiskers are 95 % intervals with ropes resampled.",
            2.6,
            lambda figure: tied_bars(figure, [*DISTURBANCES.values()], series),
        ),
        "rates": md.table(rows),
        "gains": md.table(_gains(table), "Differences on the same ropes, in points:"),
    }


def _gains(table: pd.DataFrame) -> list[dict[str, str]]:
    """What choosing a plan in many worlds brings, and training in many."""
    by = table.assign(share=100 * table["tied"] / table["worlds"]).pivot_table(
        "share", ["disturbance", "rope_seed"], "method"
    )
    return [
        {"compared": what}
        | {
            DISTURBANCES[one]: md.estimate(bootstrap(both.loc[one]))
            for one in ("pace", "level_1", "level_2")
            if one in both.index
        }
        for first, base, what in PAIRS
        if {first, base} <= {*by.columns} and not (both := (by[first] - by[base]).dropna()).empty
    ]


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
                "splines, median": f"{solved.median():,.0f}" if len(solved) else md.NOTHING,
                "tied in a world of level 1": md.share(worlds["solved"]),
            }
        )
    return {"ropes": md.table(rows)}
