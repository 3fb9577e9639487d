"""Plans as joint trajectories of an arm."""

from __future__ import annotations

from typing import Any

from knotflow.report.results import COUNT, FLAG, TEXT, Column, Results
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import wilson
from knotflow.report.tables import duration, markdown_table, percent

EXPERIMENT = "arm"
MAYBE, AMOUNT_OR_NONE = Column("number", optional=True), Column("number", 0, optional=True)
COLUMNS = {"plan": COUNT, "knot": TEXT, "solved": FLAG, "limit_margin_deg": MAYBE}
COLUMNS |= dict.fromkeys(("waypoints", "unreached", "tip_error_mm", "tip_speed"), AMOUNT_OR_NONE)
COLUMNS |= dict.fromkeys(("joint_speed_share", "seconds", "slowed"), AMOUNT_OR_NONE)
PERCENT = 100


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """A line for each thing that the trajectories were checked for."""
    plans = results.table(EXPERIMENT, "trajectories.csv", COLUMNS, key=("plan",))
    if plans is None:
        return None
    found = plans[plans["solved"]]
    if found.empty:
        return {"plans": len(plans), "found": 0, "table": ""}
    reachable = found["unreached"] == 0
    whole = wilson(int(reachable.sum()), len(found))
    reached = 1 - found["unreached"].sum() / found["waypoints"].sum()
    lines = [
        ["plans fully reachable", f"{percent(whole)}, {reachable.sum()} of {len(found)}"],
        ["waypoints reached", f"{PERCENT * reached:.2f} %"],
        ["tip off a waypoint that is reached, at most", f"{found['tip_error_mm'].max():.2f} mm"],
        ["speed of the tip, at most", f"{found['tip_speed'].max():.3f} m/s"],
        ["joints from the ends of their ranges, at least"]
        + [f"{found['limit_margin_deg'].min():.1f}°".replace("-", "−")],
        ["speed of a joint, at most", f"{found['joint_speed_share'].max():.0%} of its limit"],
        ["time of a plan, median", duration(found["seconds"].median())],
        ["slower than simulated while the rope is held, median"]
        + [f"{found['slowed'].median():.1f} times"],
    ]
    table = markdown_table(["trajectories", "measured"], lines, "lr")
    return {"plans": len(plans), "found": len(found), "table": table}


SECTION = Section(
    EXPERIMENT,
    "Plans by an arm",
    "Sec. VI",
    "Joint trajectories of plans from random ropes, for a Panda where it stands by default.",
    values,
)
