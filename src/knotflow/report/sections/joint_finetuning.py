"""Primitives trained independently and finetuned jointly (Sec. VII-B2)."""

from __future__ import annotations

from typing import Any

from knotflow.report import figures, tables
from knotflow.report.learning.figures import joint
from knotflow.report.learning.records import read_curves
from knotflow.report.paper import JOINT, OVERHAND_LIMIT, with_extras
from knotflow.report.records import read_rates
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section

EXPERIMENT = "joint_finetuning"


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure, a line for each kind of training, and what became of single actions."""
    searches = results.joint_finetuning
    if searches is None:
        return None
    arms = with_extras(JOINT, searches.arms)
    lines = [
        [arm.label, *tables.search_line(own)] for arm in arms if (own := searches.of(arm.name))
    ]
    curves = results.table(EXPERIMENT, "curves_joint.csv")
    single = results.table(EXPERIMENT, "single_actions.csv")
    return {
        "learning": pictures.add(joint(read_curves(curves), "joint")) if curves else "",
        "single": tables.rate_table(read_rates(single), JOINT) if single else "",
        "figure": pictures.add(figures.branches(searches, arms, [""], EXPERIMENT, {})),
        "table": tables.markdown_table(
            ["primitives", *tables.SEARCH_COLUMNS], lines, "l" + "r" * len(tables.SEARCH_COLUMNS)
        ),
        "missing": tables.listed([arm.label for arm in arms if arm.name not in searches.arms]),
        "limit": OVERHAND_LIMIT,
        "unsolved": sum(not search.solved for search in searches),
    }


SECTION = Section(
    EXPERIMENT,
    "Joint finetuning",
    "Sec. VII-B2",
    "Branches until an overhand is tied, from randomly lying ropes, before and after the "
    "primitives were finetuned together.",
    values,
)
