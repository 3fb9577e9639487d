"""The verdict on the paper's claim about Causal InfoGAN."""

from __future__ import annotations

from collections.abc import Sequence

from knotflow.report.causal_infogan.records import (
    SINGLE,
    UNSEEN,
    Plan,
    Training,
    read_plans,
    read_training,
)
from knotflow.report.results import Results
from knotflow.report.statistics import bootstrap
from knotflow.report.verdict import NotMeasured, Outcome, Verdict

EXPERIMENT = "causal_infogan"


def far_projections(results: Results) -> Outcome:
    """Sec. VII-C: given and projected end shapes far apart, sometimes of another topology."""
    plans, seeds = results.table(EXPERIMENT, "plans.csv"), results.table(EXPERIMENT, "seeds.csv")
    ropes = results.experiments[EXPERIMENT].ropes if plans else []
    if not plans or not seeds or not ropes:
        raise NotMeasured(f"needs plans.csv, seeds.csv and config.yaml in {EXPERIMENT}")
    healthy, trained = sound(read_training(seeds), SINGLE)
    told = f"{len(healthy)} of {trained} trainings did not collapse"
    own = of_seeds(read_plans(plans), SINGLE, healthy)
    if not own:
        return Outcome(told, Verdict.FAILS)
    distance = bootstrap([plan.end_distance for plan in own])
    other = sum(not plan.end_kept for plan in own)
    limits = (
        ""
        if distance.low is None or distance.high is None
        else (f" ({1000 * distance.low:.0f} to {1000 * distance.high:.0f})")
    )
    ours = (
        f"{1000 * distance.estimate:.0f} mm apart{limits} on the average of {len(own)} plans, "
        f"{other} projected ends of another topology; {told}"
    )
    far = distance.lies_above(2 * ropes[0]["radius"])
    verdicts = {2: Verdict.HOLDS, 1: Verdict.PARTLY, 0: Verdict.FAILS}
    return Outcome(ours, verdicts[far + (other > 0)])


def sound(seeds: Sequence[Training], model: str) -> tuple[list[int], int]:
    """The seeds of a model that did not collapse, and how many were trained."""
    own = [one for one in seeds if one.model == model]
    return [one.seed for one in own if not one.collapsed], len(own)


def of_seeds(plans: Sequence[Plan], model: str, seeds: Sequence[int]) -> list[Plan]:
    """A model's plans from unseen starts, of some seeds."""
    return [p for p in plans if p.model == model and p.shapes == UNSEEN and p.seed in seeds]
