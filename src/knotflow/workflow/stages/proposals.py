"""Stage `proposals`: what a method proposed on a few unseen ropes, small enough to be committed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.recording import load
from knotflow.samplers.demonstrations import TASKS
from knotflow.workflow.context import StageContext
from knotflow.workflow.stage import stage
from knotflow.workflow.stages.starts import load_starts

BEFORE, SPLINE, AFTER = "before", "spline", "after"
COLUMNS = ("action", "start", "what", "proposal", "outcome", "point", "x", "y", "z")


@dataclass
class ProposalsConfig:
    """How much is shown."""

    ropes: int = 3
    """Starts of each action: the first ones of the evaluation, so that none is chosen by how it
    looks."""
    splines: int = 6
    """Proposed splines of each start, the first ones again."""

    def __post_init__(self) -> None:
        """Refuses to show nothing.

        Raises:
            ValueError: there would be no rope, or no spline.
        """
        for name in ("ropes", "splines"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, must be at least 1")


@stage("proposals", inputs=("starts", "evaluation"))
def propose(config: ProposalsConfig, inputs: Mapping[str, Path], context: StageContext) -> None:
    """Makes proposals.csv from the recordings of an evaluation; nothing is simulated again.

    A row a point in metres, world frame: of the rope before (`before`, a point a vertex, head
    first), of each proposed spline (`spline`, its three control points), and of the rope after the
    first of them (`after`). `proposal` counts the splines of a rope from 0, and `outcome` is that
    of the spline; both are empty for the rope before.

    Raises:
        ValueError: the evaluation recorded no spline for one of the starts to be shown.
    """
    tables = []
    for task in context.progress(TASKS, desc="proposals"):
        starts = load_starts(inputs["starts"], task)
        rollouts = load(
            inputs["evaluation"] / "recordings" / f"{task.name}.mcap", trajectories=True
        ).sort_values("number")
        owner = np.array([int(extra["start"]) for extra in rollouts["extra"]])
        for start, points in enumerate(starts[: config.ropes]):
            own = rollouts[owner == start].head(config.splines)
            if own.empty:
                raise ValueError(
                    f"the evaluation has no rollout of {task.action} from start {start}; starts "
                    "and evaluation must belong together"
                )
            head = {"action": str(task.action), "start": start}
            tables.append(point_rows(points, what=BEFORE, proposal="", outcome="", **head))
            for proposal, row in enumerate(own.itertuples()):
                facts = head | {"proposal": proposal, "outcome": row.outcome}
                tables.append(point_rows(row.control_points, what=SPLINE, **facts))
                if proposal == 0 and np.isfinite(row.points[-1]).all():  # not where it blew up
                    tables.append(point_rows(row.points[-1], what=AFTER, **facts))
    table = pd.concat(tables, ignore_index=True)[list(COLUMNS)]
    with context.atomic("proposals.csv") as path:
        table.to_csv(path, index=False, float_format="%.3f")


def point_rows(points: NDArray, **facts: object) -> pd.DataFrame:
    """A row for each of points (P, 3), with `facts` in every one."""
    x, y, z = np.asarray(points, float).T
    return pd.DataFrame({**facts, "point": np.arange(len(x)), "x": x, "y": y, "z": z})
