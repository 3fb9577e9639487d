"""What Fig. 6 and the trees owe to the demonstrations: refined or plain, and how ICP reads them."""

from __future__ import annotations

from knotflow.report import markdown as md
from knotflow.report.branches import SIZE_TABLE, STARTS
from knotflow.report.rates import Rates, read_rates
from knotflow.report.results import Results
from knotflow.report.searches import effort, read_searches, select
from knotflow.report.section import Figures, Parts
from knotflow.report.single_stage import DEMONSTRATIONS, PAPER_CLEAREST, SINGLE

FEW = PAPER_CLEAREST
"""The actions with one demonstration each."""
ROWS = (
    ("refined", "ICP", SINGLE, "icp"),
    ("refined", "ICP as coded", DEMONSTRATIONS, "icp_authors_refined"),
    ("refined", "imitation", SINGLE, "imitation"),
    ("plain", "ICP", DEMONSTRATIONS, "icp"),
    ("plain", "ICP as coded", DEMONSTRATIONS, "icp_authors"),
    ("plain", "imitation", DEMONSTRATIONS, "imitation"),
)
"""Demonstrations, method, the experiment that ran it, and what its tables call it."""


def demonstration_quality(results: Results, _: Figures) -> Parts:
    """Methods on either kind of demonstrations: success rates, and the largest trees."""
    rates = {name: read_rates(results, name) for name in (DEMONSTRATIONS, SINGLE)}
    trees = {
        DEMONSTRATIONS: read_searches(results, DEMONSTRATIONS, *SIZE_TABLE[1:]),
        SINGLE: read_searches(results, *SIZE_TABLE),
    }
    lines = []
    for demonstrations, method, where, name in ROWS:
        found = rates[where]
        if name in found.methods:
            line = {"demonstrations": demonstrations, "method": method}
            line["mean of eight"] = md.percent(found.mean(name))
            line |= {f"`{action}`": md.percent(found.interval(name, action)) for action in FEW}
            for start in STARTS:
                own = select(trees[where], name, start)
                line[start] = md.NOTHING if own.empty else effort(own)[0]
            lines.append(line)
    return {"table": md.table(lines), "better": _better(rates[DEMONSTRATIONS])}


def _better(rates: Rates) -> str:
    """On how many actions imitation is above ICP with plain demonstrations."""
    parts = []
    for base, label in (("icp", "ICP"), ("icp_authors", "ICP as coded")):
        shared = rates.shared_actions("imitation", base)
        ratios = {action: rates.ratio("imitation", base, action) for action in shared}
        better = sum(ratio.estimate > 1 for ratio in ratios.values())
        few = md.listed([f"{md.times(ratios[action])} on `{action}`" for action in FEW])
        parts.append(f"{label} on {better} of {len(ratios)} actions ({few})")
    return f"With plain demonstrations imitation is above {md.listed(parts)}."
