"""One plan, as a newcomer makes it (Fig. 1)."""

from __future__ import annotations

from typing import Any

from knotflow.report.planning.pictures import stored
from knotflow.report.planning.records import OVERHAND, searches
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section
from knotflow.report.tables import duration


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The plan's picture, the solution DAG, and what the search took."""
    found = searches(results, OVERHAND)
    if found is None:
        return None
    (search,), (told,) = found
    plan = stored(results, pictures.add, OVERHAND, "plan", "overhand_plan", "A plan, step by step")
    dag = stored(results, pictures.add, OVERHAND, "dag", "overhand_dag", "Solution DAG of the knot")
    return {
        "search": search,
        "told": told,
        "seconds": duration(search.seconds),
        "plan": plan,
        "dag": dag,
    }


SECTION = Section(
    OVERHAND,
    "A plan for the overhand",
    "Fig. 1",
    "From a randomly lying rope to an overhand knot, with the primitives that come with the "
    "package.",
    values,
)
