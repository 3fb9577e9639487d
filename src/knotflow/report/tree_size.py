"""How many branches a tree search needs to tie an overhand (Sec. VII-A4)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from knotflow.report.claims import Claim, Judgement, NotMeasured, of_two
from knotflow.report.paper import OVERHAND_LIMIT, STARTS, TREE_SIZE, with_extras
from knotflow.report.path_steps import hardest_steps, left_ropes, step_table
from knotflow.report.results import Results
from knotflow.report.searches import (
    branches,
    confirmation,
    of,
    read_searches,
    search_table,
    sizes,
    spent,
)
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import bootstrap
from knotflow.report.tables import estimate, listed

EXPERIMENT = "tree_size"
#: The largest trees that the paper reports, by start and method; "below 5" is drawn at 4.
PAPER_LARGEST: dict[tuple[str, str], float] = {
    ("straight", "icp"): 190,
    ("arc", "icp"): 1428,
    ("straight", "imitation"): 43,
    ("arc", "imitation"): 9,
    ("straight", "reinforcement"): 4,
    ("arc", "reinforcement"): 4,
}


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure and a line for every method and start."""
    searches = read_searches(results, EXPERIMENT, "method")
    if searches is None:
        return None
    found = list(searches["method"])
    methods = with_extras(TREE_SIZE, found)
    starts = list(dict.fromkeys([*STARTS, *searches["start"]]))
    groups = [
        ((start, method.label), of(searches, method.name, start))
        for start in starts
        for method in methods
    ]
    left = left_ropes(results, EXPERIMENT, methods, f"{EXPERIMENT}_left")
    picture = branches(searches, methods, starts, EXPERIMENT, PAPER_LARGEST)
    return {
        "figure": pictures.add(picture),
        "table": search_table(("start", "method"), [line for line in groups if len(line[1])]),
        "missing": listed([method.label for method in methods if method.name not in found]),
        "limit": OVERHAND_LIMIT,
        "dag": pictures.stored(results, EXPERIMENT, "dag", "Solution DAG"),
        "unsolved": sum(~searches["solved"]),
        "confirmation": confirmation(results, EXPERIMENT, searches),
        "spent": spent(results, EXPERIMENT, "method"),
        "steps": step_table(results, EXPERIMENT, methods),
        "left": left and pictures.add(left),
        "tried": results.setting(EXPERIMENT, "icp_steps", "splines"),
        "shapes": results.setting(EXPERIMENT, "icp_steps", "shapes"),
    }


def icp(results: Results) -> Judgement:
    """Sec. VII-A4: 3 to 190 branches (straight), up to 1428 (arc)."""
    trees = _trees(results, "icp")
    wide = [max(sizes(own)) >= 10 * own["branches"].min() for own in trees.values()]
    largest = {start: max(sizes(own)) for start, own in trees.items()}
    same = all(0.5 <= most / PAPER_LARGEST[start, "icp"] <= 2 for start, most in largest.items())
    size = "" if same or not all(wide) else "the largest trees differ by more than a factor of 2"
    return Judgement(_ranges(trees), of_two(*wide), size)


def imitation(results: Results) -> Judgement:
    """Sec. VII-A4: up to 43 branches (straight), 9 (arc)."""
    trees = _trees(results, "imitation")
    within = [max(sizes(own)) <= PAPER_LARGEST[s, "imitation"] for s, own in trees.items()]
    return Judgement(_ranges(trees), of_two(*within))


def reinforcement(results: Results) -> Judgement:
    """Sec. VII-A4: below 5 in all 10 seeds, the limit of 3 in more than half."""
    trees = {start: sizes(own) for start, own in _trees(results, "reinforcement").items()}
    every = [size for own in trees.values() for size in own]
    often = all(2 * own.count(OVERHAND_LIMIT) > len(own) for own in trees.values())
    share = f"{OVERHAND_LIMIT} branches in {every.count(OVERHAND_LIMIT)} of {len(every)}"
    ranges = _ranges(_trees(results, "reinforcement"))
    return Judgement(f"{ranges}; {share}", of_two(max(every) < 5, often))


def _hardest(method: str) -> Callable[[Results], str]:
    def reason(results: Results) -> str:
        found = hardest_steps(results, EXPERIMENT, method)
        return found and (
            "of the path's actions, each tried from ropes that the one before left, that which "
            f"succeeds least is {found}"
        )

    return reason


def _trees(results: Results, method: str) -> dict[str, pd.DataFrame]:
    """The searches of a method by start, some from each."""
    searches = read_searches(results, EXPERIMENT, "method")
    trees = {start: of(searches, method, start) for start in STARTS}
    missing = [f"{method} from the {start} start" for start, own in trees.items() if own.empty]
    if missing:
        raise NotMeasured(f"needs {listed(missing)} in tree_size")
    return trees


def _ranges(trees: dict[str, pd.DataFrame]) -> str:
    parts = []
    for start, own in trees.items():
        counts, unsolved = own["branches"], sum(~own["solved"])
        middle = estimate(bootstrap(counts, np.median))
        gave_up = f", {unsolved} gave up" if unsolved else ""
        parts.append(
            f"{start}: {min(counts):,} to {max(counts):,}, median {middle}, "
            f"{len(counts)} seeds{gave_up}"
        )
    return "; ".join(parts)


SECTION = Section(
    EXPERIMENT,
    "Tree size",
    "Sec. VII-A4",
    "Branches of the search tree until an overhand is tied along the path R1(0,1,1), C(0,1,1), "
    "C(2,0,1), from a straight rope and from an arc.",
    values,
    claims=(
        Claim(
            statement="Branches to the overhand, ICP",
            where="Sec. VII-A4",
            paper="10 seeds: 3 to 190 (straight), up to 1,428 (arc)",
            criterion="from both starts the largest tree has at least 10 times the branches of "
            "the smallest; partly from one",
            judge=icp,
            reason=_hardest("icp"),
        ),
        Claim(
            statement="Branches to the overhand, imitation only",
            where="Sec. VII-A4",
            paper="10 seeds: up to 43 (straight), 9 (arc)",
            criterion="no tree is larger than these; partly from one of the starts",
            judge=imitation,
            reason=_hardest("imitation"),
        ),
        Claim(
            statement="Branches to the overhand, imitation + RL",
            where="Sec. VII-A4",
            paper="below 5 in all 10 seeds, 3 (the limit) in more than half",
            criterion="both are so from both starts; partly if one of the two",
            judge=reinforcement,
            reason=_hardest("reinforcement"),
        ),
    ),
)
