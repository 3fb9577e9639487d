"""The verdict on the paper's claim about the pentagram."""

from __future__ import annotations

import statistics

from knotflow.report.planning.records import PENTAGRAM_STARTS, PULLED, pentagram_trees
from knotflow.report.results import Results
from knotflow.report.verdict import NotMeasured, Outcome, Verdict

#: Branches that the paper's one search took (Sec. VII-E).
PAPER_BRANCHES = 12


def pentagram(results: Results) -> Outcome:
    """Sec. VII-E: a plan found with 12 branches, from an overhand whose head was pulled out."""
    trees = pentagram_trees(results, PULLED)
    if not trees:
        raise NotMeasured(f"needs searches from {PULLED} in pentagram")
    told = []
    for start, name in PENTAGRAM_STARTS.items():
        if own := pentagram_trees(results, start):
            counts = [search.branches for search in own if search.solved]
            spread = (
                f", {min(counts):,} to {max(counts):,} branches, "
                f"median {statistics.median(counts):g}"
                if counts
                else ""
            )
            told.append(f"{name}: tied in {len(counts)} of {len(own)} searches{spread}")
    # One that gave up is larger than any bound.
    sizes = [search.branches if search.solved else float("inf") for search in trees]
    if statistics.median(sizes) <= PAPER_BRANCHES:
        verdict = Verdict.HOLDS
    else:
        verdict = Verdict.PARTLY if min(sizes) <= PAPER_BRANCHES else Verdict.FAILS
    return Outcome("; ".join(told), verdict)
