"""How near the trained primitives come to what one spline can do at all.

The scripted demonstrator searches for a spline in the simulator itself, start by start, and says
how many starts it had to leave out because none was found whose noisy copies succeed often enough.
Some loops are too tight for one spline, so no method comes near 100 % on such starts. Its starts
are made like the evaluation's, from another seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from knotflow.report import tables
from knotflow.report.paper import ACTIONS, REINFORCEMENT
from knotflow.report.results import Results
from knotflow.report.rows import require
from knotflow.report.statistics import wilson

AIM = 0.90
"""Success rate of the primitives after reinforcement that is aimed at on every action."""


@dataclass(frozen=True)
class Searched:
    """The demonstrator's searches for splines of one action."""

    found: int
    """Starts for which a spline was found."""
    left_out: int
    """Starts for which none was."""


def feasible(results: Results, experiment: str) -> dict[str, Any] | None:
    """Which actions reach the aim, and the demonstrator beside; None without reinforcement."""
    rates = results.rates(experiment)
    own = {
        action: rate
        for action in ACTIONS
        if rates is not None and (rate := rates.get(REINFORCEMENT.name, action)) is not None
    }
    if not own:
        return None
    reached = [action for action, rate in own.items() if rate.successes >= AIM * rate.trials]
    searched = searches(results)
    lines = [
        [
            f"`{action}`",
            tables.percent(wilson(rate.successes, rate.trials)),
            f"{tables.percent(wilson(one.found, one.found + one.left_out))}<br>"
            f"{one.found} of {one.found + one.left_out}",
        ]
        for action, rate in own.items()
        # A straight rope is searched once: it says nothing of the random curves of the evaluation.
        if (one := searched.get(action)) is not None and one.found + one.left_out > 1
    ]
    header = ["action", "imitation + RL, rollouts", "search in the simulator, starts"]
    return {
        "aim": f"{AIM:.0%}".replace("%", " %"),
        "reached": tables.listed([f"`{action}`" for action in reached]),
        "missed": len(own) - len(reached),
        "of": len(own),
        "table": tables.markdown_table(header, lines, "lrr") if lines else "",
    }


def searches(results: Results) -> dict[str, Searched]:
    """The demonstrator's searches by action; empty before a run."""
    rows = results.table("demonstrator", "shares.csv")
    if rows is None:
        return {}
    require(rows, ("action", "starts_left_out"))
    found: dict[str, Searched] = {}
    for row in rows:
        before = found.get(row.text("action"), Searched(0, 0))
        left_out = before.left_out + row.count("starts_left_out")
        found[row.text("action")] = Searched(before.found + 1, left_out)
    return found
