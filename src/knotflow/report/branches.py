"""Splines that searches keep until an overhand is tied: by method (Sec. VII-A4), and with
primitives trained independently and jointly (Sec. VII-B2)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from knotflow.report import markdown as md
from knotflow.report.rates import ICP, IMITATION, REINFORCEMENT, Method, read_rates, with_extras
from knotflow.report.results import NotMeasured, Results
from knotflow.report.searches import (
    OVERHAND_LIMIT,
    branches_figure,
    checks,
    count,
    effort,
    mean_spread,
    median_size,
    read_searches,
    resampled,
    search_table,
    search_words,
    select,
    sizes,
    splines_spent,
)
from knotflow.report.section import Claim, Figures, Judgement, Parts, Verdict, optional
from knotflow.report.training import joint
from knotflow.statistics import Interval, weighted_mean

SIZE, JOINT = "tree_size", "joint_finetuning"
SIZE_TABLE, JOINT_TABLE = (SIZE, "method", "training_seed"), (JOINT, "training", "training_seed")
STARTS = ("straight", "arc")
TRAINED = (
    Method("independent", "trained independently", "#56b4e9"),
    Method("joint", "finetuned jointly", "#0072b2"),
)
PAPER_MEANS = (4.3, 3.4)
"""The paper's means, independent and joint."""
PAPER_LARGEST: dict[tuple[str, str], float] = {
    ("straight", "icp"): 190,
    ("arc", "icp"): 1428,
    ("straight", "imitation"): 43,
    ("arc", "imitation"): 9,
    ("straight", "reinforcement"): 4,
    ("arc", "reinforcement"): 4,
}
"""The largest trees that the paper reports, by start and method; "below 5" is drawn at 4."""
Sizes = NDArray[np.float64]


def tree_size(results: Results, figures: Figures) -> Parts:
    """The trees of every method and start, and where their splines went."""
    searches = read_searches(results, *SIZE_TABLE)
    methods = with_extras((ICP, IMITATION, REINFORCEMENT), list(searches["method"]))
    starts = list(dict.fromkeys([*STARTS, *searches["start"]]))
    groups = (
        ({"start": start, "method": method.label}, select(searches, method.name, start))
        for start in starts
        for method in methods
    )
    return {
        "figure": branches_figure(figures, SIZE, searches, methods, starts, PAPER_LARGEST),
        "searches": search_table(groups),
        "ranks": _ranks(searches),
        "settings": search_words(results, SIZE),
        "checks": checks(results, SIZE),
        "spent": splines_spent(results, SIZE, "method", methods),
        "dag": figures.own(
            SIZE,
            "dag.png",
            "The solution DAG of this overhand (Fig. 1, top): every sequence of actions that leads "
            "to this state. The searches follow the path in green.",
        ),
    }


def _ranks(searches: pd.DataFrame) -> str:
    """By rank, which method has smaller trees, from each start."""
    parts = []
    for start in STARTS:
        pairs = []
        for one, other in ((REINFORCEMENT, IMITATION), (REINFORCEMENT, ICP), (IMITATION, ICP)):
            own = [select(searches, method.name, start) for method in (one, other)]
            if not any(some.empty for some in own):
                p = stats.mannwhitneyu(*(sizes(some) for some in own)).pvalue
                pairs.append(f"{one.label} against {other.label} p = {p:.2g}")
        if pairs:
            parts.append(f"from {start}, {md.listed(pairs)}")
    return f"By the rank of splines kept (Mann-Whitney): {'; '.join(parts)}." if parts else ""


def _trees(results: Results, method: str) -> dict[str, pd.DataFrame]:
    """The searches of a method by start, some from each."""
    searches = read_searches(results, *SIZE_TABLE)
    trees = {start: select(searches, method, start) for start in STARTS}
    if missing := [f"{method} from {start}" for start, own in trees.items() if own.empty]:
        raise NotMeasured(f"needs {md.listed(missing)} in {SIZE}")
    return trees


def _ranges(trees: dict[str, pd.DataFrame]) -> tuple[str, str]:
    """Splines kept by start, and how many searches these are and simulated."""
    kept, details = [], []
    for start, own in trees.items():
        unsolved, trainings = sum(~own["solved"]), own["training_seed"].nunique()
        kept.append(f"{start}: {effort(own)[0]}" + (f", {unsolved} gave up" if unsolved else ""))
        details.append(
            f"{len(own)} searches from the {start} rope"
            + (f" of {trainings} trainings" if trainings > 1 else "")
            + f" {effort(own)[1]}"
        )
    return "<br>".join(kept), "; ".join(details)


def _in_each_training(trees: dict[str, pd.DataFrame], fits: Callable[[list[Sizes]], bool]) -> str:
    """In how many trainings the trees of one alone fit, as the paper's of one do; '' for one.

    The largest of thirty trees is larger than the largest of ten.
    """
    seeds = sorted({*trees[STARTS[0]]["training_seed"]})
    found = [
        fits([sizes(own[own["training_seed"] == seed]) for own in trees.values()]) for seed in seeds
    ]
    if len(found) < 2:
        return ""
    return f"<br>each training alone: both are so in {sum(found)} of {len(found)}"


def judge_icp(results: Results) -> Judgement:
    """Sec. VII-A4: 3 to 190 branches (straight), up to 1428 (arc)."""
    trees = _trees(results, "icp")
    largest = {start: max(own["kept"]) for start, own in trees.items()}  # at least
    wide = [largest[start] >= 10 * sizes(own).min() for start, own in trees.items()]
    same = all(0.5 <= most / PAPER_LARGEST[start, "icp"] <= 2 for start, most in largest.items())
    size = "" if same or not all(wide) else "the largest trees differ by more than a factor of 2"
    ours, detail = _ranges(trees)
    if not same:
        times = (PAPER_LARGEST[start, "icp"] / most for start, most in largest.items())
        ours += f"<br>the paper's largest are {' and '.join(f'{one:.2g}×' for one in times)} these"
    return Judgement(ours, Verdict.of_two(*wide), size, detail)


def judge_imitation(results: Results) -> Judgement:
    """Sec. VII-A4: up to 43 branches (straight), 9 (arc)."""
    trees = _trees(results, "imitation")

    def within(kept: list[Sizes]) -> list[bool]:
        most = (PAPER_LARGEST[start, "imitation"] for start in trees)
        return [max(own) <= limit for own, limit in zip(kept, most, strict=True)]

    ours, detail = _ranges(trees)
    ours += _in_each_training(trees, lambda kept: all(within(kept)))
    verdict = Verdict.of_two(*within([sizes(own) for own in trees.values()]))
    return Judgement(ours, verdict, detail=detail)


def judge_reinforcement(results: Results) -> Judgement:
    """Sec. VII-A4: below 5 in all 10 seeds, the limit of 3 in more than half."""
    trees = _trees(results, "reinforcement")

    def small_and_often(kept: list[Sizes]) -> tuple[bool, bool]:
        often = all(np.mean(own == OVERHAND_LIMIT) > 0.5 for own in kept)
        return max(np.concatenate(kept)) < 5, often

    by_start = [sizes(own) for own in trees.values()]
    every = np.concatenate(by_start)
    ours, detail = _ranges(trees)
    ours += f"<br>{OVERHAND_LIMIT} kept in {np.sum(every == OVERHAND_LIMIT)} of {len(every)}"
    ours += _in_each_training(trees, lambda kept: all(small_and_often(kept)))
    return Judgement(ours, Verdict.of_two(*small_and_often(by_start)), detail=detail)


@optional
def hardest_actions(method: str, so: str, results: Results) -> str:
    """For each start, the action of the path that succeeded least often, if one ever failed."""
    columns = dict.fromkeys(("method", "start", "action"), str)
    tried = results.table(SIZE, "tried.csv", columns | {"simulated": int, "successes": int})
    parts = []
    for start, own in tried[tried["method"] == method].groupby("start", sort=False):
        sums = own.groupby("action", sort=False)[["simulated", "successes"]].sum()
        hardest = sums.loc[(sums["successes"] / sums["simulated"]).idxmin()]
        if hardest.successes == hardest.simulated:
            continue
        parts.append(
            f"`{hardest.name}` from the {start} rope, {hardest.successes:,} of "
            f"{hardest.simulated:,} splines succeed"
        )
    return f"{so} {'; '.join(parts)}" if parts else ""


def joint_finetuning(results: Results, figures: Figures) -> Parts:
    """The trees by kind of training, its curves, and the success of single actions after it."""
    searches = read_searches(results, *JOINT_TABLE)
    groups = (({"primitives": one.label}, select(searches, one.name)) for one in TRAINED)
    return {
        "figure": branches_figure(figures, JOINT, searches, TRAINED, [""], {}),
        "searches": search_table(groups),
        "trainings": _trainings(results),
        "settings": search_words(results, JOINT),
        "checks": checks(results, JOINT),
        "spent": splines_spent(results, JOINT, "training", TRAINED),
        "curves": joint(results, figures, JOINT),
        "single_actions": _single_actions(results),
    }


@optional
def _single_actions(results: Results) -> str:
    rates = read_rates(results, JOINT, "single_actions_per_start.csv")
    return (
        "Single actions before and after, by one spline on the unseen starts of Fig. 6, with 95 % "
        f"intervals:\n\n{rates.table(TRAINED)}"
    )


def fewer_branches(results: Results) -> Judgement:
    """Sec. VII-B2: 4.3 +- 2.6 branches independently, 3.4 +- 0.6 jointly, 50 random starts."""
    before, after = found = _by_training(results)
    unsolved = sum((~own["solved"]).sum() for own in found)
    pairs = _pairs(before, after)
    by_rope = pairs.groupby("seed")["rank"].mean()
    fewer, p = by_rope.mean() < 0, signed_rank(by_rope)
    difference = resampled(pairs, pairs["kept_after"] - pairs["kept_before"], weighted_mean)
    medians = " / ".join(md.estimate(median_size(own), count) for own in found)
    simulated = " / ".join(count(own["simulated"].median()) for own in found)
    simulated_means = " / ".join(f"{own['simulated'].mean():.1f}" for own in found)
    means_of = f"{mean_spread(before)} / {mean_spread(after)} kept"
    ours = f"{unsolved} gave up" if unsolved else means_of
    ours += f"<br>medians {medians}, by rank p = {p:.2g}"
    detail = f"{simulated} simulated in the median and {simulated_means} on average"
    detail += f", {len(before)} and {len(after)} searches"
    detail += "" if unsolved else f", difference of means {md.estimate(difference)}"
    certain = p < 0.05 and difference.high < 0
    spreads = _spreads(pairs)
    narrower = (spreads["kept_after"] < spreads["kept_before"]).mean() > 0.5
    verdict = Verdict.PARTLY if fewer else Verdict.FAILS
    size = ""
    if fewer and certain and not unsolved:
        verdict = Verdict.HOLDS if narrower else verdict
        means = [resampled(own, own["kept"], weighted_mean) for own in found]
        larger = any(map(Interval.lies_above, means, PAPER_MEANS))
        if larger or difference.lies_above(PAPER_MEANS[1] - PAPER_MEANS[0]):
            size = f"means of {md.estimate(means[0])} and {md.estimate(means[1])}"
    return Judgement(ours, verdict, size, detail)


def few_large_trees(results: Results) -> str:
    """How much of all splines kept the largest trees have, and where the spread grows."""
    found = _by_training(results)
    counts = [np.sort(own["kept"]) for own in found]
    tenth = [own[-max(1, len(own) // 10) :].sum() / own.sum() for own in counts]
    shares = " / ".join(f"{md.whole(100 * share)} %" for share in tenth)
    spreads = _spreads(_pairs(*found))
    grows = spreads["kept_after"] >= spreads["kept_before"]
    return (
        f"the largest tenth of the trees has {shares} of all splines kept, and the standard "
        f"deviation grows in {sum(grows)} of {len(grows)} trainings"
    )


def _by_training(results: Results) -> list[pd.DataFrame]:
    """The searches of either kind of training, some of each."""
    searches = read_searches(results, *JOINT_TABLE)
    found = {one.name: select(searches, one.name) for one in TRAINED}
    if missing := [name for name, own in found.items() if own.empty]:
        raise NotMeasured(f"needs {md.listed(missing)} in {JOINT}")
    return [*found.values()]


def _pairs(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Searches from the same ropes with the same training seed, and by how much the `rank` of the
    later one among all searches is higher."""
    ranks = stats.rankdata(np.concatenate([sizes(before), sizes(after)]))  # inf is the largest
    before = before.assign(rank=ranks[: len(before)])
    after = after.assign(rank=ranks[len(before) :])
    both = before.merge(after, on=["training_seed", "seed"], suffixes=("_before", "_after"))
    return both.assign(start=both["start_after"], rank=both["rank_after"] - both["rank_before"])


def _spreads(pairs: pd.DataFrame) -> pd.DataFrame:
    """Standard deviations of the splines kept before and after, a row a training."""
    return pairs.groupby("training_seed")[["kept_before", "kept_after"]].std()


def signed_rank(differences: pd.Series) -> float:
    """The p value of Wilcoxon's signed-rank test; 1 where nothing differs."""
    return float(stats.wilcoxon(differences).pvalue) if differences.any() else 1.0


def _trainings(results: Results) -> str:
    """A line a training: each is what the paper did once."""
    rows = []
    for seed, own in _pairs(*_by_training(results)).groupby("training_seed"):
        row = {"training": str(seed)}
        for side in ("before", "after"):
            kept = own[f"kept_{side}"]
            row[f"mean ± SD {side}"] = mean_spread(
                pd.DataFrame({"kept": kept, "solved": own[f"solved_{side}"]})
            )
            row[f"{OVERHAND_LIMIT} kept {side}"] = md.share(kept == OVERHAND_LIMIT)
        row["ropes with fewer / more after"] = f"{sum(own['rank'] < 0)} / {sum(own['rank'] > 0)}"
        row["p"] = f"{signed_rank(own['rank']):.2g}"
        rows.append(row)
    return md.table(rows, "Each training by itself, as the paper has one:")


GROWN = "trees grow where the hardest action fails:"
"""Why trees are larger than the paper's."""
SIZE_CLAIMS = (
    Claim(
        "Branches kept to the overhand, ICP",
        "10 seeds: 3 to 190 (straight), up to 1,428 (arc)",
        "from both starts the largest tree kept at least 10 times as many as the smallest; partly "
        "if from one",
        judge_icp,
        partial(
            hardest_actions,
            "icp",
            "splines that fail mostly leave the path and are not kept. The hardest action is",
        ),
    ),
    Claim(
        "Branches kept to the overhand, imitation only",
        "10 seeds: up to 43 (straight), 9 (arc)",
        "no tree kept more than these; partly if from one of the starts",
        judge_imitation,
        partial(hardest_actions, "imitation", GROWN),
    ),
    Claim(
        "Branches kept to the overhand, imitation + RL",
        "below 5 in all 10 seeds, 3 (the limit) in more than half",
        "both are so from both starts; partly if one of the two conditions holds",
        judge_reinforcement,
        partial(hardest_actions, "reinforcement", GROWN),
    ),
)

JOINT_CLAIMS = (
    Claim(
        "Branches kept from random starts, independently / jointly finetuned",
        "4.3 ± 2.6 / 3.4 ± 0.6 over 50 starts",
        "none gives up, mean and ranks fall significantly, and the standard deviation falls in "
        "most trainings; partly if the ranks fall",
        fewer_branches,
        few_large_trees,
    ),
)
