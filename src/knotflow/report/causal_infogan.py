"""Causal InfoGAN: plans of rope shapes through a latent space (Sec. VII-C, Fig. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import pandas as pd
from matplotlib.figure import Figure

from knotflow.report import markdown as md
from knotflow.report.rates import ICP, IMITATION, RANDOM, REINFORCEMENT, Method, read_rates
from knotflow.report.results import NotMeasured, Results
from knotflow.report.section import Claim, Figures, Judgement, Parts, Verdict, optional
from knotflow.report.training import Line, draw_curves
from knotflow.statistics import Interval, hierarchical
from knotflow.viz.rope import draw_rope
from knotflow.viz.style import INK, MUTED, WIDTH

EXPERIMENT = "causal_infogan"
MODELS = {"single": "one action", "all": "all demonstrations"}
COLOURS = {"single": "#0072b2", "all": "#e69f00"}
LABELS = {method.name: method.label for method in (RANDOM, ICP, IMITATION, REINFORCEMENT)}
LABELS |= {f"causal_infogan_{model}": f"Causal InfoGAN, {name}" for model, name in MODELS.items()}
QUANTITIES = {
    "spread": "spread of shapes",
    "starts_covered": "demonstrated starts covered",
    "code_used": "share of the code read back",
    "distance_to_data": "distance to the data, m",
}
"""What a training is judged by."""
THIN = {"linewidth": 1.1, "alpha": 0.85}
ROPE_WIDTH = 1.5  # points

STATES = ("kept", "another", "unreadable")
"""What becomes of the topological state of a given shape when it is projected."""

MODEL = {"model": str, "seed": int}
PLANS = MODEL | dict.fromkeys(("goal", "shapes", "start", "start_state", "end_state"), str)
PLANS |= dict.fromkeys(("start_distance", "end_distance", "unevenness"), float)
TRAINING = MODEL | {"step": int, "collapsed": str} | dict.fromkeys(QUANTITIES, float)
PANEL = MODEL | {"goal": str, "shapes": str, "start": str, "column": int, "role": str}
PANEL |= {"vertex": int} | dict.fromkeys("xyz", float)


def causal_infogan(results: Results, figures: Figures) -> Parts:
    """The panels, the plans, our samplers beside them, and the trainings."""
    plans = results.table(EXPERIMENT, "plans.csv", PLANS)
    training = results.table(EXPERIMENT, "training.csv", TRAINING)
    seeds = results.table(EXPERIMENT, "seeds.csv", TRAINING)
    rates = read_rates(results, EXPERIMENT, "comparison.csv")
    methods = [Method(name, LABELS.get(name, name), "") for name in rates.methods]
    sound = {
        name: f"{len(sound_seeds(seeds, model))} of {sum(seeds['model'] == model)}"
        for model, name in MODELS.items()
    }
    return {
        "sound": " and ".join(f"{count} trainings on {name}" for name, count in sound.items()),
        "panels": _panels(results, figures),
        "plans": _plan_table(plans),
        "methods": rates.table(methods),
        "curves": _curves(figures, training),
    }


@optional
def _panels(results: Results, figures: Figures) -> str:
    """Fig. 8, by model: a row a plan, from the given start on the left to the given end."""
    key = ["model", "seed", "goal", "shapes", "start"]
    table = results.table(EXPERIMENT, "panel.csv", PANEL, (*key, "column", "vertex"))
    parts = []
    for model, rows in table.groupby("model", sort=False):
        plans = [own for _, own in rows.groupby(key, sort=False)]
        columns = 1 + rows["column"].max()
        caption = (
            f"Plans of rope shapes by a model of {MODELS[str(model)]}, the first that did not "
            f"collapse (seed {rows['seed'].iloc[0]}). Blue is the head, orange the tail. The rows "
            "are the first and the middle one of each kind of plans."
        )
        height = WIDTH / columns * (len(plans) + 0.55)
        plot = partial(_plot_panel, plans=plans, columns=columns)
        parts.append(figures.draw(f"{EXPERIMENT}_panel_{model}", caption, height, plot))
    return md.join(*parts)


def _plot_panel(figure: Figure, plans: Sequence[pd.DataFrame], columns: int) -> None:
    grid = figure.subplots(len(plans), columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for row, (line, plan) in enumerate(zip(grid, plans, strict=True)):
        low, high = plan[["x", "y"]].min().to_numpy(), plan[["x", "y"]].max().to_numpy()
        centre, reach = (low + high) / 2, 0.56 * (high - low).max()
        for axes, (_, shape) in zip(line, plan.groupby("column"), strict=False):
            axes.set_xlim(centre[0] - reach, centre[0] + reach)
            axes.set_ylim(centre[1] - reach, centre[1] + reach)
            axes.set_aspect("equal")
            thickness = ROPE_WIDTH / 72 * 2 * reach * columns / WIDTH  # points to metres
            points = shape.sort_values("vertex")[[*"xyz"]].to_numpy()
            draw_rope(axes, points, thickness, bands=6)
            if row == 0:
                role = shape["role"].iloc[0].replace(" ", "\n", 1)
                axes.set_title(role, fontsize=7.5, color=INK)
        title = f"{plan['goal'].iloc[0]}\n{plan['shapes'].iloc[0]}"
        line[0].text(
            -0.06, 0.5, title, rotation=90, ha="right", va="center", color=MUTED,
            multialignment="center", fontsize=7, transform=line[0].transAxes,
        )  # fmt: skip


def sound_seeds(seeds: pd.DataFrame, model: str) -> list[int]:
    """The seeds of a model that did not collapse."""
    return seeds["seed"][(seeds["model"] == model) & (seeds["collapsed"] == "")].tolist()


def _curves(figures: Figures, training: pd.DataFrame) -> str:
    """What the trainings are judged by, a line a seed."""
    runs = [
        (model, number, own.set_index("step"))
        for model, every in training.groupby("model", sort=False)
        for number, (_, own) in enumerate(every.groupby("seed"))
    ]
    panels = {
        title: [
            Line(own[quantity], COLOURS[model], "" if number else MODELS[model], THIN)
            for model, number, own in runs
        ]
        for quantity, title in QUANTITIES.items()
    }
    caption = (
        f"Training curves of {len(runs)} models, a line a seed. A training has collapsed if its "
        "shapes are much closer to each other than those of the data (spread), cover few of the "
        "demonstrated starts, or do not let their code be read back."
    )
    name = "causal_infogan_curves"
    return draw_curves(figures, name, caption, panels, "gradient step", legend=True)


def _plan_table(plans: pd.DataFrame) -> str:
    """A line a model, goal and kind of shapes; all seeds together, collapsed ones too."""
    rows = [
        {
            "trained on": MODELS.get(model, model),
            "goal": f"`{goal}`",
            "shapes": shapes,
            "models": str(own["seed"].nunique()),
            "starts": str(own["start"].nunique()),
            "given to projected start, mm": _millimetres(own, "start_distance"),
            "given to projected end, mm": _millimetres(own, "end_distance"),
            "start's state": _states(own, "start_state"),
            "end's state": _states(own, "end_state"),
            "unevenness": md.number(own["unevenness"].mean()),
        }
        for (model, goal, shapes), own in plans.groupby(["model", "goal", "shapes"], sort=False)
    ]
    return md.table(rows)


def _mean(plans: pd.DataFrame, values: pd.Series) -> Interval:
    """The mean with models and starts resampled."""
    return hierarchical(values, plans["seed"], plans["start"])


def _millimetres(plans: pd.DataFrame, distance: str) -> str:
    return md.estimate(_mean(plans, 1000 * plans[distance]), "{:.0f}".format)


def _states(plans: pd.DataFrame, column: str) -> str:
    """How often a given state was kept, and what else became of it."""
    kept, another, unreadable = (plans[column] == one for one in STATES)
    share = md.percent(_mean(plans, kept.astype(float)))
    return f"kept {share}<br>{another.sum()} another, {unreadable.sum()} unreadable"


def far_projections(results: Results) -> Judgement:
    """Given and projected end shapes far apart, sometimes of another topology."""
    own, radius = _sound_plans(results)
    seeds = results.table(EXPERIMENT, "seeds.csv", TRAINING)
    healthy = sound_seeds(seeds, "single")
    trained = f"{len(healthy)} of {sum(seeds['model'] == 'single')} trainings did not collapse"
    if own.empty:
        return Judgement(trained, Verdict.FAILS)
    kinds, far = [], []
    for shapes, ends in own.groupby("shapes", sort=False):
        another, unreadable = (int((ends["end_state"] == one).sum()) for one in STATES[1:])
        apart, _, limits = _millimetres(ends, "end_distance").partition(" ")
        kinds.append(
            f"{shapes} ends: {apart} mm apart{limits and f' {limits}'} on average over "
            f"{len(ends)} plans from {ends['start'].nunique()} starts, {another} of another "
            f"topology and {unreadable} that cannot be read"
        )
        far.append(_is_far(ends, radius))
    changed = bool((own["end_state"][own["shapes"] == "unseen"] == STATES[1]).any())
    return Judgement("<br>".join([*kinds, trained]), Verdict.of_two(all(far), changed))


def near_projections(results: Results) -> str:
    """Which ends are not far from their projections; '' where all are."""
    own, radius = _sound_plans(results)
    near = [str(s) for s, ends in own.groupby("shapes", sort=False) if not _is_far(ends, radius)]
    if not near:
        return ""
    paper = "; two of the paper's four rows are of training data" if "training" in near else ""
    return (
        f"the projections of {md.listed(near)} ends are not significantly farther than a rope's "
        f"diameter, {2000 * radius:.0f} mm{paper}"
    )


def _sound_plans(results: Results) -> tuple[pd.DataFrame, float]:
    """Plans by models of one action that did not collapse, and the rope's radius, metres."""
    plans = results.table(EXPERIMENT, "plans.csv", PLANS)
    healthy = sound_seeds(results.table(EXPERIMENT, "seeds.csv", TRAINING), "single")
    radius = results.setting(EXPERIMENT, "radius")
    if not radius:
        raise NotMeasured(f"needs the rope's radius in config.yaml of {EXPERIMENT}")
    return plans[(plans["model"] == "single") & plans["seed"].isin(healthy)], float(radius)


def _is_far(ends: pd.DataFrame, radius: float) -> bool:
    """Whether ends are projected significantly more than a rope's diameter away."""
    return _mean(ends, ends["end_distance"]).lies_above(2 * radius)


CLAIMS = (
    Claim(
        "Causal InfoGAN",
        "given and projected end shapes are far apart, sometimes of another topology",
        "models of C(0,1,1) that did not collapse project ends of the training data and unseen "
        "ones significantly more than a rope's diameter away, and at least one unseen end to "
        "another state (one that cannot be read is none); partly if one of the two conditions "
        "holds",
        far_projections,
        near_projections,
    ),
)
