"""One plan, as a newcomer makes it (Fig. 1)."""

from __future__ import annotations

from functools import partial
from typing import Any

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
    shown = partial(pictures.stored, results, EXPERIMENT)
    return {
        "search": search,
        "seconds": duration(search["seconds"]),
        "plan": shown("plan", "A plan, step by step"),
        "dag": shown("dag", "Solution DAG of the knot"),
    }


SECTION = Section(
    EXPERIMENT,
    "A plan for the overhand",
    "Fig. 1",
    "From a randomly lying rope to an overhand knot, with the primitives that come with the "
    "package.",
    values,
)
