"""Actor alone, critic alone, and both (Sec. VII-B1, Fig. 7)."""

from __future__ import annotations

from typing import Any

from knotflow.report.claims import Claim, Judgement, of_two
from knotflow.report.paper import ABLATION, ACTIONS, with_extras
from knotflow.report.rates import (
    complete_rates,
    rate_table,
    ratio_table,
    read_rates,
    success_rates,
    trials,
)
from knotflow.report.results import Results
from knotflow.report.section import Pictures, Section
from knotflow.report.tables import listed

EXPERIMENT = "ablation_actor_critic"
METHODS = ("actor_only", "critic_only", "actor_critic")
#: Where the paper's gap to the critic alone is largest.
PAPER_WIDEST = ("C(2,0,1)", "C(2,4,1)")


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure and its tables."""
    rates = read_rates(results, EXPERIMENT)
    if rates is None:
        return None
    methods = with_extras(ABLATION, rates.methods)
    run = [method for method in methods if method.name in rates.methods]
    together, alone = ABLATION[2], [method for method in ABLATION[:2] if method in run]
    pairs = [(together, method) for method in alone] if together in run else []
    return {
        "figure": pictures.add(success_rates(rates, methods, EXPERIMENT)),
        "trials": trials(rates),
        "missing": listed([method.label for method in methods if method not in run]),
        "intervals": rates.intervals,
        "rates": rate_table(rates, run),
        "ratios": ratio_table(rates, pairs) if pairs else "",
    }


def together_best(results: Results) -> Judgement:
    """Together best on 7 of 8, the gap to the critic alone largest on two of them."""
    rates = complete_rates(results, EXPERIMENT, METHODS)
    best, clear, gaps = [], 0, {}
    for action in ACTIONS:
        actor, critic, both = (rates.interval(method, action).estimate for method in METHODS)
        gaps[action] = both - critic
        if both >= max(actor, critic):
            best.append(action)
        alone = [rates.ratio("actor_critic", method, action) for method in METHODS[:2]]
        clear += all(ratio.lies_above(1) for ratio in alone)
    widest = sorted(gaps, key=lambda action: -gaps[action])[: len(PAPER_WIDEST)]
    widest_gaps = listed([f"`{action}` ({100 * gaps[action]:+.0f} points)" for action in widest])
    return Judgement(
        f"best on {len(best)} of {len(ACTIONS)}, significantly better than both alone on {clear}; "
        f"the gap to the critic alone is largest on {widest_gaps}",
        of_two(len(best) >= 7, set(widest) == set(PAPER_WIDEST)),
    )


def where_the_critic_finds_nothing(results: Results) -> str:
    """From how many starts each finds a success, where the critic alone does from the fewest, and
    where the paper's gaps are."""
    rates = complete_rates(results, EXPERIMENT, METHODS)
    solved: dict[tuple[str, str], int] = {}
    for method in METHODS:
        for action in ACTIONS:
            found = rates.solved(method, action)
            if found is None:
                return ""
            solved[method, action] = found[0]
    least = min(ACTIONS, key=lambda action: solved["critic_only", action])
    parts = [
        f"{' / '.join(str(solved[method, action]) for method in METHODS)} on `{action}`"
        for action in dict.fromkeys([least, *PAPER_WIDEST])
    ]
    return (
        "the actor helps most where a search by the critic alone comes upon nothing. Starts with a "
        f"success, actor only / critic only / both: {listed(parts)}"
    )


SECTION = Section(
    EXPERIMENT,
    "Ablation: actor and critic",
    "Sec. VII-B1, Fig. 7",
    "The same actions and rope shapes, with samples of the actor alone, of the cross-entropy "
    "method on the critic alone, and of the critic started from the actor.",
    values,
    claims=(
        Claim(
            statement="Actor and critic together are best",
            where="Sec. VII-B1, Fig. 7",
            paper="on 7 of 8 actions; the gap is largest on C(2,0,1) and C(2,4,1)",
            criterion="best on at least 7, and the two largest gaps to the critic alone are on "
            "these; partly if one of the two",
            judge=together_best,
            reason=where_the_critic_finds_nothing,
        ),
    ),
)
