"""Success rates of the eight topological actions by method (Sec. VII-A3, Fig. 6)."""

from __future__ import annotations

import math
from typing import Any

from knotflow.intervals import Interval, wilson
from knotflow.report.claims import Claim, Judgement, NotMeasured, Verdict, of_two
from knotflow.report.learning import imitation, read_curves, reinforcement
from knotflow.report.paper import (
    ACTIONS,
    ARRANGED,
    ICP,
    IMITATION,
    RANDOM,
    REINFORCEMENT,
    SINGLE_STAGE,
    Method,
    with_extras,
)
from knotflow.report.proposals.figure import proposals
from knotflow.report.proposals.records import read_proposals
from knotflow.report.rates import (
    Rates,
    complete_rates,
    rate_table,
    ratio_table,
    read_rates,
    success_rates,
    trials,
)
from knotflow.report.results import COUNT, TEXT, Results
from knotflow.report.section import Pictures, Section
from knotflow.report.tables import listed, markdown_table, percent, times
from knotflow.report.timing import cost

EXPERIMENT = "single_stage"
# The comparisons the paper makes in its text, and the first and the last that can be made here.
PAIRS = (
    (ICP, RANDOM),
    (IMITATION, RANDOM),
    (IMITATION, ICP),
    (REINFORCEMENT, IMITATION),
    (ARRANGED, REINFORCEMENT),
)
#: Success rate of the primitives after reinforcement that is aimed at on every action.
AIM = 0.90


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure, the tables behind it, and what can be said of ICP against random."""
    rates = read_rates(results, EXPERIMENT)
    if rates is None:
        return None
    methods = with_extras(SINGLE_STAGE, rates.methods)
    run = [method for method in methods if method.name in rates.methods]
    pairs = [pair for pair in PAIRS if all(method in run for method in pair)]
    ropes = read_proposals(results, EXPERIMENT)
    imitated = read_curves(results, EXPERIMENT, "curves_imitation.csv")
    reinforced = read_curves(results, EXPERIMENT, "curves_reinforcement.csv")
    return {
        "figure": pictures.add(success_rates(rates, methods, EXPERIMENT)),
        "trials": trials(rates),
        "missing": listed([method.label for method in methods if method not in run]),
        "rates": rate_table(rates, run),
        "ratios": ratio_table(rates, pairs) if pairs else "",
        "icp": _above(rates, ICP.name, RANDOM.name),
        "intervals": rates.intervals,
        "feasible": feasible(results, rates),
        "arranged": reached(rates, ARRANGED),
        "arranging": results.setting(EXPERIMENT, ARRANGED.name, "arranging"),
        "proposals": pictures.add(proposals(ropes, "proposals")) if ropes else "",
        "imitation": pictures.add(imitation(imitated, "imitation")) if imitated else "",
        "reinforcement": pictures.add(reinforcement(reinforced, "reinforcement"))
        if reinforced
        else "",
        "cost": cost(results, pictures),
    }


def _above(rates: Rates, method: str, base: str) -> dict[str, int]:
    """On how many actions `method` is significantly above `base`, and significantly below."""
    ratios = [rates.ratio(method, base, a) for a in rates.shared_actions(method, base)]
    below = sum(ratio.high is not None and ratio.high < 1 for ratio in ratios)
    return {"above": sum(r.lies_above(1) for r in ratios), "below": below, "of": len(ratios)}


def feasible(results: Results, rates: Rates) -> dict[str, Any] | None:
    """How near the primitives come to what one spline can do; None without reinforcement.

    The scripted demonstrator searches for a spline in the simulator itself, start by start, and
    says how many starts it had to leave out because none was found whose noisy copies succeed
    often enough. Some loops are too tight for one spline, so no method comes near 100 % on such
    starts. Its starts are made like the evaluation's, from another seed.
    """
    aim = reached(rates, REINFORCEMENT)
    if aim is None:
        return None
    lines = []
    for action, (found, searched) in searches(results).items():
        # A straight rope is searched once: it says nothing of random curves.
        if rates.counts(REINFORCEMENT.name, action) and searched > 1:
            share = f"{percent(wilson(found, searched))}<br>{found} of {searched}"
            rate = rates.interval(REINFORCEMENT.name, action)
            lines.append([f"`{action}`", percent(rate), share])
    header = ["action", "imitation + RL, rollouts", "search in the simulator, starts"]
    return aim | {"table": markdown_table(header, lines, "lrr") if lines else ""}


def reached(rates: Rates, method: Method) -> dict[str, Any] | None:
    """On which of the actions a method reaches the aim; None where it was not measured."""
    own = [action for action in ACTIONS if rates.counts(method.name, action)]
    good = [action for action in own if rates.interval(method.name, action).estimate >= AIM]
    return (
        {
            "aim": f"{AIM:.0%}".replace("%", " %"),
            "reached": listed([f"`{action}`" for action in good]),
            "missed": len(own) - len(good),
            "of": len(own),
        }
        if own
        else None
    )


def searches(results: Results) -> dict[str, tuple[int, int]]:
    """By action, in the order of Fig. 6: starts the demonstrator found a spline for, and all."""
    columns = {"action": TEXT, "starts_left_out": COUNT}
    table = results.table("demonstrator", "shares.csv", columns)
    if table is None:
        return {}
    found = {}
    for action in ACTIONS:
        own = table[table["action"] == action]
        found[action] = (len(own), len(own) + int(own["starts_left_out"].sum()))
    return found


def imitation_over_random(results: Results) -> Judgement:
    """Up to 100x."""
    ratios = _ratios(results, "imitation", "random")
    _, best = _extremes(ratios)
    better = sum(ratio.estimate > 1 for ratio in ratios.values())
    ours = f"up to {times(ratios[best])} on `{best}`; better on {better} of {len(ratios)} actions"
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
    named = ("R1(0,1,1)", "R2(0,0,1,1)")
    parts = (2 * len(better) > len(ratios), all(action in better for action in named))
    sizes = listed([f"{times(ratios[action])} on `{action}`" for action in named])
    return Judgement(f"better on {len(better)} of {len(ratios)} actions; {sizes}", of_two(*parts))


def reinforcement_over_imitation(results: Results) -> Judgement:
    """1.14x to 2.33x."""
    ratios = _ratios(results, "reinforcement", "imitation")
    low, high = _extremes(ratios)
    better = sum(ratio.estimate > 1 for ratio in ratios.values())
    sure = sum(ratio.lies_above(1) for ratio in ratios.values())
    ours = (
        f"{times(ratios[low])} on `{low}` to {times(ratios[high])} on `{high}`; "
        f"better on {better} of {len(ratios)} actions"
    )
    if all(ratio.reaches(1.14) for ratio in ratios.values()) and 2 * sure > len(ratios):
        beyond = sum(ratio.lies_above(2.33) for ratio in ratios.values())
        size = f"beyond 2.33× on {beyond} of {len(ratios)} actions" if beyond else ""
        return Judgement(ours, Verdict.HOLDS, size)
    return Judgement(ours, Verdict.PARTLY if 2 * better > len(ratios) else Verdict.FAILS)


def _ratios(results: Results, method: str, base: str) -> dict[str, Interval]:
    """Ratio of the two methods' rates on each of the eight actions, nan where both are 0."""
    rates = complete_rates(results, EXPERIMENT, (method, base))
    return {action: rates.ratio(method, base, action) for action in ACTIONS}


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


SECTION = Section(
    EXPERIMENT,
    "Single-stage success rates",
    "Sec. VII-A3, Fig. 6",
    "How often one sampled spline does the topological action it was sampled for, "
    "from rope shapes that no method has seen.",
    values,
    claims=(
        Claim(
            statement="Imitation against random sampling, success rate",
            where="Sec. VII-A3, Fig. 6",
            paper="up to 100×",
            criterion="better on every action, and on one of them significantly above 10× and "
            "compatible with 100×; partly if significantly better on more than half",
            judge=imitation_over_random,
        ),
        Claim(
            statement="Imitation against ICP interpolation",
            where="Sec. VII-A3, Fig. 6",
            paper="higher on most actions, above all R1(0,1,1) and R2(0,0,1,1)",
            criterion="higher on more than half, and on both of these; partly if one of the two",
            judge=imitation_over_icp,
        ),
        Claim(
            statement="Imitation + RL against imitation only",
            where="Sec. VII-A3, Fig. 6",
            paper="1.14× to 2.33×",
            criterion="every action is compatible with 1.14× or more and more than half "
            "significantly better; partly if better on more than half",
            judge=reinforcement_over_imitation,
        ),
    ),
)
