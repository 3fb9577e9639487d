"""Causal InfoGAN: plans of rope shapes through a latent space (Sec. VII-C, Fig. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from knotflow.report import tables
from knotflow.report.causal_infogan import figures
from knotflow.report.causal_infogan.judge import EXPERIMENT, sound
from knotflow.report.causal_infogan.records import (
    ALL,
    MODELS,
    SINGLE,
    Comparison,
    Plan,
    Training,
    read_comparison,
    read_panel,
    read_plans,
    read_training,
)
from knotflow.report.paper import SINGLE_STAGE
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section
from knotflow.report.statistics import bootstrap, wilson

LABELS = {
    **{arm.name: arm.label for arm in SINGLE_STAGE},
    **{f"causal_infogan_{model}": f"Causal InfoGAN, {told}" for model, told in MODELS.items()},
}


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The panel, the curves, and the tables of trainings, plans and methods."""
    names = ("plans.csv", "panel.csv", "training.csv", "seeds.csv", "comparison.csv")
    found = {name: results.table(EXPERIMENT, name) for name in names}
    plans, panel, training, seeds, comparison = (found[name] for name in names)
    if not (plans and panel and training and seeds and comparison):
        return None
    ends, rows = read_training(seeds), read_panel(panel)
    of_single = [row for row in rows if row.model == SINGLE]
    of_all = [row for row in rows if row.model == ALL]
    healthy = {model: sound(ends, model) for model in MODELS}
    return {
        "panel": pictures.add(figures.panel(of_single, "causal_infogan_panel")),
        "panel_seed": of_single[0].seed,
        "panel_all": pictures.add(figures.panel(of_all, "causal_infogan_panel_all"))
        if of_all
        else "",
        "curves": pictures.add(figures.curves(read_training(training), "causal_infogan_curves")),
        "healthy": {model: len(good) for model, (good, _) in healthy.items()},
        "trained": {model: count for model, (_, count) in healthy.items()},
        "seeds": _seed_table(ends),
        "plans": _plan_table(read_plans(plans)),
        "comparison": _comparison_table(read_comparison(comparison)),
    }


def _seed_table(ends: Sequence[Training]) -> str:
    header = ["trained on", "seed", *figures.NAMES.values(), "verdict"]
    lines = [
        [
            MODELS.get(one.model, one.model),
            str(one.seed),
            tables.number(one.spread),
            tables.number(one.starts_covered),
            tables.number(one.code_used),
            f"{1000 * one.distance_to_data:.0f}",
            f"collapsed: {one.collapsed.replace(' ', ', ')}" if one.collapsed else "sound",
        ]
        for one in ends
    ]
    return tables.markdown_table(header, lines, "lrrrrrl")


def _plan_table(plans: Sequence[Plan]) -> str:
    """A line a model, goal and kind of shapes; all seeds together, collapsed ones too."""
    header = ["trained on", "goal", "shapes", "plans", "given to projected start, mm"]
    header += ["given to projected end, mm", "start's state kept", "end's state kept"]
    header += ["unevenness", "largest stretch"]
    grouped: dict[tuple[str, str, str], list[Plan]] = {}
    for plan in plans:
        grouped.setdefault((plan.model, plan.goal, plan.shapes), []).append(plan)
    lines = [
        [
            MODELS.get(model, model),
            f"`{goal}`",
            shapes,
            str(len(own)),
            _millimetres([plan.start_distance for plan in own]),
            _millimetres([plan.end_distance for plan in own]),
            _share([plan.start_kept for plan in own]),
            _share([plan.end_kept for plan in own]),
            tables.number(float(np.mean([plan.unevenness for plan in own]))),
            f"{100 * max(plan.largest_stretch for plan in own):.1f} %",
        ]
        for (model, goal, shapes), own in grouped.items()
    ]
    return tables.markdown_table(header, lines, "lllrrrrrrr")


def _comparison_table(rows: Sequence[Comparison]) -> str:
    header = ["goal", "method", "given", "returns", "success is that", "starts", "success"]
    lines = [
        [
            f"`{row.goal}`",
            LABELS.get(row.method, row.method.replace("_", " ")),
            row.given,
            row.returns,
            row.success,
            str(row.starts),
            f"{tables.percent(wilson(row.successes, row.trials))}<br>"
            f"{row.successes:,} of {row.trials:,}",
        ]
        for goal in dict.fromkeys(row.goal for row in rows)
        for row in rows
        if row.goal == goal
    ]
    return tables.markdown_table(header, lines, "lllllrr")


def _millimetres(distances: Sequence[float]) -> str:
    mean = bootstrap([1000 * distance for distance in distances])
    if mean.low is None or mean.high is None:
        return f"{mean.estimate:.0f}"
    return f"{mean.estimate:.0f} ({mean.low:.0f} to {mean.high:.0f})"


def _share(flags: Sequence[bool]) -> str:
    return f"{100 * sum(flags) / len(flags):.0f} %"


SECTION = Section(
    EXPERIMENT,
    "Causal InfoGAN",
    "Sec. VII-C, Fig. 8",
    "Plans of rope shapes through a latent space, from a given start to a given end shape that is "
    "known to be reachable. Projected is the generated shape nearest to a given one.",
    values,
)
