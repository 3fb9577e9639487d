"""What the tables of the experiment causal_infogan hold, checked as they are read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.report.rows import Row, require

SINGLE = "single"
ALL = "all"
MODELS = {SINGLE: "single action", ALL: "all demonstrations"}
#: What a training is judged by, and the least that each may end at.
CURVES = {"spread": 0.5, "starts_covered": 0.5, "code_used": 0.25}
UNSEEN = "unseen"


@dataclass(frozen=True)
class Plan:
    """One plan of rope shapes; distances in metres."""

    model: str
    seed: int
    goal: str
    shapes: str
    start_distance: float
    end_distance: float
    start_kept: bool
    end_kept: bool
    unevenness: float
    largest_stretch: float


@dataclass(frozen=True)
class Training:
    """A point of the training curves."""

    model: str
    seed: int
    step: int
    spread: float
    starts_covered: float
    code_used: float
    distance_to_data: float
    collapsed: str


@dataclass(frozen=True)
class Comparison:
    """What a method is given and returns, and how often it gets to the goal's state."""

    method: str
    goal: str
    given: str
    returns: str
    success: str
    starts: int
    trials: int
    successes: int


@dataclass(frozen=True)
class PanelRow:
    """One row of Fig. 8: the shapes (columns, V, 3) of a plan, metres, and what each is."""

    model: str
    seed: int
    goal: str
    shapes: str
    roles: tuple[str, ...]
    points: NDArray[np.float64]


def read_plans(rows: list[Row]) -> list[Plan]:
    """plans.csv."""
    numbers = ("start_distance", "end_distance", "unevenness", "largest_stretch")
    require(rows, ("model", "seed", "goal", "shapes", "start_kept", "end_kept", *numbers))
    return [
        Plan(
            model=row.text("model"),
            seed=row.count("seed"),
            goal=row.text("goal"),
            shapes=row.text("shapes"),
            start_kept=row.flag("start_kept"),
            end_kept=row.flag("end_kept"),
            **{name: row.number_in(name, 0) for name in numbers},
        )
        for row in rows
    ]


def read_training(rows: list[Row]) -> list[Training]:
    """training.csv, or the ends of its curves: seeds.csv."""
    require(rows, ("model", "seed", "step", *CURVES, "distance_to_data", "collapsed"))
    return [
        Training(
            model=row.text("model"),
            seed=row.count("seed"),
            step=row.count("step"),
            spread=row.number_in("spread", 0),
            starts_covered=row.number_in("starts_covered", 0),
            code_used=row.number_in("code_used", -np.inf, 1),
            distance_to_data=row.number_in("distance_to_data", 0),
            collapsed=row.text("collapsed"),
        )
        for row in rows
    ]


def read_comparison(rows: list[Row]) -> list[Comparison]:
    """comparison.csv."""
    texts = ("method", "goal", "given", "returns", "success")
    require(rows, (*texts, "starts", "trials", "successes"))
    found = []
    for row in rows:
        trials, successes = row.count("trials", at_least=1), row.count("successes")
        if successes > trials:
            raise row.error("successes", f"{successes} of only {trials} trials")
        told = {name: row.text(name) for name in texts}
        found.append(
            Comparison(**told, starts=row.count("starts"), trials=trials, successes=successes)
        )
    return found


def read_panel(rows: list[Row]) -> list[PanelRow]:
    """panel.csv: one line a vertex; every shape of a row has the same vertices."""
    keys = ("model", "seed", "goal", "shapes", "start")
    require(rows, (*keys, "column", "role", "vertex", "x", "y", "z"))
    grouped: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        grouped.setdefault(tuple(row.text(key) for key in keys), []).append(row)
    found = []
    for (model, seed, goal, shapes, _), own in grouped.items():
        columns = 1 + max(row.count("column") for row in own)
        vertices = 1 + max(row.count("vertex") for row in own)
        points, roles = np.full((columns, vertices, 3), np.nan), [""] * columns
        for row in own:
            column = row.count("column")
            roles[column] = row.text("role")
            points[column, row.count("vertex")] = [row.number_in(k, -np.inf) for k in "xyz"]
        if np.isnan(points).any():
            column, vertex = np.argwhere(np.isnan(points))[0][:2]
            raise own[0].error("vertex", f"column {column} of this row has no vertex {vertex}")
        found.append(PanelRow(model, int(seed), goal, shapes, tuple(roles), points))
    return found
