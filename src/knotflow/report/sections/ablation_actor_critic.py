"""Actor alone, critic alone, and both (Sec. VII-B1, Fig. 7)."""

from __future__ import annotations

from typing import Any

from knotflow.report import figures, tables
from knotflow.report.paper import ABLATION, with_extras
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section
from knotflow.report.sections.single_stage import trials

EXPERIMENT = "ablation_actor_critic"


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure and its table."""
    rates = results.rates(EXPERIMENT)
    if rates is None:
        return None
    arms = with_extras(ABLATION, rates.methods)
    run = [arm for arm in arms if arm.name in rates.methods]
    together, alone = ABLATION[2], [arm for arm in ABLATION[:2] if arm in run]
    pairs = [(together, arm) for arm in alone] if together in run else []
    return {
        "figure": pictures.add(figures.success_rates(rates, arms, EXPERIMENT)),
        "trials": trials(rates),
        "missing": tables.listed([arm.label for arm in arms if arm not in run]),
        "rates": tables.rate_table(rates, run),
        "ratios": tables.ratio_table(rates, pairs) if pairs else "",
    }


SECTION = Section(
    EXPERIMENT,
    "Ablation: actor and critic",
    "Sec. VII-B1, Fig. 7",
    "The same actions and rope shapes, with samples of the actor alone, of the cross-entropy "
    "method on the critic alone, and of the critic started from the actor.",
    values,
)
