"""Success rates of the eight topological actions by method (Sec. VII-A3, Fig. 6)."""

from __future__ import annotations

from typing import Any

from knotflow.report import figures, tables
from knotflow.report.cost import cost
from knotflow.report.feasible import feasible
from knotflow.report.learning import figures as learning
from knotflow.report.learning.records import read_curves
from knotflow.report.paper import ICP, IMITATION, RANDOM, REINFORCEMENT, SINGLE_STAGE, with_extras
from knotflow.report.proposals.figure import proposals
from knotflow.report.proposals.records import read_proposals
from knotflow.report.records import Rates
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section
from knotflow.report.statistics import rate_ratio

EXPERIMENT = "single_stage"
# The comparisons the paper makes in its text, and the first that can be made here.
PAIRS = ((ICP, RANDOM), (IMITATION, RANDOM), (IMITATION, ICP), (REINFORCEMENT, IMITATION))


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure, the tables behind it, and what can be said of ICP against random."""
    rates = results.rates(EXPERIMENT)
    if rates is None:
        return None
    arms = with_extras(SINGLE_STAGE, rates.methods)
    run = [arm for arm in arms if arm.name in rates.methods]
    pairs = [pair for pair in PAIRS if all(arm in run for arm in pair)]
    starts = results.start_rates(EXPERIMENT)
    return {
        "figure": pictures.add(figures.success_rates(rates, arms, "single_stage")),
        "trials": trials(rates),
        "missing": tables.listed([arm.label for arm in arms if arm not in run]),
        "rates": tables.rate_table(rates, run),
        "ratios": tables.ratio_table(rates, pairs) if pairs else "",
        "icp": _above(rates, ICP.name, RANDOM.name),
        "starts": tables.start_table(starts, run) if starts else "",
        "feasible": feasible(results, EXPERIMENT),
        **_looks(results, pictures),
        "cost": cost(results, pictures.add),
    }


def _looks(results: Results, pictures: Pictures) -> dict[str, str]:
    """Proposals to look at and learning curves, each "" where its table is not there."""
    drawn = {
        "proposals": ("proposals.csv", lambda rows: proposals(read_proposals(rows), "proposals")),
        "imitation": (
            "curves_imitation.csv",
            lambda rows: learning.imitation(read_curves(rows), "imitation"),
        ),
        "reinforcement": (
            "curves_reinforcement.csv",
            lambda rows: learning.reinforcement(read_curves(rows), "reinforcement"),
        ),
    }
    found = {name: results.table(EXPERIMENT, file) for name, (file, _) in drawn.items()}
    return {
        name: pictures.add(draw(rows)) if (rows := found[name]) else ""
        for name, (_, draw) in drawn.items()
    }


def trials(rates: Rates) -> str:
    """Rollouts a bar: `400`, or `320 to 480` where bars differ."""
    counts = sorted({rate.trials for rate in rates})
    return f"{counts[0]:,}" if len(counts) == 1 else f"{counts[0]:,} to {counts[-1]:,}"


def _above(rates: Rates, method: str, base: str) -> dict[str, Any] | None:
    """On how many actions `method` is surely above `base`, surely below, and neither."""
    shared = rates.shared_actions(method, base)
    if not shared:
        return None
    above, below = [], []
    for action in shared:
        top, bottom = rates.get(method, action), rates.get(base, action)
        assert top is not None and bottom is not None
        ratio = rate_ratio(top.successes, top.trials, bottom.successes, bottom.trials)
        if ratio.low is not None and ratio.low > 1:
            above.append(action)
        elif ratio.high is not None and ratio.high < 1:
            below.append(action)
    return {"above": len(above), "below": len(below), "of": len(shared)}


SECTION = Section(
    EXPERIMENT,
    "Single-stage success rates",
    "Sec. VII-A3, Fig. 6",
    "How often one sampled spline does the topological action it was sampled for, "
    "from rope shapes that no method has seen.",
    values,
)
