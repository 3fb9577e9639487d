"""One plan, as a newcomer makes it (Fig. 1)."""

from __future__ import annotations

from typing import Any

from knotflow.report.planning.pictures import stored
from knotflow.report.results import Results
from knotflow.report.searches import read_searches
from knotflow.report.section import Pictures, Section
from knotflow.report.tables import duration

EXPERIMENT = "overhand"


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The plan's picture, the solution DAG, and what the search took."""
    searches = read_searches(results, EXPERIMENT)
    if searches is None:
        return None
    search = searches.iloc[0].to_dict()
    add = pictures.add
    return {
        "search": search,
        "seconds": duration(search["seconds"]),
        "plan": stored(results, add, EXPERIMENT, "plan", "overhand_plan", "A plan, step by step"),
        "dag": stored(results, add, EXPERIMENT, "dag", "overhand_dag", "Solution DAG of the knot"),
    }


SECTION = Section(
    EXPERIMENT,
    "A plan for the overhand",
    "Fig. 1",
    "From a randomly lying rope to an overhand knot, with the primitives that come with the "
    "package.",
    values,
)
