"""A knot more complex than any in training (Sec. VII-E, Fig. 9)."""

from __future__ import annotations

import statistics
from typing import Any

from knotflow.report.claims import Claim, Judgement, NotMeasured, Verdict
from knotflow.report.results import Results
from knotflow.report.searches import confirmation, read_searches, search_table, sizes
from knotflow.report.section import Pictures, Section

EXPERIMENT = "pentagram"
#: The starts: what the table calls them, and what they are.
PULLED = "pulled_overhand"
ARRANGING = "pulled_overhand_arranging"
STARTS = {
    PULLED: "overhand, its head pulled out",
    ARRANGING: "the same, by the search that arranges",
    "R1(0,1,1) C(0,1,1) C(2,0,1)": "overhand as the planner leaves it",
    "straight": "straight rope, no hand in it",
}
#: Branches that the paper's one search took.
PAPER_BRANCHES = 12


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """A line for each start, and the plan of fewest branches from each."""
    searches = read_searches(results, EXPERIMENT)
    if searches is None:
        return None
    groups = [((name,), searches[searches["start"] == start]) for start, name in STARTS.items()]
    return {
        "table": search_table(("start",), [line for line in groups if len(line[1])]),
        "confirmation": confirmation(results, EXPERIMENT, searches),
        "paper": PAPER_BRANCHES,
        "head": results.setting(EXPERIMENT, "pull", "head"),
        **{
            one: pictures.stored(results, EXPERIMENT, f"{one}/plan", f"Plan, {one}")
            for one in ("pulled", "tied", "untangled")
        },
    }


def pulled_out(results: Results) -> Judgement:
    """A plan found with 12 branches, from an overhand whose head was pulled out."""
    searches = read_searches(results, EXPERIMENT)
    if searches is None or PULLED not in set(searches["start"]):
        raise NotMeasured(f"needs searches from {PULLED} in {EXPERIMENT}")
    parts = []
    for start, name in STARTS.items():
        own = searches[searches["start"] == start]
        counts = own["branches"][own["solved"]]
        spread = (
            f", {min(counts):,} to {max(counts):,} branches, median {statistics.median(counts):g}"
            if len(counts)
            else ""
        )
        if len(own):
            parts.append(f"{name}: tied in {len(counts)} of {len(own)} searches{spread}")
    trees = sizes(searches[searches["start"] == PULLED])
    if statistics.median(trees) <= PAPER_BRANCHES:
        verdict = Verdict.HOLDS
    else:
        verdict = Verdict.PARTLY if min(trees) <= PAPER_BRANCHES else Verdict.FAILS
    return Judgement("; ".join(parts), verdict)


def room(results: Results) -> str:
    """The same rope and path by the search that arranges; empty unless that ties it more often."""
    searches = read_searches(results, EXPERIMENT)
    if searches is None:
        return ""
    pulled, arranged = (
        searches.loc[searches["start"] == start, "solved"] for start in (PULLED, ARRANGING)
    )
    if arranged.empty or arranged.mean() <= pulled.mean():
        return ""
    return (
        "the paper's search has the path's own splines alone. One that may also make room and take "
        f"crossings back ties it in {arranged.sum()} of {len(arranged)} searches, from the same "
        "rope along the same path"
    )


SECTION = Section(
    EXPERIMENT,
    "The pentagram",
    "Sec. VII-E, Fig. 9",
    "A knot more complex than any in training, from an overhand whose head was pulled out, from "
    "one as the planner leaves it, and from a straight rope.",
    values,
    claims=(
        Claim(
            statement="Pentagram from an overhand whose head was pulled out by hand",
            where="Sec. VII-E, Fig. 9",
            paper="12 branches",
            criterion="from there the median search ties it with at most 12 branches; partly if "
            "the best one does",
            judge=pulled_out,
            reason=room,
        ),
    ),
)
