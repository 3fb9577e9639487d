"""How many branches a tree search needs to tie an overhand (Sec. VII-A4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from knotflow.report import markdown as md
from knotflow.report.rates import ICP, IMITATION, REINFORCEMENT, Method, with_extras
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
from knotflow.report.section import Claim, Figures, Judgement, NotMeasured, Section, Verdict
from knotflow.statistics import bootstrap, clustered_rate

EXPERIMENT = "tree_size"
STARTS = ("straight", "arc")
STEPS = {"start": str, "action": str, "shape": int, "splines": int, "successes": int}
PAPER_LARGEST: dict[tuple[str, str], float] = {
    ("straight", "icp"): 190,
    ("arc", "icp"): 1428,
    ("straight", "imitation"): 43,
    ("arc", "imitation"): 9,
    ("straight", "reinforcement"): 4,
    ("arc", "reinforcement"): 4,
}
"""The largest trees that the paper reports, by start and method; "below 5" is drawn at 4."""


def body(results: Results, figures: Figures) -> str | None:
    """The branches of every method and start, and where they went."""
    searches = read_searches(results, EXPERIMENT, "method")
    if searches.empty:
        return None
    methods = with_extras((ICP, IMITATION, REINFORCEMENT), list(searches["method"]))
    starts = list(dict.fromkeys([*STARTS, *searches["start"]]))
    groups: dict[tuple[str, ...], pd.DataFrame] = {
        (start, method.label): select(searches, method.name, start)
        for start in starts
        for method in methods
    }
    return md.join(
        branches_figure(figures, EXPERIMENT, searches, methods, starts, PAPER_LARGEST),
        search_table(("start", "method"), groups),
        "Seeds vary the search, not the training: all trees of a method are grown with the same "
        "primitives.",
        checks(results, EXPERIMENT),
        branches_spent(results, EXPERIMENT, "method"),
        step_table(results, methods),
        figures.own(
            EXPERIMENT,
            "dag.png",
            "The solution DAG of this overhand (Fig. 1, top): every sequence of actions that leads "
            "to it. The searches follow the path in green.",
        ),
    )


def _read_steps(results: Results, method: str) -> pd.DataFrame | None:
    name = f"{method}_steps.csv"
    return results.table(EXPERIMENT, name, STEPS, key=("start", "action", "shape"))


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
    splines = results.setting(EXPERIMENT, "splines", "steps") or "several"
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
    searches = read_searches(results, EXPERIMENT, "method")
    trees = {start: select(searches, method, start) for start in STARTS}
    if missing := [f"{method} from {start}" for start, own in trees.items() if own.empty]:
        raise NotMeasured(f"needs {md.listed(missing)} in {EXPERIMENT}")
    return trees


def _ranges(trees: dict[str, pd.DataFrame]) -> str:
    parts = []
    for start, own in trees.items():
        counts, unsolved = own["branches"], sum(~own["solved"])
        middle = md.estimate(bootstrap(counts, np.median))
        gave_up = f", {unsolved} gave up" if unsolved else ""
        parts.append(
            f"{start}: {min(counts):,} to {max(counts):,}, median {middle}, "
            f"{len(counts)} seeds{gave_up}"
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


def hardest_steps(method: str) -> Callable[[Results], str]:
    """For each start, the action that succeeds least from what the one before left."""

    def reason(results: Results) -> str:
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

    return reason


SECTION = Section(
    EXPERIMENT,
    "Tree size",
    "Sec. VII-A4",
    "Branches of the search tree until an overhand is tied along the path R1(0,1,1), C(0,1,1), "
    "C(2,0,1), from a straight rope and from an arc.",
    body,
    claims=(
        Claim(
            "Branches to the overhand, ICP",
            "10 seeds: 3 to 190 (straight), up to 1,428 (arc)",
            "from both starts the largest tree has at least 10 times the branches of the smallest; "
            "partly if from one",
            judge_icp,
            hardest_steps("icp"),
        ),
        Claim(
            "Branches to the overhand, imitation only",
            "10 seeds: up to 43 (straight), 9 (arc)",
            "no tree is larger than these; partly if from one of the starts",
            judge_imitation,
            hardest_steps("imitation"),
        ),
        Claim(
            "Branches to the overhand, imitation + RL",
            "below 5 in all 10 seeds, 3 (the limit) in more than half",
            "both are so from both starts; partly if one of the two",
            judge_reinforcement,
            hardest_steps("reinforcement"),
        ),
    ),
)
