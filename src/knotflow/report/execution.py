"""Plans executed on perturbed ropes in simulation (Sec. VI and VII-D), and by an arm."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress

import pandas as pd
from matplotlib.figure import Figure

from knotflow.report import markdown as md
from knotflow.report.results import NotMeasured, Results, refuse
from knotflow.report.section import Figures, Parts, tied_bars
from knotflow.statistics import bootstrap, wilson

CLOSED_LOOP, ABLATION = "closed_loop", "closed_loop_ablation"
OPEN_LOOP = "open_loop"
CONTROLLERS = {
    OPEN_LOOP: ("open loop", "#8a8f98"),
    "mppi": ("MPPI", "#e69f00"),
    "replan": ("replanning", "#0072b2"),
    "mppi_replan": ("MPPI + replanning", "#009e73"),
}
"""Controllers in the order shown: what they are called, and their colour; others, of older results,
are not shown."""
TICK = {"image_ms": "image", "track_ms": "tracking", "mppi_ms": "MPPI", "tick_ms": "both"}
KEY = ("controller", "knot", "level", "fault", "twin")
COLUMNS = {"controller": str, "knot": str, "level": int, "fault": str, "twin": int, "tied": bool}
COLUMNS |= {"actions_done": int, "reported": str, "cause": str}
COLUMNS |= dict.fromkeys(("seconds", "planning_seconds", "mean_deviation_mm", *TICK), float)

Groups = dict[tuple[str, int, str], pd.DataFrame]
"""Executions by knot, level and controller."""


def closed_loop(results: Results, figures: Figures) -> Parts:
    """The figure, a line a controller, knot and level, the failures by cause, and the time."""
    runs = read_executions(results, CLOSED_LOOP)
    looked = runs[runs["reported"] != ""]
    false = (looked["reported"] == "yes") & ~looked["tied"]
    groups = _groups(runs)
    return {
        "figure": figures.draw(
            "executions",
            "Share of twins on which the overhand was tied, by level and controller, with 95 % "
            f"Wilson intervals; {_twins(groups)}.",
            3.2,
            lambda figure: _plot(figure, runs),
        ),
        "controllers": _table(groups, groups),
        "false": str(false.sum() or "None"),
        "looked": str(len(looked)),
        "film": figures.own(
            CLOSED_LOOP,
            "execution/execution.png",
            "The first execution by MPPI and replanning at level 1: the camera's image in the "
            "middle of each drag, and the end. White dots are the tracked rope; the yellow line, "
            "mostly under them, is the planned one.",
        ),
        "causes": _causes(groups),
        "ticks": _ticks(groups),
    }


def ablation(results: Results, _: Figures) -> Parts:
    """Controllers without one part, beside their counterparts, and executions with faults."""
    runs = read_executions(results, ABLATION)
    groups, every = _groups(runs), [runs]
    with suppress(NotMeasured):
        every = [read_executions(results, CLOSED_LOOP), runs]
    return {
        "controllers": _table(groups, _groups(pd.concat(every))),
        "causes": _causes(groups),
        "ticks": _ticks(groups),
        "faults": _faults(runs[runs["fault"] != ""]),
    }


def read_executions(results: Results, experiment: str) -> pd.DataFrame:
    """executions.csv, a row an execution."""
    runs = results.table(experiment, "executions.csv", COLUMNS, KEY)
    refuse(runs, runs["tied"] & (runs["cause"] != ""), "tied, and failed by {cause}")
    return runs[runs["controller"].isin(CONTROLLERS)]


def _groups(runs: pd.DataFrame) -> Groups:
    """Executions without faults: knots as they stand in the table, levels rising."""
    groups = dict(iter(runs[runs["fault"] == ""].groupby(["knot", "level", "controller"])))
    return {
        (knot, level, name): groups[knot, level, name].sort_values("twin")
        for knot in runs["knot"].unique()
        for level in sorted(runs["level"].unique())
        for name in CONTROLLERS
        if (knot, level, name) in groups
    }


def _table(groups: Groups, every: Groups) -> str:
    """A line for each of `groups`, with the difference from open loop among `every`."""
    rows = []
    for (knot, level, name), own in groups.items():
        base = every.get((knot, level, OPEN_LOOP)) if name != OPEN_LOOP else None
        row = _first_cells(knot, level, name) | {"tied": md.share(own["tied"])}
        row["minus open loop, points"] = _gain(own, base)
        row["actions"] = f"{own['actions_done'].mean():.1f}"
        row["deviation"] = _mean(own["mean_deviation_mm"], "mm")
        row["time, median"] = md.duration(own["seconds"].median())
        row["planning, median"] = md.duration(own["planning_seconds"].median())
        rows.append(row)
    return md.table(rows)


def _first_cells(knot: str, level: int, name: str) -> dict[str, str]:
    return {"knot": knot.replace("_", " "), "level": str(level), "controller": CONTROLLERS[name][0]}


def _twins(groups: Groups) -> str:
    """How many twins a bar has, and which have others."""
    numbers = {group: len(own) for group, own in groups.items() if group[0] == "overhand"}
    usual = Counter(numbers.values()).most_common(1)[0][0] if numbers else 0
    others = [
        f"{number} at level {level} by {CONTROLLERS[name][0]}"
        for (_, level, name), number in numbers.items()
        if number != usual
    ]
    return f"{usual} twins a bar" + (f", but {md.listed(others)}" if others else "")


def _mean(values: pd.Series, unit: str) -> str:
    return md.NOTHING if values.isna().all() else f"{values.mean():.0f} {unit}"


def _gain(own: pd.DataFrame, base: pd.DataFrame | None) -> str:
    """Percentage points tied above others, on the twins that both were executed on."""
    both = None if base is None else 100.0 * own.merge(base, on="twin")[["tied_x", "tied_y"]]
    if both is None or both.empty:
        return md.NOTHING
    return md.estimate(bootstrap(both["tied_x"] - both["tied_y"]))


def _causes(groups: Groups) -> str:
    """A line a kind of execution, a column a cause; '' where all were tied."""
    failed = {group: own[~own["tied"]] for group, own in groups.items()}
    causes = sorted({cause for own in failed.values() for cause in own["cause"] if cause})
    rows = [
        _first_cells(*group)
        | {"not tied": str(len(own))}
        | {cause: str((own["cause"] == cause).sum() or md.NOTHING) for cause in causes}
        for group, own in failed.items()
        if len(own)
    ]
    return md.table(rows, "Causes of failure, the first that applies:")


def _ticks(groups: Groups) -> str:
    """What a tick takes, for those that MPPI executes; '' where there are none."""
    if not groups:
        return ""
    runs = pd.concat(groups.values())
    rows = [
        {"controller": CONTROLLERS[str(name)][0]}
        | {TICK[one]: _mean(own[one], "ms") for one in TICK}
        for name, own in runs[runs["tick_ms"].notna()].groupby("controller", sort=False)
    ]
    return md.table(
        rows,
        "Time of one control tick on one core: the simulated image, which a real camera makes by "
        "itself, tracking the rope in it, and choosing the motion by MPPI.",
    )


def _faults(runs: pd.DataFrame) -> str:
    """What became of executions in which something failed; '' without any."""
    rows = []
    for (fault, name), own in runs.groupby(["fault", "controller"], sort=False):
        reported = own["reported"] == "yes"
        reasons = own[~reported]["cause"].replace("", "tied, not reported").value_counts()
        causes = ", ".join(f"{reason} {count}" for reason, count in reasons.items())
        rows.append(
            {
                "fault": str(fault),
                "controller": CONTROLLERS[str(name)][0],
                "twins": str(len(own)),
                "recovered": str((reported & own["tied"]).sum()),
                "stopped": str((~reported).sum()),
                "falsely reported tied": str((reported & ~own["tied"]).sum()),
                "why stopped": causes or md.NOTHING,
            }
        )
    return md.table(
        rows,
        "In the following executions something failed in the first action: no frames for a while, "
        "the fingers opened in the middle of the drag, or images showed the table without the rope "
        "until after the first look. *Recovered* is tied and reported; *stopped* is everything "
        "that was not reported tied.",
    )


def _plot(figure: Figure, runs: pd.DataFrame) -> None:
    """Share tied of the knot with most executions, a group of bars a level."""
    runs = runs[(runs["knot"] == runs["knot"].mode()[0]) & (runs["fault"] == "")]
    levels = sorted(runs["level"].unique())
    series = {
        label: (
            colour,
            {
                group: wilson(own["tied"].sum(), len(own))
                for group, level in enumerate(levels)
                if len(own := runs[(runs["controller"] == name) & (runs["level"] == level)])
            },
        )
        for name, (label, colour) in CONTROLLERS.items()
        if name in set(runs["controller"])
    }
    tied_bars(figure, [f"level {level}" for level in levels], series)


TRAJECTORIES = {"arm": str, "plan": int, "solved": bool}
TRAJECTORIES |= dict.fromkeys(("reachable", "tied_as_exported"), bool)
TRAJECTORIES |= dict.fromkeys(("simulated", "out_of_reach", "planning_seconds"), float)
TRAJECTORIES |= dict.fromkeys(("waypoints", "unreached", "tip_error_mm", "tip_speed"), float)
TRAJECTORIES |= dict.fromkeys(("limit_margin_deg", "joint_speed_share", "seconds", "slowed"), float)


def arm(results: Results, _: Figures) -> Parts:
    """A line for each property of the searches and trajectories, a column an arm."""
    plans = results.table("arm", "trajectories.csv", TRAJECTORIES, ("arm", "plan"))
    refuse(plans, plans["reachable"] & ~plans["solved"], "reachable, and not found")
    columns = {str(arm): _measured(own) for arm, own in plans.groupby("arm", sort=False)}
    names = next(iter(columns.values()))
    table = md.table(
        [
            {"searches and trajectories": name} | {arm: own[name] for arm, own in columns.items()}
            for name in names
        ]
    )
    return {
        "plans": md.join(
            f"{len(plans)} searches within reach of an arm at its default base. Each plan became a "
            "joint trajectory, moves between the splines included, and was checked with the arm's "
            "forward kinematics at and between its waypoints. The rope was then simulated under "
            "the exported motion of the tip, in place and time.",
            table,
            "A plan is fully reachable if the tip reaches every waypoint with a gripper that "
            "closes across the strand and tilts no more than allowed. A real arm also has to hold "
            "the rope; see [closed-loop execution](#closed-loop-execution).",
        )
    }


def _measured(plans: pd.DataFrame) -> dict[str, str]:
    """What one arm's searches came to."""
    found = plans[plans["solved"]]
    searched = {
        "fully reachable plans found": md.share(plans["reachable"]),
        "splines simulated, median": f"{plans['simulated'].median():.0f}",
        "planning, median": md.duration(plans["planning_seconds"].median()),
    }
    properties = {
        "tied as exported": lambda: md.share(found["tied_as_exported"]),
        "largest tip error at a reached waypoint": lambda: f"{found['tip_error_mm'].max():.2f} mm",
        "largest tip speed": lambda: f"{found['tip_speed'].max():.3f} m/s",
        "smallest distance of a joint from its limits": lambda: (
            f"{found['limit_margin_deg'].min():.1f}°"
        ),
        "largest joint speed": lambda: (
            f"{md.whole(100 * found['joint_speed_share'].max())} % of its limit"
        ),
        "duration of a plan, median": lambda: md.duration(found["seconds"].median()),
        "slowest drag of a plan against the simulation, median over plans": lambda: (
            f"{found['slowed'].median():.2f} times"
        ),
    }
    return searched | {
        name: md.NOTHING if found.empty else measure() for name, measure in properties.items()
    }
