"""Success rates of the eight topological actions by method (Sec. VII-A3, Fig. 6), and of actor and
critic alone and together (Sec. VII-B1, Fig. 7)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from knotflow.report import markdown as md
from knotflow.report.rates import (
    ARRANGED,
    ICP,
    IMITATION,
    PRIMITIVES,
    RANDOM,
    REINFORCEMENT,
    Method,
    Rates,
    complete_rates,
    read_rates,
    with_extras,
)
from knotflow.report.results import NotMeasured, Results
from knotflow.report.ropes import read_ropes, sheet
from knotflow.report.section import Claim, Figures, Judgement, Parts, Verdict, optional
from knotflow.report.training import POLICY_SUCCESS, imitation, reinforcement
from knotflow.statistics import Interval, clustered_rate

SINGLE, ABLATION, OPTIONS = "single_stage", "ablation_actor_critic", "learning_options"
DEMONSTRATIONS = "demonstration_quality"
PAIRS = (
    (ICP, RANDOM),
    (IMITATION, RANDOM),
    (IMITATION, ICP),
    (REINFORCEMENT, IMITATION),
    (ARRANGED, REINFORCEMENT),
)
"""The comparisons that the paper makes in its text, and the first and the last that we add."""
REACHABLE = {"action": str, "start": str, "splines": int, "found": bool}

PARTS = (
    Method("actor_only", "actor only", "#e69f00"),
    Method("critic_only", "critic only", "#009e73"),
    Method("actor_critic", "actor and critic", "#0072b2"),
)
PART_NAMES = tuple(method.name for method in PARTS)
PAPER_CLEAREST = ("R1(0,1,1)", "R2(0,0,1,1)")
"""Where the paper's imitation is most above ICP."""
PAPER_WIDEST = ("C(2,0,1)", "C(2,4,1)")
"""Where the paper's gap to the critic alone is largest."""
OURS = "ours"
CHANGED = {
    OURS: "nothing",
    "random_splines": "a random spline of reward 0 beside each trial",
    "node_actor": "the actor chooses a node, then a Gaussian given the node",
    "population_256": "256 samples in place of 24, 12 elites",
    "best_of_elites": "256 samples, 51 elites of full covariance, the best sample",
    "any_rotation": "ropes and splines turned and shifted at random, 3 rad and 0.5 m",
    "grasp_position": "the critic is given the grasped node's position",
    "authors": "all of these, and the authors' learning rate, batches and steps; no exploration "
    "beside the policy, no room demanded of primitive 3",
}
"""What each option of `learning_options` changes of our training."""
EITHER_END = 5
"""Rounds of reinforcement that are compared, the first and the last."""


def single_stage(results: Results, figures: Figures) -> Parts:
    """The figure, the tables behind it, how near to feasible, examples, learning, and cost."""
    rates = read_rates(results, SINGLE)
    methods = (RANDOM, ICP, IMITATION, REINFORCEMENT)
    return {
        "rates": compared(rates, figures, methods, PAIRS, SINGLE, "Fig. 6 reproduced"),
        "reachable": reachable(results, rates),
        "examples": _examples(results, figures),
        "imitation": imitation(results, figures, SINGLE),
        "reinforcement": reinforcement(results, figures, SINGLE),
    }


def ablation(results: Results, figures: Figures) -> Parts:
    """The figure and its tables."""
    rates, pairs = read_rates(results, ABLATION), [(PARTS[2], part) for part in PARTS[:2]]
    return {"rates": compared(rates, figures, PARTS, pairs, ABLATION, "Fig. 7 reproduced")}


def options(results: Results, _: Figures) -> Parts:
    """Success rates by option, primitive by primitive."""
    rates = read_rates(results, OPTIONS)
    rows = []
    for name in rates.methods:
        gains = name != OURS and OURS in rates.methods
        each = rates.trainings_mean(name)
        rows.append(
            {
                "changed": CHANGED.get(name, name),
                "mean of all actions": md.percent(rates.mean(name)),
                "difference, points": md.estimate(rates.gain(name, OURS)) if gains else md.NOTHING,
                "trainings": " / ".join(md.whole(100 * rate) for rate in each),
                **{
                    title: md.whole(100 * rates.trainings_mean(name, own).mean())
                    for title, own in PRIMITIVES.items()
                },
            }
        )
    return {"options": md.table(rows, "Success rates in per cent:")}


def compared(
    rates: Rates,
    figures: Figures,
    methods: Sequence[Method],
    pairs: Sequence[tuple[Method, Method]],
    name: str,
    of: str,
) -> str:
    """The rates in a figure and a table, the ratios of those `pairs` that were run."""
    methods = with_extras(methods, rates.methods)
    run = [method for method in methods if method.name in rates.methods]
    missing = md.listed([method.label for method in methods if method not in run])
    return md.join(
        f"Not run: {missing}." if missing else "",
        rates.figure(figures, methods, name, of),
        rates.table(run),
        rates.ratio_table([pair for pair in pairs if {*pair} <= {*run}]),
    )


@optional
def reachable(results: Results, rates: Rates) -> str:
    """On how many starts a search in the simulator finds nothing, beside the failures of RL."""
    table = results.table(SINGLE, "reachable.csv", REACHABLE, key=("action", "start"))
    rows = []
    for action in rates.shared_actions(REINFORCEMENT.name):
        own = table[table["action"] == action].set_index("start")
        on, nothing = own.index[own["found"]], ~own["found"]
        hits, trials = rates.counts[REINFORCEMENT.name, action]
        never = ~rates.solved(REINFORCEMENT.name, action)
        rows.append(
            {
                "action": f"`{action}`",
                "search finds nothing": f"{nothing.sum()} of {len(own)}",
                "splines until it succeeds, median": f"{own['splines'][on].median():.0f}"
                if len(on)
                else md.NOTHING,
                "RL never succeeds": f"{never.sum()} of {len(never)}",
                "neither does": str((nothing & never).sum()),
                "RL where the search succeeds": md.percent(clustered_rate(hits[on], trials[on]))
                if len(on)
                else md.NOTHING,
            }
        )
    return md.table(
        rows,
        "What one spline can do at all: from each start, a search with the simulator as its judge "
        f"tries up to {results.setting(SINGLE, 'most', 'reachable')} splines until one succeeds.",
    )


@optional
def _examples(results: Results, figures: Figures) -> str:
    """The first unseen ropes of each action with what is proposed for them."""
    ropes = read_ropes(results, SINGLE, "proposals.csv")
    hits = [[succeeded for _, succeeded in rope.splines] for rope in ropes]
    caption = (
        f"Splines proposed after reinforcement for {len(ropes)} unseen ropes, the first of the "
        f"evaluation: {sum(map(sum, hits))} of {sum(map(len, hits))} succeed. Above, each rope "
        "with its splines (green succeeds, red and dashed does not, the first one thicker); below "
        "it the rope after the first."
    )
    notes = [f"{sum(own)} of {len(own)} succeed" for own in hits]
    return sheet(figures, "proposals", caption, ropes, notes, columns=6)


def imitation_over_random(results: Results) -> Judgement:
    """Up to 100x."""
    ratios = _ratios(results, "imitation", "random")
    _, best = _extremes(ratios)
    better = sum(ratio.estimate > 1 for ratio in ratios.values())
    ours = (
        f"up to {md.times(ratios[best])} on `{best}`; better on {better} of {len(ratios)} actions"
    )
    large = any(ratio.lies_above(10) and ratio.reaches(100) for ratio in ratios.values())
    sure = sum(ratio.lies_above(1) for ratio in ratios.values())
    direction = better == len(ratios) and 2 * sure > len(ratios)
    size = "" if large or not direction else "no ratio is above 10× and compatible with 100×"
    if large and better == len(ratios):
        return Judgement(ours, Verdict.HOLDS, size)
    return Judgement(ours, Verdict.PARTLY if 2 * sure > len(ratios) else Verdict.FAILS, size)


def imitation_over_icp(results: Results) -> Judgement:
    """Higher on most actions, above all on R1(0,1,1) and R2(0,0,1,1)."""
    ratios = _ratios(results, "imitation", "icp")
    better = [action for action, ratio in ratios.items() if ratio.estimate > 1]
    sizes = md.listed([f"{md.times(ratios[action])} on `{action}`" for action in PAPER_CLEAREST])
    return Judgement(
        f"better on {len(better)} of {len(ratios)} actions; {sizes}",
        Verdict.of_two(
            2 * len(better) > len(ratios), all(action in better for action in PAPER_CLEAREST)
        ),
    )


def reinforcement_at_the_ceiling(results: Results) -> str:
    """The actions on which RL gains too little, and those on which imitation leaves no room."""
    found = actions_where(
        "reinforcement",
        "imitation",
        lambda ratio: not ratio.reaches(1.14),
        "significantly less than 1.14× on",
        results,
    )
    rates = complete_rates(results, SINGLE, ("reinforcement", "imitation"))
    full = [
        f"`{action}`"
        for action in rates.actions
        if 1.14 * rates.interval("imitation", action).estimate > 1
    ]
    if not found or not full:
        return found
    return f"{found}; on {md.listed(full)} imitation succeeds so often that no rate is 1.14× of it"


def actions_where(
    method: str, base: str, fits: Callable[[Interval], bool], so: str, results: Results
) -> str:
    """The actions on which the ratio of two methods fits, with both rates."""
    rates = complete_rates(results, SINGLE, (method, base))
    pairs = {
        action: [md.whole(100 * rates.interval(one, action).estimate) for one in (method, base)]
        for action, ratio in _ratios(results, method, base).items()
        if fits(ratio)
    }
    parts = [f"`{action}` ({' against '.join(pair)} %)" for action, pair in pairs.items()]
    return f"{so} {md.listed(parts)}" if parts else ""


def imitation_not_over_icp(results: Results) -> str:
    """The actions on which ICP is not below, and on how many it is with plain demonstrations."""
    found = actions_where(
        "imitation", "icp", lambda ratio: ratio.estimate <= 1, "not higher on", results
    )
    return found + _imitation_over_icp_from_plain(results)


@optional
def _imitation_over_icp_from_plain(results: Results) -> str:
    ratios = _ratios(results, "imitation", "icp", DEMONSTRATIONS)
    named = md.listed([f"{md.times(ratios[action])} on `{action}`" for action in PAPER_CLEAREST])
    higher = sum(ratio.estimate > 1 for ratio in ratios.values())
    return (
        f"; from [plain demonstrations](#demonstration-quality) it is {named}, and higher on "
        f"{higher} of {len(ratios)}"
    )


def reinforcement_over_imitation(results: Results) -> Judgement:
    """1.14x to 2.33x."""
    ratios = _ratios(results, "reinforcement", "imitation")
    low, high = _extremes(ratios)
    better = sum(ratio.estimate > 1 for ratio in ratios.values())
    sure = sum(ratio.lies_above(1) for ratio in ratios.values())
    ours = (
        f"{md.times(ratios[low])} on `{low}` to {md.times(ratios[high])} on `{high}`; "
        f"better on {better} of {len(ratios)} actions"
    )
    if all(ratio.reaches(1.14) for ratio in ratios.values()) and 2 * sure > len(ratios):
        beyond = sum(ratio.lies_above(2.33) for ratio in ratios.values())
        size = f"beyond 2.33× on {beyond} of {len(ratios)} actions" if beyond else ""
        return Judgement(ours, Verdict.HOLDS, size)
    return Judgement(ours, Verdict.PARTLY if 2 * better > len(ratios) else Verdict.FAILS)


def _ratios(
    results: Results, method: str, base: str, experiment: str = SINGLE
) -> dict[str, Interval]:
    """Ratio of the two methods' rates on each of the eight actions, nan where both are 0."""
    rates = complete_rates(results, experiment, (method, base))
    return {action: rates.ratio(method, base, action) for action in rates.actions}


def _extremes(ratios: dict[str, Interval]) -> tuple[str, str]:
    """The actions of the smallest and of the largest ratio.

    A ratio to a rate of 0 has only a lower limit: it is the largest where there is no other.
    """
    finite = [action for action, ratio in ratios.items() if math.isfinite(ratio.estimate)]
    candidates = finite or [action for action, ratio in ratios.items() if ratio.estimate > 1]
    if not candidates:
        raise NotMeasured("needs a success of either method in single_stage")
    ordered = sorted(candidates, key=lambda action: (ratios[action].estimate, ratios[action].low))
    return ordered[0], ordered[-1]


def together_best(results: Results) -> Judgement:
    """Together best on 7 of 8, the gap to the critic alone largest on two of them."""
    rates = complete_rates(results, ABLATION, PART_NAMES)
    best, clear, gaps = 0, 0, {}
    for action in rates.actions:
        actor, critic, both = (rates.interval(method, action).estimate for method in PART_NAMES)
        gaps[action] = both - critic
        best += both >= max(actor, critic)
        clear += all(
            rates.ratio(PART_NAMES[2], alone, action).lies_above(1) for alone in PART_NAMES[:2]
        )
    widest = sorted(gaps, key=lambda action: -gaps[action])[: len(PAPER_WIDEST)]
    widest_gaps = md.listed([f"`{action}` ({100 * gaps[action]:+.0f} points)" for action in widest])
    return Judgement(
        f"best on {best} of {len(rates.actions)}, significantly better than both alone on {clear}; "
        f"the gap to the critic alone is largest on {widest_gaps}",
        Verdict.of_two(best >= 7, set(widest) == set(PAPER_WIDEST)),
    )


@optional
def how_the_critic_catches_up(results: Results) -> str:
    """Gaps to the critic alone where the paper's are widest, early and late in reinforcement; ''
    where no learning curve has both."""
    columns = {"method": str, "training_seed": str, "step": int, "metric": str, "value": float}
    curves = results.table(ABLATION, "curves.csv", columns, key=[*columns][:-1])
    parts = []
    for action in PAPER_WIDEST:
        own = curves[curves["metric"] == f"{POLICY_SUCCESS}/{action}"]
        rates = own.pivot_table("value", "step", "method").reindex(columns=PART_NAMES)
        gap = (100 * (rates[PART_NAMES[2]] - rates[PART_NAMES[1]])).dropna()
        if gap.empty:
            raise NotMeasured(f"needs trials of {action} by both in {ABLATION}")
        early, late = gap.head(EITHER_END).mean(), gap.tail(EITHER_END).mean()
        parts.append(f"from {early:.0f} to {late:.0f} points on `{action}`")
    return (
        "the critic alone does well on these two. From the first "
        f"{EITHER_END} rounds of reinforcement to the last, the gap falls {md.listed(parts)}: it "
        "closes with training. With the authors' search, and without what our critic and "
        "training add to theirs, the critic alone ends as high ([design decisions]"
        "(../docs/design.md#training))"
    )


SINGLE_STAGE_CLAIMS = (
    Claim(
        "Imitation against random sampling, success rate",
        "up to 100×",
        "better on every action, and on one of them significantly above 10× and compatible "
        "with 100×; partly if significantly better on more than half",
        imitation_over_random,
    ),
    Claim(
        "Imitation against ICP interpolation",
        "higher on most actions, above all R1(0,1,1) and R2(0,0,1,1)",
        "higher on more than half, and on both of these; partly if one of the two conditions holds",
        imitation_over_icp,
        imitation_not_over_icp,
    ),
    Claim(
        "Imitation + RL against imitation only",
        "1.14× to 2.33×",
        "every action is compatible with 1.14× or more and more than half are significantly "
        "better; partly if better on more than half",
        reinforcement_over_imitation,
        reinforcement_at_the_ceiling,
    ),
)

ABLATION_CLAIMS = (
    Claim(
        "Actor and critic together are best",
        "on 7 of 8 actions; the gap is largest on C(2,0,1) and C(2,4,1)",
        "best on at least 7, and the two largest gaps to the critic alone are on these; partly "
        "if one of the two",
        together_best,
        how_the_critic_catches_up,
    ),
)
