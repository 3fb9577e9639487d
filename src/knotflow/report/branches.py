"""Branches that searches need to tie an overhand: by method (Sec. VII-A4), and with primitives
trained independently and jointly (Sec. VII-B2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.report import markdown as md
from knotflow.report.rates import ICP, IMITATION, REINFORCEMENT, Method, read_rates, with_extras
from knotflow.report.results import Results
from knotflow.report.searches import (
    OVERHAND_LIMIT,
    branches_figure,
    branches_spent,
    checks,
    read_searches,
    search_table,
    select,
    sizes,
)
from knotflow.report.section import Claim, Figures, Judgement, NotMeasured, Parts, Verdict
from knotflow.report.training import joint
from knotflow.statistics import Interval, bootstrap, clustered_rate, mean_difference

SIZE, JOINT = "tree_size", "joint_finetuning"
STARTS = ("straight", "arc")
STEPS = {"start": str, "action": str, "shape": int, "splines": int, "successes": int}
TRAINED = (
    Method("independent", "trained independently", "#56b4e9"),
    Method("joint", "finetuned jointly", "#0072b2"),
)
BY_POSTERIOR = (
    Method("independent_posterior", "independently, posterior rule", "#e69f00"),
    Method("joint_posterior", "jointly, posterior rule", "#009e73"),
)
PAPER_MEANS = (4.3, 3.4)
"""The paper's mean branches, independent and joint."""
PAPER_LARGEST: dict[tuple[str, str], float] = {
    ("straight", "icp"): 190,
    ("arc", "icp"): 1428,
    ("straight", "imitation"): 43,
    ("arc", "imitation"): 9,
    ("straight", "reinforcement"): 4,
    ("arc", "reinforcement"): 4,
}
"""The largest trees that the paper reports, by start and method; "below 5" is drawn at 4."""


def tree_size(results: Results, figures: Figures) -> Parts | None:
    """The branches of every method and start, and where they went."""
    searches = read_searches(results, SIZE, "method")
    if searches.empty:
        return None
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
        "checks": checks(results, SIZE),
        "spent": branches_spent(results, SIZE, "method"),
        "steps": step_table(results, methods),
        "dag": figures.own(
            SIZE,
            "dag.png",
            "The solution DAG of this overhand (Fig. 1, top): every sequence of actions that leads "
            "to it. The searches follow the path in green.",
        ),
    }


def _read_steps(results: Results, method: str) -> pd.DataFrame | None:
    name = f"{method}_steps.csv"
    return results.table(SIZE, name, STEPS, key=("start", "action", "shape"))


def step_table(results: Results, methods: Sequence[Method]) -> str:
    """A line a start and method: how often each action succeeds; '' where none was tried."""
    found = {method.label: _read_steps(results, method.name) for method in methods}
    known = {label: steps for label, steps in found.items() if steps is not None}
    starts, actions = (
        list(dict.fromkeys(cell for steps in known.values() for cell in steps[column]))
        for column in ("start", "action")
    )
    rows = [
        {"start": start, "method": label}
        | {f"`{action}`": _step_cell(steps, start, action) for action in actions}
        for start in starts
        for label, steps in known.items()
    ]
    splines = results.setting(SIZE, "splines", "steps") or "several"
    return md.table(
        rows,
        f"The next table explains the sizes step by step. Each action was tried with {splines} "
        "splines from each of the ropes that the same method's splines for the action before had "
        "left. Imitation and RL learn what makes one action succeed, whatever it leaves for the "
        "next; the demonstrations that ICP interpolates were chosen for that as well.",
    )


def _step_cell(steps: pd.DataFrame, start: str, action: str) -> str:
    own = steps[(steps["start"] == start) & (steps["action"] == action)]
    if own.empty:
        return md.NOTHING
    never = int((own["successes"] == 0).sum())
    rate = md.percent(clustered_rate(own["successes"], own["splines"]))
    return f"{rate}<br>none from {never} of {len(own)} ropes" if never else rate


def _trees(results: Results, method: str) -> dict[str, pd.DataFrame]:
    """The searches of a method by start, some from each."""
    searches = read_searches(results, SIZE, "method")
    trees = {start: select(searches, method, start) for start in STARTS}
    _refuse_missing({f"{method} from {start}": own for start, own in trees.items()}, SIZE)
    return trees


def _refuse_missing(searches: Mapping[str, pd.DataFrame], experiment: str) -> None:
    if missing := [name for name, own in searches.items() if own.empty]:
        raise NotMeasured(f"needs {md.listed(missing)} in {experiment}")


def _ranges(trees: dict[str, pd.DataFrame]) -> str:
    parts = []
    for start, own in trees.items():
        counts, unsolved = own["branches"], sum(~own["solved"])
        middle = md.estimate(bootstrap(counts, np.median))
        parts.append(
            f"{start}: {min(counts):,} to {max(counts):,}, median {middle}, {len(counts)} seeds"
            + (f", {unsolved} gave up" if unsolved else "")
        )
    return "; ".join(parts)


def judge_icp(results: Results) -> Judgement:
    """Sec. VII-A4: 3 to 190 branches (straight), up to 1428 (arc)."""
    trees = _trees(results, "icp")
    wide = [max(sizes(own)) >= 10 * own["branches"].min() for own in trees.values()]
    largest = {start: max(sizes(own)) for start, own in trees.items()}
    same = all(0.5 <= most / PAPER_LARGEST[start, "icp"] <= 2 for start, most in largest.items())
    size = "" if same or not all(wide) else "the largest trees differ by more than a factor of 2"
    return Judgement(_ranges(trees), Verdict.of_two(*wide), size)


def judge_imitation(results: Results) -> Judgement:
    """Sec. VII-A4: up to 43 branches (straight), 9 (arc)."""
    trees = _trees(results, "imitation")
    within = [max(sizes(own)) <= PAPER_LARGEST[s, "imitation"] for s, own in trees.items()]
    return Judgement(_ranges(trees), Verdict.of_two(*within))


def judge_reinforcement(results: Results) -> Judgement:
    """Sec. VII-A4: below 5 in all 10 seeds, the limit of 3 in more than half."""
    trees = _trees(results, "reinforcement")
    by_start = [sizes(own) for own in trees.values()]
    every = [size for own in by_start for size in own]
    often = all(2 * own.count(OVERHAND_LIMIT) > len(own) for own in by_start)
    fewest = f"{OVERHAND_LIMIT} branches in {every.count(OVERHAND_LIMIT)} of {len(every)}"
    return Judgement(f"{_ranges(trees)}; {fewest}", Verdict.of_two(max(every) < 5, often))


def hardest_steps(method: str, results: Results) -> str:
    """For each start, the action that succeeds least from what the one before left."""
    steps = _read_steps(results, method)
    if steps is None:
        return ""
    parts = []
    for start, own in steps.groupby("start", sort=False):
        sums = own.groupby("action", sort=False)[["successes", "splines"]].sum()
        action = str((sums["successes"] / sums["splines"]).idxmin())
        cell = _step_cell(own, str(start), action).replace("<br>", ", ")
        parts.append(f"`{action}` from the {start} rope, {cell}")
    return f"the hardest action of the path is {'; '.join(parts)}"


def joint_finetuning(results: Results, figures: Figures) -> Parts | None:
    """The branches by kind of training, its curves, and the success of single actions after it."""
    searches = read_searches(results, JOINT, "primitives", with_start=False)
    if searches.empty:
        return None
    names = set(searches["method"])
    shown = [*TRAINED, *(method for method in BY_POSTERIOR if method.name in names)]
    methods = with_extras(shown, list(searches["method"]))
    single = read_rates(results, JOINT, "single_actions.csv", "single_actions_per_start.csv")
    groups = (({"primitives": one.label}, select(searches, one.name)) for one in methods)
    return {
        "figure": branches_figure(figures, JOINT, searches, methods, [""], {}),
        "searches": search_table(groups),
        "checks": checks(results, JOINT),
        "spent": branches_spent(results, JOINT, "primitives"),
        "curves": joint(results, figures, JOINT),
        "single_actions": "Single actions before and after, by one spline on the unseen starts of "
        f"Fig. 6, with {single.intervals}:\n\n{single.table(TRAINED)}"
        if single
        else "",
    }


def fewer_branches(results: Results) -> Judgement:
    """Sec. VII-B2: 4.3 +- 2.6 branches independently, 3.4 +- 0.6 jointly, 50 random starts."""
    found = _by_training(results, TRAINED)
    _refuse_missing(found, JOINT)
    base, first = found.values()
    before, after = _counts(base), _counts(first)
    fewer = _difference(base, first)
    unsolved = sum(~first["solved"]) + sum(~base["solved"])
    ours = (
        f"{_mean_spread(before)} / {_mean_spread(after)} over {len(before)} and {len(after)} "
        f"starts; difference {md.estimate(fewer)}"
    )
    ours += f"; {unsolved} gave up" if unsolved else ""
    others = [*_by_training(results, BY_POSTERIOR).values()]
    if not any(own.empty for own in others):
        spreads = " / ".join(_mean_spread(_counts(own)) for own in others)
        ours += f"; by the posterior rule {spreads}, difference {md.estimate(_difference(*others))}"
    if fewer.estimate >= 0:
        return Judgement(ours, Verdict.FAILS)
    sure = fewer.high is not None and fewer.high < 0
    means = [bootstrap(before), bootstrap(after)]
    outside = any(
        mean.lies_above(paper) or not mean.reaches(paper)
        for mean, paper in zip(means, PAPER_MEANS, strict=True)
    )
    words = f"means of {md.estimate(means[0])} and {md.estimate(means[1])} branches"
    verdict = Verdict.HOLDS if sure and np.std(after) < np.std(before) else Verdict.PARTLY
    return Judgement(ours, verdict, words if sure and outside else "")


def few_large_trees(results: Results) -> str:
    """How much of all branches the largest trees have, and the trees of the posterior rule."""
    counts = [_counts(own) for own in _by_training(results, TRAINED).values()]
    medians = " / ".join(md.tenths(float(np.median(own))) for own in counts)
    tenth = [np.sort(own)[-max(1, len(own) // 10) :].sum() / own.sum() for own in counts]
    shares = " / ".join(f"{100 * share:.0f} %" for share in tenth)
    others = [_counts(own) for own in _by_training(results, BY_POSTERIOR).values()]
    posterior = (
        ". By the posterior rule, which leaves ropes from which little succeeds, the largest trees "
        f"have {' / '.join(f'{own.max():.0f}' for own in others)} branches"
    )
    return (
        f"a few large trees dominate the means: the medians are {medians}, and the largest tenth "
        f"of the trees has {shares} of all branches{posterior if all(map(len, others)) else ''}"
    )


def _by_training(results: Results, methods: Sequence[Method]) -> dict[str, pd.DataFrame]:
    searches = read_searches(results, JOINT, "primitives", with_start=False)
    return {one.name: select(searches, one.name).sort_values("seed") for one in methods}


def _counts(searches: pd.DataFrame) -> NDArray[np.float64]:
    return searches["branches"].to_numpy(float)


def _difference(base: pd.DataFrame, first: pd.DataFrame) -> Interval:
    """Branches of `first` less those of `base`; pairs are resampled where both have all seeds, for
    a seed is a start."""
    paired = first["seed"].tolist() == base["seed"].tolist()
    return mean_difference(_counts(first), _counts(base), paired=paired)


def _mean_spread(counts: NDArray[np.float64]) -> str:
    spread = md.tenths(float(np.std(counts, ddof=1))) if len(counts) > 1 else "?"
    return f"{md.tenths(float(np.mean(counts)))} ± {spread}"


SIZE_CLAIMS = (
    Claim(
        "Branches to the overhand, ICP",
        "10 seeds: 3 to 190 (straight), up to 1,428 (arc)",
        "from both starts the largest tree has at least 10 times the branches of the smallest; "
        "partly if from one",
        judge_icp,
        partial(hardest_steps, "icp"),
    ),
    Claim(
        "Branches to the overhand, imitation only",
        "10 seeds: up to 43 (straight), 9 (arc)",
        "no tree is larger than these; partly if from one of the starts",
        judge_imitation,
        partial(hardest_steps, "imitation"),
    ),
    Claim(
        "Branches to the overhand, imitation + RL",
        "below 5 in all 10 seeds, 3 (the limit) in more than half",
        "both are so from both starts; partly if one of the two",
        judge_reinforcement,
        partial(hardest_steps, "reinforcement"),
    ),
)

JOINT_CLAIMS = (
    Claim(
        "Branches from random starts, independently / jointly finetuned",
        "4.3 ± 2.6 / 3.4 ± 0.6 over 50 starts",
        "the mean significantly falls and so does the spread; partly if the mean falls",
        fewer_branches,
        few_large_trees,
    ),
)
