"""Primitives trained independently, and together by self-play (Sec. VII-B2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from knotflow.intervals import Interval
from knotflow.report.claims import Claim, Judgement, NotMeasured, Verdict
from knotflow.report.learning import read_curves
from knotflow.report.paper import BY_POSTERIOR, JOINT, OVERHAND_LIMIT, with_extras
from knotflow.report.rates import rate_table, read_rates
from knotflow.report.results import Results
from knotflow.report.searches import branches, confirmation, of, read_searches, search_table, spent
from knotflow.report.section import Pictures, Section
from knotflow.report.self_play import self_play, trials
from knotflow.report.statistics import bootstrap, mean_difference
from knotflow.report.tables import estimate, listed, tenths

EXPERIMENT = "joint_finetuning"
#: The paper's mean branches, independent and joint.
PAPER_MEANS = (4.3, 3.4)


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure, a line for each kind of training, and what became of single actions."""
    searches = read_searches(results, EXPERIMENT, "primitives", with_start=False)
    if searches is None:
        return None
    found = list(searches["method"])
    methods = with_extras(JOINT, found)
    groups = [((method.label,), of(searches, method.name)) for method in methods]
    curves = read_curves(results, EXPERIMENT, "curves_joint.csv")
    single = read_rates(results, EXPERIMENT, "single_actions.csv", "single_actions_per_start.csv")
    return {
        "trials": trials(results, EXPERIMENT),
        "self_play": pictures.add(self_play(curves, "self_play")) if curves else "",
        "single": rate_table(single, JOINT) if single else "",
        "intervals": single.intervals if single else "",
        "figure": pictures.add(branches(searches, methods, [""], EXPERIMENT, {})),
        "table": search_table(("primitives",), [line for line in groups if len(line[1])]),
        "missing": listed([method.label for method in methods if method.name not in found]),
        "limit": OVERHAND_LIMIT,
        "unsolved": sum(~searches["solved"]),
        "confirmation": confirmation(results, EXPERIMENT, searches),
        "spent": spent(results, EXPERIMENT, "primitives"),
    }


def fewer_branches(results: Results) -> Judgement:
    """Sec. VII-B2: 4.3 +- 2.6 branches independently, 3.4 +- 0.6 jointly, 50 random starts."""
    searches = read_searches(results, EXPERIMENT, "primitives", with_start=False)
    methods = {
        method: of(searches, method).sort_values("seed") for method in ("independent", "joint")
    }
    missing = [method for method, own in methods.items() if own.empty]
    if missing:
        raise NotMeasured(f"needs {listed(missing)} in {EXPERIMENT}")
    base, first = methods.values()
    before, after = (own["branches"].to_numpy(float) for own in (base, first))
    fewer = _fewer(base, first)
    unsolved = sum(~first["solved"]) + sum(~base["solved"])
    ours = (
        f"{_mean_spread(before)} / {_mean_spread(after)} over {len(before)} and "
        f"{len(after)} starts; difference {estimate(fewer)}"
        + (f"; {unsolved} gave up" if unsolved else "")
    )
    others = [of(searches, method.name).sort_values("seed") for method in BY_POSTERIOR]
    if not any(own.empty for own in others):
        spreads = " / ".join(_mean_spread(own["branches"].to_numpy(float)) for own in others)
        ours += f"; by the posterior rule {spreads}, difference {estimate(_fewer(*others))}"
    if fewer.estimate >= 0:
        return Judgement(ours, Verdict.FAILS)
    sure = fewer.high is not None and fewer.high < 0
    narrower = np.std(after) < np.std(before)
    means = [bootstrap(counts) for counts in (before, after)]
    outside = any(
        mean.lies_above(paper) or not mean.reaches(paper)
        for mean, paper in zip(means, PAPER_MEANS, strict=True)
    )
    words = f"means of {estimate(means[0])} and {estimate(means[1])} branches"
    size = words if sure and outside else ""
    return Judgement(ours, Verdict.HOLDS if sure and narrower else Verdict.PARTLY, size)


def few_large_trees(results: Results) -> str:
    """How much of all branches the largest trees have, and trees of the posterior rule."""
    searches = read_searches(results, EXPERIMENT, "primitives", with_start=False)
    counts = {
        name: of(searches, name)["branches"].to_numpy(float) for name in ("independent", "joint")
    }
    medians = " / ".join(tenths(float(np.median(own))) for own in counts.values())
    largest = {name: np.sort(own)[-max(1, len(own) // 10) :] for name, own in counts.items()}
    shares = " / ".join(
        f"{100 * largest[name].sum() / own.sum():.0f} %" for name, own in counts.items()
    )
    words = (
        f"the means are those of few large trees: the medians are {medians}, and the largest tenth "
        f"of the trees has {shares} of all branches"
    )
    others = [of(searches, method.name)["branches"].to_numpy(float) for method in BY_POSTERIOR]
    if any(len(own) == 0 for own in others):
        return words
    most = " / ".join(f"{own.max():.0f}" for own in others)
    return (
        f"{words}. The paper's rule draws nodes at random and returns to ropes from which little "
        f"succeeds; by the posterior rule, which leaves them, the largest trees have {most} "
        "branches with the same primitives from the same ropes"
    )


def _fewer(base: pd.DataFrame, first: pd.DataFrame) -> Interval:
    """Branches of `first` less those of `base`. The same seed is the same start: with all seeds on
    both sides the pairs are resampled."""
    paired = first["seed"].tolist() == base["seed"].tolist()
    before, after = (own["branches"].to_numpy(float) for own in (base, first))
    return mean_difference(after, before, paired=paired)


def _mean_spread(counts: np.ndarray) -> str:
    spread = tenths(float(np.std(counts, ddof=1))) if len(counts) > 1 else "?"
    return f"{tenths(float(np.mean(counts)))} ± {spread}"


SECTION = Section(
    EXPERIMENT,
    "Joint finetuning",
    "Sec. VII-B2",
    "Branches until an overhand is tied, from randomly lying ropes: with the primitives as each "
    "was trained by itself, and after they went on learning together.",
    values,
    claims=(
        Claim(
            statement="Branches from random starts, independently / jointly finetuned",
            where="Sec. VII-B2",
            paper="4.3 ± 2.6 / 3.4 ± 0.6 over 50 starts",
            criterion="the mean significantly falls and so does the spread; partly if the mean "
            "falls",
            judge=fewer_branches,
            reason=few_large_trees,
        ),
    ),
)
