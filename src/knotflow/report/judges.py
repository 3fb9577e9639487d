"""One function a claim: our number and a verdict, computed from the tables alone.

A judge raises NotMeasured where the tables lack what it needs. "Surely" is to say that the whole
95 % interval lies on that side.
"""

from __future__ import annotations

import math

import numpy as np

from knotflow.report.paper import ACTIONS, OVERHAND_LIMIT, STARTS
from knotflow.report.records import Rates, Search
from knotflow.report.results import Results
from knotflow.report.statistics import Interval, bootstrap, mean_difference, rate_ratio
from knotflow.report.tables import estimate, listed, tenths, times
from knotflow.report.verdict import NotMeasured, Outcome, Verdict


def imitation_over_random(results: Results) -> Outcome:
    """Sec. VII-A3: up to 100x."""
    ratios = _ratios(results, "imitation", "random")
    _, best = _extremes(ratios)
    better = sum(ratio.estimate > 1 for ratio in ratios.values())
    ours = f"up to {times(ratios[best])} on `{best}`; better on {better} of {len(ratios)} actions"
    large = any(ratio.lies_above(10) and ratio.reaches(100) for ratio in ratios.values())
    sure = sum(ratio.lies_above(1) for ratio in ratios.values())
    if large and better == len(ratios):
        return Outcome(ours, Verdict.HOLDS)
    return Outcome(ours, Verdict.PARTLY if 2 * sure > len(ratios) else Verdict.FAILS)


def reinforcement_over_imitation(results: Results) -> Outcome:
    """Sec. VII-A3: 1.14x to 2.33x."""
    ratios = _ratios(results, "reinforcement", "imitation")
    low, high = _extremes(ratios)
    better = sum(ratio.estimate > 1 for ratio in ratios.values())
    sure = sum(ratio.lies_above(1) for ratio in ratios.values())
    ours = (
        f"{times(ratios[low])} on `{low}` to {times(ratios[high])} on `{high}`; "
        f"better on {better} of {len(ratios)} actions"
    )
    if all(ratio.reaches(1.14) for ratio in ratios.values()) and 2 * sure > len(ratios):
        return Outcome(ours, Verdict.HOLDS)
    return Outcome(ours, Verdict.PARTLY if 2 * better > len(ratios) else Verdict.FAILS)


def imitation_over_icp(results: Results) -> Outcome:
    """Sec. VII-A3: higher on most actions, above all on R1(0,1,1) and R2(0,0,1,1)."""
    ratios = _ratios(results, "imitation", "icp")
    better = [action for action, ratio in ratios.items() if ratio.estimate > 1]
    named = ("R1(0,1,1)", "R2(0,0,1,1)")
    parts = (2 * len(better) > len(ratios), all(action in better for action in named))
    told = listed([f"{times(ratios[action])} on `{action}`" for action in named])
    ours = f"better on {len(better)} of {len(ratios)} actions; {told}"
    return Outcome(ours, _of_two(*parts))


def icp_tree_size(results: Results) -> Outcome:
    """Sec. VII-A4: 3 to 190 branches (straight), up to 1428 (arc)."""
    trees = _trees(results, "icp")
    wide = [_most(own) >= 10 * min(s.branches for s in own) for own in trees.values()]
    return Outcome(_ranges(trees), _of_two(*wide))


def imitation_tree_size(results: Results) -> Outcome:
    """Sec. VII-A4: up to 43 branches (straight), 9 (arc)."""
    trees = _trees(results, "imitation")
    within = [_most(trees["straight"]) <= 43, _most(trees["arc"]) <= 9]
    return Outcome(_ranges(trees), _of_two(*within))


def reinforcement_tree_size(results: Results) -> Outcome:
    """Sec. VII-A4: below 5 in all 10 seeds, the limit of 3 in more than half."""
    trees = _trees(results, "reinforcement")
    every = [search for own in trees.values() for search in own]
    least = [sum(s.branches == OVERHAND_LIMIT and s.solved for s in own) for own in trees.values()]
    often = all(2 * n > len(own) for n, own in zip(least, trees.values(), strict=True))
    share = f"{OVERHAND_LIMIT} branches in {sum(least)} of {len(every)}"
    return Outcome(f"{_ranges(trees)}; {share}", _of_two(_most(every) < 5, often))


def actor_and_critic(results: Results) -> Outcome:
    """Sec. VII-B1: together best on 7 of 8, the gap to the critic alone largest on two of them."""
    methods = ("actor_only", "critic_only", "actor_critic")
    rates = _rates(results, "ablation_actor_critic", methods)
    best, gaps = [], {}
    for action in ACTIONS:
        value = {m: r.interval.estimate for m in methods if (r := rates.get(m, action))}
        gaps[action] = value["actor_critic"] - value["critic_only"]
        if value["actor_critic"] >= max(value.values()):
            best.append(action)
    widest = sorted(gaps, key=lambda action: -gaps[action])[:2]
    told = listed([f"`{action}` ({100 * gaps[action]:+.0f} points)" for action in widest])
    return Outcome(
        f"best on {len(best)} of {len(ACTIONS)}; the gap to the critic alone is largest on {told}",
        _of_two(len(best) >= 7, set(widest) == {"C(2,0,1)", "C(2,4,1)"}),
    )


def joint_finetuning(results: Results) -> Outcome:
    """Sec. VII-B2: 4.3 +- 2.6 branches independently, 3.4 +- 0.6 jointly, 50 random starts."""
    searches = results.joint_finetuning
    arms = {arm: searches.of(arm) if searches else [] for arm in ("independent", "joint")}
    missing = [arm for arm, own in arms.items() if not own]
    if missing:
        raise NotMeasured(f"needs {listed(missing)} in joint_finetuning")
    # The same seed is the same start: with all seeds on both sides the pairs are resampled.
    first, base = (sorted(arms[arm], key=lambda s: s.seed) for arm in ("joint", "independent"))
    paired = [s.seed for s in first] == [s.seed for s in base]
    counts = [[s.branches for s in own] for own in (first, base)]
    fewer = mean_difference(counts[0], counts[1], paired=paired)
    unsolved = sum(not search.solved for search in [*first, *base])
    ours = (
        f"{_mean_spread(counts[1])} / {_mean_spread(counts[0])} over {len(counts[1])} and "
        f"{len(counts[0])} starts; difference {estimate(fewer)}"
        + (f"; {unsolved} gave up" if unsolved else "")
    )
    sure = fewer.high is not None and fewer.high < 0
    verdict = Verdict.HOLDS if sure and np.std(counts[0]) < np.std(counts[1]) else Verdict.PARTLY
    return Outcome(ours, verdict if fewer.estimate < 0 else Verdict.FAILS)


def _rates(results: Results, experiment: str, methods: tuple[str, ...]) -> Rates:
    """The rates of a table that has all of `methods` on all eight actions."""
    rates = results.rates(experiment)
    missing = [m for m in methods if rates is None or m not in rates.methods]
    if rates is None or missing:
        raise NotMeasured(f"needs {listed(missing)} in {experiment}")
    shared = rates.shared_actions(*methods)
    if missing := [action for action in ACTIONS if action not in shared]:
        raise NotMeasured(f"needs {listed(missing)} of {listed(methods)} in {experiment}")
    return rates


def _ratios(results: Results, method: str, base: str) -> dict[str, Interval]:
    """Ratio of the two methods' rates on each of the eight actions, nan where both are 0."""
    rates = _rates(results, "single_stage", (method, base))
    return {
        action: rate_ratio(top.successes, top.trials, bottom.successes, bottom.trials)
        for action in ACTIONS
        if (top := rates.get(method, action)) and (bottom := rates.get(base, action))
    }


def _extremes(ratios: dict[str, Interval]) -> tuple[str, str]:
    """The actions of the smallest and of the largest ratio.

    A ratio to a rate of 0 has only a lower limit: it is the largest where there is no other.
    """
    finite = [action for action, ratio in ratios.items() if math.isfinite(ratio.estimate)]
    told = finite or [action for action, ratio in ratios.items() if ratio.estimate > 1]
    if not told:
        raise NotMeasured("needs a success of either method in single_stage")
    ordered = sorted(told, key=lambda action: (ratios[action].estimate, ratios[action].low))
    return ordered[0], ordered[-1]


def _trees(results: Results, arm: str) -> dict[str, list[Search]]:
    searches = results.tree_size
    trees = {start: searches.of(arm, start) if searches else [] for start in STARTS}
    missing = [f"{arm} from the {start} start" for start, own in trees.items() if not own]
    if missing:
        raise NotMeasured(f"needs {listed(missing)} in tree_size")
    return trees


def _most(searches: list[Search]) -> float:
    """The largest tree; one that gave up is larger than any bound."""
    return max(s.branches if s.solved else float("inf") for s in searches)


def _ranges(trees: dict[str, list[Search]]) -> str:
    told = []
    for start, own in trees.items():
        counts = [search.branches for search in own]
        unsolved = sum(not search.solved for search in own)
        middle = estimate(bootstrap(counts, np.median))
        gave_up = f", {unsolved} gave up" if unsolved else ""
        told.append(
            f"{start}: {min(counts):,} to {max(counts):,}, median {middle}, "
            f"{len(counts)} seeds{gave_up}"
        )
    return "; ".join(told)


def _mean_spread(counts: list[int]) -> str:
    spread = tenths(float(np.std(counts, ddof=1))) if len(counts) > 1 else "?"
    return f"{tenths(float(np.mean(counts)))} ± {spread}"


def _of_two(first: bool, second: bool) -> Verdict:
    if first and second:
        return Verdict.HOLDS
    return Verdict.PARTLY if first or second else Verdict.FAILS
