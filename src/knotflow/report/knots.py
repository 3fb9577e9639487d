"""Named knots: one plan (Fig. 1), the pentagram (Sec. VII-E, Fig. 9), and success rates."""

from __future__ import annotations

import statistics
from collections.abc import Mapping

import pandas as pd

from knotflow.report import markdown as md
from knotflow.report.results import Results
from knotflow.report.searches import (
    OUTCOME,
    STATE_NOTATION,
    checks,
    read_searches,
    search_table,
    sizes,
    tied_columns,
    tied_over_time,
)
from knotflow.report.section import Claim, Figures, Judgement, NotMeasured, Parts, Verdict
from knotflow.statistics import mean_difference

PULLED, ARRANGING = "pulled", "pulled_arranging"
STARTS = {
    PULLED: "overhand with its head pulled out",
    ARRANGING: "the same, by the search that arranges",
    "tied": "overhand as the planner leaves it",
    "untangled": "straight rope",
}
"""What the table of the pentagram calls its starts."""
BEFORE = {
    "pulled_overhand": PULLED,
    "pulled_overhand_arranging": ARRANGING,
    "R1(0,1,1) C(0,1,1) C(2,0,1)": "tied",
    "straight": "untangled",
}
"""What version 0.2.0 called them."""
PENTAGRAM_PLANS = {
    "pulled": "Fig. 9 reproduced: the plan of fewest branches from the overhand whose head was "
    "pulled out, by the search that arranges.",
    "tied": "The plan of fewest branches from an overhand as the planner left it.",
    "untangled": "The plan of fewest branches from the straight rope.",
}
PAPER_BRANCHES = 12
"""That the paper's one search for the pentagram took."""
GOAL = ("set", "goal")
GOAL_SEARCHES = dict.fromkeys(GOAL, str) | {"rope_seed": int} | OUTCOME
COMPLETE = "complete"
VARIANTS = {
    COMPLETE: "complete",
    "without_arranging": "without arranging",
    "without_onward": "without next-state value",
    "without_next_value": "without next-state value",
    "paper_search": "the paper's search",
}
"""Methods of the ablation, by their tables; all others lack a part that the first has."""


def overhand(results: Results, figures: Figures) -> Parts | None:
    """The plan's picture, its solution DAG, and what the search took."""
    searches = read_searches(results, "overhand")
    if searches.empty:
        return None
    search = next(searches.itertuples())
    start = f"from the start `{search.start}` (seed {search.seed})"
    return {
        "search": f"The search tied the knot {start} by `{search.path}`, after {search.branches} "
        f"branches and {md.duration(search.seconds)}."
        if search.solved
        else f"The search did not tie the knot {start}: {search.reason}.",
        "plan": figures.own(
            "overhand",
            "plan.png",
            "The plan. Each rope is shown with the spline that is executed next: a dot where it is "
            "grasped, a square at the middle control point with its height, an arrow where it is "
            "released. The head is blue, the tail orange.",
        ),
        "dag": figures.own(
            "overhand",
            "dag.png",
            "The solution DAG: every sequence of actions that leads to this knot, the plan's in "
            "green.",
        ),
    }


def _pentagram_searches(results: Results) -> pd.DataFrame:
    """A row a search, by today's names of the starts."""
    return read_searches(results, "pentagram").replace({"start": BEFORE})


def pentagram(results: Results, figures: Figures) -> Parts | None:
    """A line for each start, and the plan of fewest branches from each."""
    searches = _pentagram_searches(results)
    if searches.empty:
        return None
    head = results.setting("pentagram", "head", "pull")
    groups = (
        ({"start": name}, searches[searches["start"] == start]) for start, name in STARTS.items()
    )
    shown = (
        figures.own("pentagram", f"{folder}/plan.png", caption)
        for folder, caption in PENTAGRAM_PLANS.items()
    )
    return {
        "head": f" until {100 * head:g} cm of rope lie before the first crossing" if head else "",
        "searches": search_table(groups),
        "checks": checks(results, "pentagram"),
        "plans": md.join(*shown),
    }


def judge_pentagram(results: Results) -> Judgement:
    """A plan found with 12 branches, from an overhand whose head was pulled out."""
    searches = _pentagram_searches(results)
    if PULLED not in set(searches["start"]):
        raise NotMeasured(f"needs searches from {PULLED} in pentagram")
    parts = []
    for start, name in STARTS.items():
        own = searches[searches["start"] == start]
        counts = own["branches"][own["solved"]]
        if own.empty:
            continue
        parts.append(f"{name}: tied in {len(counts)} of {len(own)} searches")
        if len(counts):
            middle = f"{statistics.median(counts):g}"
            parts[-1] += f", {min(counts):,} to {max(counts):,} branches, median {middle}"
    trees = sizes(searches[searches["start"] == PULLED])
    verdict = Verdict.PARTLY if min(trees) <= PAPER_BRANCHES else Verdict.FAILS
    if statistics.median(trees) <= PAPER_BRANCHES:
        verdict = Verdict.HOLDS
    return Judgement("; ".join(parts), verdict)


def arranging_helps(results: Results) -> str:
    """The same rope and path by the search that arranges; '' unless that ties it more often."""
    searches = _pentagram_searches(results)
    pulled, arranged = (
        searches.loc[searches["start"] == start, "solved"] for start in (PULLED, ARRANGING)
    )
    if arranged.empty or arranged.mean() <= pulled.mean():
        return ""
    return (
        "the paper's search has the splines of the path alone. A search that may also make room "
        f"and take crossings back ties it in {arranged.sum()} of {len(arranged)} searches, from "
        "the same rope along the same path"
    )


def knots(results: Results, _: Figures) -> Parts | None:
    """Which knots are tied, and with what effort."""
    searches = read_searches(results, "knots")
    if searches.empty:
        return None
    rows = [
        {"knot": f"`{goal}`", "start": str(start)} | tied_columns(own)
        for (goal, start), own in searches.groupby(["goal", "start"], sort=False)
    ]
    return {
        "knots": md.table(rows),
        "notation": STATE_NOTATION,
        "checks": checks(results, "knots"),
    }


def goals(results: Results, figures: Figures) -> Parts | None:
    """A line for each number of crossings, the share over time, and every goal not tied."""
    table = results.table("goals", "goals.csv", GOAL_SEARCHES, GOAL)
    if table is None:
        return None
    sets = {str(name): own for name, own in table.groupby("set", sort=False)}
    missed = [
        {
            "crossings": one.set,
            "goal": f"`{one.goal}`",
            "rope": str(one.rope_seed),
            "branches": f"{one.branches:,}",
            "why the search ended": one.reason,
        }
        for one in table[~table["solved"]].itertuples()
    ]
    groups = {f"{name} crossings": own for name, own in sets.items()}
    return {
        "figure": tied_over_time(figures, "goals", groups, "number of crossings"),
        "sets": md.table([{"crossings": name} | tied_columns(own) for name, own in sets.items()]),
        "checks": checks(results, "goals"),
        "missed": md.table(
            missed, f"Goals that were not tied, {len(missed)} in all. {STATE_NOTATION}"
        ),
    }


def ablation(results: Results, figures: Figures) -> Parts | None:
    """A line a method, with the difference from the complete planner, paired by goal."""
    experiment = "goals_ablation"
    found = {
        name: results.table(experiment, f"{name}.csv", GOAL_SEARCHES, GOAL) for name in VARIANTS
    }
    tables = {name: table for name, table in found.items() if table is not None}
    if not tables:
        return None
    sets = list(dict.fromkeys(name for table in tables.values() for name in table["set"]))
    rows = [
        {"planner": VARIANTS[name]}
        | {f"tied, {one} crossings": md.share(table["solved"][table["set"] == one]) for one in sets}
        | {"difference, points": _difference(tables, name)}
        for name, table in tables.items()
    ]
    groups = {VARIANTS[name]: table for name, table in tables.items()}
    return {
        "figure": tied_over_time(figures, experiment, groups, "planner"),
        "variants": md.table(rows),
    }


def _difference(tables: Mapping[str, pd.DataFrame], name: str) -> str:
    """Of the share of goals tied from that of the complete planner, in points."""
    if name == COMPLETE or COMPLETE not in tables:
        return md.NOTHING
    tied, base = (
        100.0 * tables[one].set_index([*GOAL])["solved"].sort_index() for one in (name, COMPLETE)
    )
    return md.estimate(mean_difference(tied, base, paired=True))


PENTAGRAM_CLAIM = Claim(
    "Pentagram from an overhand whose head was pulled out by hand",
    "12 branches",
    "from there the median search ties it with at most 12 branches; partly if the best one does",
    judge_pentagram,
    arranging_helps,
)
