"""What proposals.csv holds, checked as it is read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from knotflow.report.rows import Row, require

BEFORE, SPLINE, AFTER = "before", "spline", "after"
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


def read_proposals(rows: list[Row]) -> list[Rope]:
    """proposals.csv, a row a point.

    Raises:
        ResultsError: a point is missing, a rope has no spline, or a word is none of those known.
    """
    require(rows, ("action", "start", "what", "proposal", "outcome", "point", "x", "y", "z"))
    ropes: dict[tuple[str, int], dict[tuple[str, str], list[Row]]] = {}
    for row in rows:
        if row.text("what") not in (BEFORE, SPLINE, AFTER):
            raise row.error("what", f"{row.text('what')!r} is none of before, spline, after")
        items = ropes.setdefault((row.text("action"), row.count("start")), {})
        items.setdefault((row.text("what"), row.text("proposal")), []).append(row)
    return [_rope(*key, items) for key, items in ropes.items()]


def _rope(action: str, start: int, items: dict[tuple[str, str], list[Row]]) -> Rope:
    found: dict[str, list[list[Row]]] = {BEFORE: [], SPLINE: [], AFTER: []}
    for (what, _), own in items.items():
        found[what].append(own)
    first = next(iter(items.values()))[0]
    if len(found[BEFORE]) != 1 or not found[SPLINE]:
        raise first.error("what", f"{action} from start {start} needs one rope before and a spline")
    splines = []
    for points in found[SPLINE]:
        outcome = points[0].text("outcome")
        if outcome not in OUTCOMES:
            raise points[0].error("outcome", f"{outcome!r} is none of {', '.join(OUTCOMES)}")
        if len(points) != 3:
            raise points[0].error("point", f"{len(points)} control points; a spline has 3")
        splines.append(Proposed(_points(points), outcome))
    after = _points(found[AFTER][0]) if found[AFTER] else None
    return Rope(action, start, _points(found[BEFORE][0]), tuple(splines), after)


def _points(rows: list[Row]) -> NDArray[np.float64]:
    for place, row in enumerate(rows):
        if row.count("point") != place:
            raise row.error("point", f"{row.count('point')} where {place} was expected")
    return np.array([[row.number_in(axis, -np.inf) for axis in "xyz"] for row in rows])
