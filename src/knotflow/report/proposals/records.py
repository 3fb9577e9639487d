"""What proposals.csv holds, checked as it is read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from knotflow.report.results import COUNT, NOTE, NUMBER, TEXT, Results, refuse

PARTS = ("before", "spline", "after")
OUTCOMES = ("success", "failure", "diverged")


@dataclass(frozen=True)
class Proposed:
    """A proposed spline: its three control points (3, 3), metres, and what came of it."""

    controls: NDArray[np.float64]
    outcome: str

    @property
    def succeeded(self) -> bool:
        """Whether the rope ended in the state that the action leads to."""
        return self.outcome == "success"


@dataclass(frozen=True)
class Rope:
    """An unseen rope (V, 3), metres, and what was proposed for it.

    `after` (V, 3) is where the first of the splines led, None where its simulation blew up.
    """

    action: str
    start: int
    before: NDArray[np.float64]
    splines: tuple[Proposed, ...]
    after: NDArray[np.float64] | None


def read_proposals(results: Results, experiment: str, name: str = "proposals.csv") -> list[Rope]:
    """proposals.csv or a table like it, a row a point; empty where it is not there.

    Raises:
        ResultsError: a point is missing, a rope has no spline, or a word is none of those known.
    """
    columns = {"action": TEXT, "start": COUNT, "what": TEXT, "proposal": NOTE, "outcome": NOTE}
    columns |= {"point": COUNT, "x": NUMBER, "y": NUMBER, "z": NUMBER}
    table = results.table(experiment, name, columns)
    if table is None:
        return []
    unknown = ~table["what"].isin(PARTS)
    refuse(table, "what", unknown, f"'{{what}}' is none of {', '.join(PARTS)}")
    spline = table["what"] == "spline"
    unknown = spline & ~table["outcome"].isin(OUTCOMES)
    refuse(table, "outcome", unknown, f"'{{outcome}}' is none of {', '.join(OUTCOMES)}")
    items = table.groupby(["action", "start", "what", "proposal"], sort=False)
    place = items.cumcount()
    refuse(table, "point", table["point"] != place, "{point} does not follow the row before")
    short = spline & (items["point"].transform("size") != 3)
    refuse(table, "point", short, "a spline has 3 control points")
    whole = table.groupby(["action", "start"])["what"].transform(
        lambda what: {"before", "spline"} <= set(what)
    )
    refuse(table, "what", ~whole.astype(bool), "{action} needs a rope before and a spline")
    ropes = table.groupby(["action", "start"], sort=False)
    return [_rope(str(action), int(start), own) for (action, start), own in ropes]


def _rope(action: str, start: int, own: pd.DataFrame) -> Rope:
    parts = {what: rows for what, rows in own.groupby("what")}
    splines = tuple(
        Proposed(_points(rows), rows["outcome"].iloc[0])
        for _, rows in parts["spline"].groupby("proposal", sort=False)
    )
    after = _points(parts["after"]) if "after" in parts else None
    return Rope(action, start, _points(parts["before"]), splines, after)


def _points(rows: pd.DataFrame) -> NDArray[np.float64]:
    return rows[["x", "y", "z"]].to_numpy(float)
