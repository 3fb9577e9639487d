"""Actor alone, critic alone, and both (Sec. VII-B1, Fig. 7)."""

from __future__ import annotations

from knotflow.report import markdown as md
from knotflow.report.rates import ACTIONS, Method, complete_rates, read_rates, with_extras
from knotflow.report.results import Results
from knotflow.report.section import Claim, Figures, Judgement, Section, Verdict

EXPERIMENT = "ablation_actor_critic"
METHODS = (
    Method("actor_only", "actor only", "#e69f00"),
    Method("critic_only", "critic only", "#009e73"),
    Method("actor_critic", "actor and critic", "#0072b2"),
)
NAMES = tuple(method.name for method in METHODS)
PAPER_WIDEST = ("C(2,0,1)", "C(2,4,1)")
"""Where the paper's gap to the critic alone is largest."""


def body(results: Results, figures: Figures) -> str | None:
    """The figure and its tables."""
    rates = read_rates(results, EXPERIMENT)
    if rates is None:
        return None
    methods = with_extras(METHODS, rates.methods)
    run = [method for method in methods if method.name in rates.methods]
    missing = md.listed([method.label for method in methods if method not in run])
    both = METHODS[2]
    pairs = [(both, method) for method in METHODS[:2] if {method, both} <= set(run)]
    return md.join(
        f"Not run: {missing}." if missing else "",
        rates.figure(figures, methods, EXPERIMENT, "Fig. 7 reproduced"),
        rates.table(run),
        rates.ratio_table(pairs),
    )


def together_best(results: Results) -> Judgement:
    """Together best on 7 of 8, the gap to the critic alone largest on two of them."""
    rates = complete_rates(results, EXPERIMENT, NAMES)
    best, clear, gaps = 0, 0, {}
    for action in ACTIONS:
        actor, critic, both = (rates.interval(method, action).estimate for method in NAMES)
        gaps[action] = both - critic
        best += both >= max(actor, critic)
        clear += all(rates.ratio(NAMES[2], alone, action).lies_above(1) for alone in NAMES[:2])
    widest = sorted(gaps, key=lambda action: -gaps[action])[: len(PAPER_WIDEST)]
    widest_gaps = md.listed([f"`{action}` ({100 * gaps[action]:+.0f} points)" for action in widest])
    return Judgement(
        f"best on {best} of {len(ACTIONS)}, significantly better than both alone on {clear}; "
        f"the gap to the critic alone is largest on {widest_gaps}",
        Verdict.of_two(best >= 7, set(widest) == set(PAPER_WIDEST)),
    )


def where_the_critic_fails(results: Results) -> str:
    """From how many starts each finds a success, where the critic alone does from the fewest, and
    where the paper's gaps are; '' where starts are not known."""
    rates = complete_rates(results, EXPERIMENT, NAMES)
    solved = {
        action: [one[0] for name in NAMES if (one := rates.solved(name, action))]
        for action in ACTIONS
    }
    if any(len(own) < len(NAMES) for own in solved.values()):
        return ""
    least = min(ACTIONS, key=lambda action: solved[action][1])
    parts = [
        f"{' / '.join(map(str, solved[action]))} on `{action}`"
        for action in dict.fromkeys([least, *PAPER_WIDEST])
    ]
    return (
        "the actor helps most where a search by the critic alone finds no success. Starts with a "
        f"success, actor only / critic only / both: {md.listed(parts)}"
    )


SECTION = Section(
    EXPERIMENT,
    "Actor-critic ablation",
    "Sec. VII-B1, Fig. 7",
    "The same actions and rope shapes, with samples of the actor alone, of the cross-entropy "
    "method on the critic alone, and of the critic started from the actor.",
    body,
    claims=(
        Claim(
            "Actor and critic together are best",
            "on 7 of 8 actions; the gap is largest on C(2,0,1) and C(2,4,1)",
            "best on at least 7, and the two largest gaps to the critic alone are on these; partly "
            "if one of the two",
            together_best,
            where_the_critic_fails,
        ),
    ),
)
