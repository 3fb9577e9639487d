"""The shipped demonstrations: how robust they are, and what they leave room for (Sec. V-B a)."""

from __future__ import annotations

from typing import Any

from knotflow.report.contact_sheet import contact_sheet
from knotflow.report.proposals.records import read_proposals
from knotflow.report.results import COUNT, SHARE, TEXT, Results
from knotflow.report.section import Pictures, Section
from knotflow.report.tables import markdown_table

EXPERIMENT = "demonstrator"
COLUMNS = {"action": TEXT, "share": SHARE, "room": SHARE, "starts_left_out": COUNT}


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """A line an action, and all demonstrations to look at."""
    shares = results.table(EXPERIMENT, "shares.csv", COLUMNS)
    if shares is None:
        return None
    lines = [
        [
            f"`{action}`",
            f"{len(own)}",
            f"{own['share'].mean():.2f}",
            f"{own['share'].min():.2f}",
            f"{own['room'].mean():.2f}",
            f"{own['starts_left_out'].sum()}",
        ]
        for action, own in shares.groupby("action", sort=False)
    ]
    header = ["action", "demonstrations", "share, mean", "least", "room, mean", "starts left out"]
    ropes = read_proposals(results, EXPERIMENT, "shapes.csv")
    notes = [f"share {one.share:.2f}, room {one.room:.2f}" for one in shares.itertuples()]
    return {
        "table": markdown_table(header, lines, "lrrrrr"),
        "sheet": pictures.add(contact_sheet(ropes, notes, EXPERIMENT)) if ropes else "",
    }


SECTION = Section(
    EXPERIMENT,
    "Demonstrations",
    "Sec. V-B a",
    "What everything else learns from: a spline for each start shape, whose noisy copies succeed "
    "and leave room for the next action.",
    values,
)
