"""Causal InfoGAN: plans of rope shapes through a latent space (Sec. VII-C, Fig. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.intervals import Interval, wilson
from knotflow.report.claims import Claim, Judgement, NotMeasured, Verdict
from knotflow.report.paper import SINGLE_STAGE
from knotflow.report.results import (
    AMOUNT,
    AT_LEAST_ONE,
    COUNT,
    FLAG,
    NOTE,
    NUMBER,
    TEXT,
    Column,
    Results,
    ResultsError,
    refuse,
)
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import bootstrap
from knotflow.report.style import INK, MUTED, WIDTH, Picture, bare_axis, new_figure, render, styled
from knotflow.report.tables import NOTHING, markdown_table, number, percent
from knotflow.viz.rope import draw_rope

EXPERIMENT = "causal_infogan"
MODELS = {"single": "single action", "all": "all demonstrations"}
COLOURS = {"single": "#0072b2", "all": "#e69f00"}
LABELS = {
    **{method.name: method.label for method in SINGLE_STAGE},
    **{f"causal_infogan_{model}": f"Causal InfoGAN, {name}" for model, name in MODELS.items()},
}
#: What a training is judged by.
QUANTITIES = {
    "spread": "spread of shapes",
    "starts_covered": "demonstrated starts covered",
    "code_used": "share of the code read back",
    "distance_to_data": "distance to the data, mm",
}
#: The least that each may end at.
LEAST = {"spread": 0.5, "starts_covered": 0.5, "code_used": 0.25}
ROPE_WIDTH = 1.5  # points

MODEL = {"model": TEXT, "seed": COUNT}
PLANS = MODEL | {"goal": TEXT, "shapes": TEXT, "start_kept": FLAG, "end_kept": FLAG}
PLANS |= dict.fromkeys(("start_distance", "end_distance", "unevenness", "largest_stretch"), AMOUNT)
TRAINING = MODEL | {"step": COUNT, "spread": AMOUNT, "starts_covered": AMOUNT, "collapsed": NOTE}
TRAINING |= {"code_used": Column("number", high=1), "distance_to_data": AMOUNT}
METHODS = dict.fromkeys(("method", "goal", "given", "returns", "success"), TEXT)
METHODS |= {"starts": COUNT, "trials": AT_LEAST_ONE, "successes": COUNT}
PANEL = MODEL | {"goal": TEXT, "shapes": TEXT, "start": TEXT, "column": COUNT, "role": TEXT}
PANEL |= {"vertex": COUNT, "x": NUMBER, "y": NUMBER, "z": NUMBER}


@dataclass(frozen=True)
class PanelRow:
    """One row of Fig. 8: the shapes (columns, V, 3) of a plan, metres, and what each is."""

    model: str
    seed: int
    goal: str
    shapes: str
    roles: tuple[str, ...]
    points: NDArray[np.float64]


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The panel, the curves, and the tables of trainings, plans and methods."""
    plans = results.table(EXPERIMENT, "plans.csv", PLANS)
    rows = read_panel(results)
    training = results.table(EXPERIMENT, "training.csv", TRAINING)
    seeds = results.table(EXPERIMENT, "seeds.csv", TRAINING)
    methods = results.table(EXPERIMENT, "comparison.csv", METHODS)
    if plans is None or not rows or training is None or seeds is None or methods is None:
        return None
    many = methods["successes"] > methods["trials"]
    refuse(methods, "successes", many, "{successes} of only {trials} trials")
    of_single = [row for row in rows if row.model == "single"]
    of_all = [row for row in rows if row.model == "all"]
    return {
        "panel": pictures.add(panel(of_single, "causal_infogan_panel")),
        "panel_seed": of_single[0].seed,
        "panel_all": pictures.add(panel(of_all, "causal_infogan_panel_all")) if of_all else "",
        "curves": pictures.add(curves(training, "causal_infogan_curves")),
        "healthy": {model: len(sound(seeds, model)) for model in MODELS},
        "trained": {model: sum(seeds["model"] == model) for model in MODELS},
        "seeds": _seed_table(seeds),
        "plans": _plan_table(plans),
        "comparison": _method_table(methods),
        "terms": _terms_table(methods),
    }


def read_panel(results: Results) -> list[PanelRow]:
    """panel.csv, a row a vertex; shapes of a plan have equally many. Empty before a run."""
    table = results.table(EXPERIMENT, "panel.csv", PANEL)
    if table is None:
        return []
    found = []
    keys = ["model", "seed", "goal", "shapes", "start"]
    for (model, seed, goal, shapes, _), own in table.groupby(keys, sort=False):
        columns, vertices = 1 + own["column"].max(), 1 + own["vertex"].max()
        points = np.full((columns, vertices, 3), np.nan)
        points[own["column"], own["vertex"]] = own[["x", "y", "z"]]
        if np.isnan(points).any():
            column, vertex = np.argwhere(np.isnan(points))[0][:2]
            raise ResultsError(
                f"{table.attrs['path']}, column 'vertex', row {own.index[0]}: column {column} of "
                f"the plan that begins here has no vertex {vertex}"
            )
        roles = tuple(own.drop_duplicates("column").sort_values("column")["role"])
        found.append(PanelRow(str(model), int(seed), str(goal), str(shapes), roles, points))
    return found


def sound(seeds: pd.DataFrame, model: str) -> list[int]:
    """The seeds of a model that did not collapse."""
    return seeds["seed"][(seeds["model"] == model) & (seeds["collapsed"] == "")].tolist()


def panel(rows: Sequence[PanelRow], name: str) -> Picture:
    """Fig. 8: a row a plan; given, projected, way points, projected, given, from left to right."""
    columns = max(len(row.roles) for row in rows)
    with styled():
        figure = new_figure(WIDTH / columns * (len(rows) + 0.55))
        grid = figure.subplots(len(rows), columns, squeeze=False)
        for axes in grid.flat:
            axes.set_axis_off()
        for line, row in zip(grid, rows, strict=True):
            flat = row.points[..., :2].reshape(-1, 2)
            centre = (flat.max(axis=0) + flat.min(axis=0)) / 2
            reach = 1.12 * np.abs(flat - centre).max()
            for axes, points in zip(line, row.points, strict=False):
                axes.set_xlim(centre[0] - reach, centre[0] + reach)
                axes.set_ylim(centre[1] - reach, centre[1] + reach)
                axes.set_aspect("equal")
                thickness = ROPE_WIDTH / 72 * 2 * reach * columns / WIDTH  # points to metres
                draw_rope(axes, points, thickness, bands=6)
            line[0].text(
                -0.06,
                0.5,
                f"{row.goal}\n{row.shapes}",
                rotation=90,
                ha="right",
                va="center",
                multialignment="center",
                fontsize=7,
                color=MUTED,
                transform=line[0].transAxes,
            )
        for axes, role in zip(grid[0], rows[0].roles, strict=False):
            axes.set_title(role.replace(" ", "\n", 1), fontsize=7.5, color=INK)
        alt = f"Plans of rope shapes by Causal InfoGAN: {len(rows)} rows, {columns} shapes each"
        return render(figure, name, alt)


def curves(training: pd.DataFrame, name: str) -> Picture:
    """Training curves, a line a seed; below the dotted line at the end a training has collapsed."""
    with styled():
        figure = new_figure(2.5)
        for axes, quantity in zip(figure.subplots(1, len(QUANTITIES)), QUANTITIES, strict=True):
            scale = 1000 if quantity == "distance_to_data" else 1
            named: set[str] = set()
            for (model, _), line in training.groupby(["model", "seed"], sort=False):
                axes.plot(
                    line["step"],
                    scale * line[quantity],
                    color=COLOURS[model],
                    linewidth=1.1,
                    alpha=0.85,
                    label=None if model in named else MODELS[model],
                )
                named.add(model)
            if quantity in LEAST:
                axes.axhline(LEAST[quantity], color=INK, linewidth=0.8, linestyle=":")
                axes.set_ylim(0, max(1.15, axes.get_ylim()[1]))
            else:
                axes.set_ylim(0, None)
            axes.set_title(QUANTITIES[quantity], fontsize=8.5, color=INK)
            axes.set_xlabel("gradient steps")
            axes.tick_params(axis="x", labelsize=7)
            axes.locator_params(axis="x", nbins=4)
            bare_axis(axes, grid="y")
        figure.axes[0].legend(frameon=False, fontsize=7.5, loc="lower right")
        models = len(training.groupby(["model", "seed"]))
        return render(figure, name, f"Training curves of {models} Causal InfoGAN models")


def _seed_table(seeds: pd.DataFrame) -> str:
    header = ["trained on", "seed", *QUANTITIES.values(), "verdict"]
    lines = [
        [
            MODELS.get(one.model, one.model),
            str(one.seed),
            number(one.spread),
            number(one.starts_covered),
            number(one.code_used),
            f"{1000 * one.distance_to_data:.0f}",
            f"collapsed: {one.collapsed.replace(' ', ', ')}" if one.collapsed else "sound",
        ]
        for one in seeds.itertuples()
    ]
    return markdown_table(header, lines, "lrrrrrl")


def _plan_table(plans: pd.DataFrame) -> str:
    """A line a model, goal and kind of shapes; all seeds together, collapsed ones too."""
    header = ["trained on", "goal", "shapes", "plans", "given to projected start, mm"]
    header += ["given to projected end, mm", "start's state kept", "end's state kept"]
    header += ["unevenness", "largest stretch"]
    lines = [
        [
            MODELS.get(model, model),
            f"`{goal}`",
            shapes,
            str(len(own)),
            _millimetres(bootstrap(1000 * own["start_distance"])),
            _millimetres(bootstrap(1000 * own["end_distance"])),
            f"{100 * own['start_kept'].mean():.0f} %",
            f"{100 * own['end_kept'].mean():.0f} %",
            number(own["unevenness"].mean()),
            f"{100 * own['largest_stretch'].max():.1f} %",
        ]
        for (model, goal, shapes), own in plans.groupby(["model", "goal", "shapes"], sort=False)
    ]
    return markdown_table(header, lines, "lllrrrrrrr")


def _method_table(methods: pd.DataFrame) -> str:
    """A line a goal, a column a method."""
    names = list(dict.fromkeys(methods["method"]))
    lines = []
    for goal, own in methods.groupby("goal", sort=False):
        rates = {
            row.method: f"{percent(wilson(row.successes, row.trials))}<br>"
            f"{row.successes:,} of {row.trials:,}"
            for row in own.itertuples()
        }
        cells = [rates.get(name, NOTHING) for name in names]
        lines.append([f"`{goal}`", str(own["starts"].iloc[0]), *cells])
    header = ["goal", "starts", *map(_label, names)]
    return markdown_table(header, lines, "l" + "r" * (1 + len(names)))


def _terms_table(methods: pd.DataFrame) -> str:
    """What methods are given, what they return, and what their success is: a line a kind."""
    kinds = methods.groupby(["given", "returns", "success"], sort=False)["method"].unique()
    lines = [["<br>".join(map(_label, own)), *kind] for kind, own in kinds.items()]
    return markdown_table(["method", "given", "returns", "success is that"], lines)


def _label(method: str) -> str:
    return LABELS.get(method, method.replace("_", " "))


def _millimetres(mean: Interval) -> str:
    if mean.low is None or mean.high is None:
        return f"{mean.estimate:.0f}"
    return f"{mean.estimate:.0f} ({mean.low:.0f} to {mean.high:.0f})"


def far_projections(results: Results) -> Judgement:
    """Given and projected end shapes far apart, sometimes of another topology."""
    plans = results.table(EXPERIMENT, "plans.csv", PLANS)
    seeds = results.table(EXPERIMENT, "seeds.csv", TRAINING)
    ropes = results.experiments[EXPERIMENT].ropes if plans is not None else []
    if plans is None or seeds is None or not ropes:
        raise NotMeasured(f"needs plans.csv, seeds.csv and config.yaml in {EXPERIMENT}")
    healthy = sound(seeds, "single")
    trained = f"{len(healthy)} of {sum(seeds['model'] == 'single')} trainings did not collapse"
    unseen = (plans["model"] == "single") & (plans["shapes"] == "unseen")
    own = plans[unseen & plans["seed"].isin(healthy)]
    if own.empty:
        return Judgement(trained, Verdict.FAILS)
    distance = bootstrap(1000 * own["end_distance"])
    other = int((~own["end_kept"]).sum())
    apart, _, limits = _millimetres(distance).partition(" ")
    ours = (
        f"{apart} mm apart{limits and f' {limits}'} on the average of {len(own)} plans, "
        f"{other} projected ends of another topology; {trained}"
    )
    far = distance.lies_above(2000 * ropes[0]["radius"])
    verdicts = {2: Verdict.HOLDS, 1: Verdict.PARTLY, 0: Verdict.FAILS}
    return Judgement(ours, verdicts[far + (other > 0)])


SECTION = Section(
    EXPERIMENT,
    "Causal InfoGAN",
    "Sec. VII-C, Fig. 8",
    "Plans of rope shapes through a latent space, from a given start to a given end shape that is "
    "known to be reachable. Projected is the generated shape nearest to a given one.",
    values,
    claims=(
        Claim(
            statement="Causal InfoGAN",
            where="Sec. VII-C, Fig. 8",
            paper="given and projected end shapes are far apart, sometimes of another topology",
            criterion="models of C(0,1,1) that did not collapse project unseen ends significantly "
            "more than a rope's diameter away, and at least one to another state; partly if one "
            "of the two",
            judge=far_projections,
        ),
    ),
)
