"""Primitives trained independently, and jointly by self-play (Sec. VII-B2)."""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.report import markdown as md
from knotflow.report.rates import Method, read_rates, with_extras
from knotflow.report.results import Results
from knotflow.report.searches import (
    branches_figure,
    branches_spent,
    checks,
    read_searches,
    search_table,
    select,
)
from knotflow.report.section import Claim, Figures, Judgement, NotMeasured, Section, Verdict
from knotflow.report.training import self_play
from knotflow.statistics import Interval, bootstrap, mean_difference

EXPERIMENT = "joint_finetuning"
METHODS = (
    Method("independent", "trained independently", "#56b4e9"),
    Method("joint", "finetuned jointly", "#0072b2"),
)
BY_POSTERIOR = (
    Method("independent_posterior", "independently, posterior rule", "#e69f00"),
    Method("joint_posterior", "jointly, posterior rule", "#009e73"),
)
PAPER_MEANS = (4.3, 3.4)
"""The paper's mean branches, independent and joint."""


def body(results: Results, figures: Figures) -> str | None:
    """The branches by kind of training, self-play, and the success of single actions after it."""
    searches = read_searches(results, EXPERIMENT, "primitives", with_start=False)
    if searches.empty:
        return None
    found = set(searches["method"])
    shown = [*METHODS, *(method for method in BY_POSTERIOR if method.name in found)]
    methods = with_extras(shown, list(searches["method"]))
    single = read_rates(results, EXPERIMENT, "single_actions.csv", "single_actions_per_start.csv")
    return md.join(
        "Before joint finetuning, each primitive was trained on its own actions among the eight. "
        "After it, all were trained together by self-play: they try every action from ropes that "
        "they brought into its start state themselves, and a success is worth what the critics "
        "expect of the rope it leaves. Each search starts from one of the same random ropes and "
        "may tie any of the overhand's four states along any path of its DAG. The claim is judged "
        "by trees grown by the paper's rule, which draws a node at random. The posterior rule, "
        "this library's own, expands where it expects the fewest further branches, and arranges "
        "the rope. Intervals are over starts; each kind was trained once, so they leave out how "
        "trainings differ.",
        branches_figure(figures, EXPERIMENT, searches, methods, [""], {}),
        search_table(
            ("primitives",), {(method.label,): select(searches, method.name) for method in methods}
        ),
        checks(results, EXPERIMENT),
        branches_spent(results, EXPERIMENT, "primitives"),
        self_play(results, figures, EXPERIMENT, "curves_joint.csv", "self_play"),
        f"Single actions before and after, by one spline on the unseen starts of Fig. 6, with "
        f"{single.intervals}:\n\n{single.table(METHODS)}"
        if single
        else "",
    )


def fewer_branches(results: Results) -> Judgement:
    """Sec. VII-B2: 4.3 +- 2.6 branches independently, 3.4 +- 0.6 jointly, 50 random starts."""
    searches = read_searches(results, EXPERIMENT, "primitives", with_start=False)
    base, first = (select(searches, method.name).sort_values("seed") for method in METHODS)
    if missing := [m.name for m, own in zip(METHODS, (base, first), strict=True) if own.empty]:
        raise NotMeasured(f"needs {md.listed(missing)} in {EXPERIMENT}")
    before, after = _counts(base), _counts(first)
    fewer = _difference(base, first)
    unsolved = sum(~first["solved"]) + sum(~base["solved"])
    ours = (
        f"{_mean_spread(before)} / {_mean_spread(after)} over {len(before)} and {len(after)} "
        f"starts; difference {md.estimate(fewer)}"
    )
    ours += f"; {unsolved} gave up" if unsolved else ""
    others = [select(searches, method.name).sort_values("seed") for method in BY_POSTERIOR]
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
    searches = read_searches(results, EXPERIMENT, "primitives", with_start=False)
    counts = [_counts(select(searches, method.name)) for method in METHODS]
    medians = " / ".join(md.tenths(float(np.median(own))) for own in counts)
    tenth = [np.sort(own)[-max(1, len(own) // 10) :].sum() / own.sum() for own in counts]
    shares = " / ".join(f"{100 * share:.0f} %" for share in tenth)
    others = [_counts(select(searches, method.name)) for method in BY_POSTERIOR]
    posterior = (
        ". By the posterior rule, which leaves ropes from which little succeeds, the largest trees "
        f"have {' / '.join(f'{own.max():.0f}' for own in others)} branches"
    )
    return (
        f"a few large trees dominate the means: the medians are {medians}, and the largest tenth "
        f"of the trees has {shares} of all branches{posterior if all(map(len, others)) else ''}"
    )


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


SECTION = Section(
    EXPERIMENT,
    "Joint finetuning",
    "Sec. VII-B2",
    "Branches until an overhand is tied from randomly lying ropes, with primitives trained "
    "independently and after joint finetuning.",
    body,
    claims=(
        Claim(
            "Branches from random starts, independently / jointly finetuned",
            "4.3 ± 2.6 / 3.4 ± 0.6 over 50 starts",
            "the mean significantly falls and so does the spread; partly if the mean falls",
            fewer_branches,
            few_large_trees,
        ),
    ),
)
