"""How many branches a tree search needs to tie an overhand (Sec. VII-A4)."""

from __future__ import annotations

from typing import Any

from knotflow.report import figures, tables
from knotflow.report.paper import OVERHAND_LIMIT, STARTS, TREE_SIZE, with_extras
from knotflow.report.planning.pictures import stored
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section

EXPERIMENT = "tree_size"
#: The largest trees that the paper reports, by start and method; "below 5" is drawn at 4.
PAPER_LARGEST: dict[tuple[str, str], float] = {
    ("straight", "icp"): 190,
    ("arc", "icp"): 1428,
    ("straight", "imitation"): 43,
    ("arc", "imitation"): 9,
    ("straight", "reinforcement"): 4,
    ("arc", "reinforcement"): 4,
}


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure and a line for every method and start."""
    searches = results.tree_size
    if searches is None:
        return None
    arms = with_extras(TREE_SIZE, searches.arms)
    starts = list(dict.fromkeys([*STARTS, *searches.starts]))
    lines = [
        [start, arm.label, *tables.search_line(own)]
        for start in starts
        for arm in arms
        if (own := searches.of(arm.name, start))
    ]
    picture = figures.branches(searches, arms, starts, EXPERIMENT, PAPER_LARGEST)
    return {
        "figure": pictures.add(picture),
        "table": tables.markdown_table(
            ["start", "method", *tables.SEARCH_COLUMNS],
            lines,
            "ll" + "r" * len(tables.SEARCH_COLUMNS),
        ),
        "missing": tables.listed([arm.label for arm in arms if arm.name not in searches.arms]),
        "limit": OVERHAND_LIMIT,
        "dag": stored(results, pictures.add, EXPERIMENT, "dag", "tree_size_dag", "Solution DAG"),
        "unsolved": sum(not search.solved for search in searches),
    }


SECTION = Section(
    EXPERIMENT,
    "Tree size",
    "Sec. VII-A4",
    "Branches of the search tree until an overhand is tied along the path R1(0,1,1), C(0,1,1), "
    "C(2,0,1), from a straight rope and from an arc.",
    values,
)
