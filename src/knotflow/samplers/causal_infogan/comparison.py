"""Plans of Causal InfoGAN as Fig. 8 shows them, and beside samplers of splines (Sec. VII-C)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.statistics import rate_columns

PANEL_WAY_POINTS = 6

# What a method is given, what it returns, and what counts as its success.
_PLANNER = (
    "start shape and end shape",
    "rope shapes, no robot motion",
    "the projected start and end have the states of those given",
)
_SAMPLER = (
    "start shape and topological action",
    "a spline for the robot, and by simulation the rope's motion",
    "the simulated rope ends in the state of the action",
)


def panel_rows(
    row: Mapping[str, object],
    start: NDArray,
    projected_start: NDArray,
    way_points: NDArray,
    projected_end: NDArray,
    end: NDArray,
) -> pd.DataFrame:
    """One line a vertex of the shapes of a plan, some of its way points, in the order of Fig. 8."""
    few = np.unique(np.linspace(0, len(way_points) - 1, PANEL_WAY_POINTS).round().astype(int))
    way_points = way_points[few]
    roles = ["given start", "projected start", *["way point"] * len(way_points)]
    roles += ["projected end", "given end"]
    shapes = np.concatenate(
        [start[None], projected_start[None], way_points, projected_end[None], end[None]]
    )
    columns, vertices = np.indices(shapes.shape[:2])
    keys = {key: row[key] for key in ("model", "seed", "goal", "shapes", "start")}
    table = {"column": columns.ravel(), "role": np.repeat(roles, shapes.shape[1])}
    table |= {"vertex": vertices.ravel()}
    table |= {axis: shapes[..., k].ravel() for k, axis in enumerate("xyz")}
    return pd.DataFrame(table).assign(**keys)[[*keys, *table]]


def compare(plans: pd.DataFrame, outcomes: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """How often each method gets to the goal's state, on the starts that have an end shape.

    Args:
        plans: one row a plan of Causal InfoGAN.
        outcomes: method -> table (action, start, success) of a sampler on the same starts.
    """
    unseen = plans[plans["shapes"] == "unseen"]
    rows = []
    for (model, goal), own in unseen.groupby(["model", "goal"], sort=False):
        kept = (own["start_kept"] & own["end_kept"]).sum()
        starts = own["start"].nunique()
        rows.append((f"causal_infogan_{model}", goal, *_PLANNER, starts, len(own), kept))
    for method, tried in outcomes.items():
        for goal, asked in unseen.groupby("goal", sort=False):
            same = tried["start"].isin(asked["start"].unique())
            own = tried[(tried["action"] == goal) & same]
            if len(own):
                starts, hits = own["start"].nunique(), own["success"].sum()
                rows.append((method, goal, *_SAMPLER, starts, len(own), hits))
    columns = ["method", "goal", "given", "returns", "success", "starts", "trials", "successes"]
    table = pd.DataFrame(rows, columns=columns)
    return table.assign(**rate_columns(table["successes"], table["trials"]))
