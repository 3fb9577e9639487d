"""Plans executed on ropes that differ from the planner's (Sec. VI and VII-D), in simulation."""

from __future__ import annotations

from typing import Any

import pandas as pd

from knotflow.intervals import wilson
from knotflow.report.results import AMOUNT, COUNT, FLAG, NOTE, TEXT, Column, Results, refuse
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import mean_difference
from knotflow.report.style import INK, Picture, bare_axis, new_figure, render, styled
from knotflow.report.tables import NOTHING, duration, estimate, listed, markdown_table, percent

EXPERIMENT = "closed_loop"
PARTS = "closed_loop_ablation"
"""Its executions are on the same twins."""
STAGE = "executions"
"""What of both executes."""
BASE = "open_loop"
#: Controllers in the order shown: what they are called, and their colour.
CONTROLLERS = {
    BASE: ("open loop", "#8a8f98"),
    "open_loop_robust": ("open loop, robust plan", "#24292f"),
    "mppi": ("MPPI", "#e69f00"),
    "mppi_true_state": ("MPPI, true state", "#f0b25a"),
    "mppi_true_state_mujoco": ("MPPI by simulation, true state", "#d55e00"),
    "replan": ("planned anew", "#0072b2"),
    "replan_true_state": ("planned anew, true state", "#8fb8c4"),
    "mppi_replan": ("MPPI, planned anew", "#009e73"),
    "mppi_replan_true_state": ("MPPI, planned anew, true state", "#7fc8a9"),
}
SHOWN = "An execution, a panel a drag: the camera's image with the rope"
#: How the names of controllers end that are given the true state.
TRUE = "_true_state"
ROBUST = "open_loop_robust"
TICK = {"image_ms": "image", "track_ms": "track", "mppi_ms": "MPPI", "tick_ms": "together"}
MAYBE = Column("number", 0, optional=True)
KEY = {"controller": TEXT, "knot": TEXT, "level": COUNT, "fault": NOTE, "twin": COUNT}
COLUMNS = KEY | {"tied": FLAG, "actions_done": COUNT, "seconds": AMOUNT, "planning_seconds": AMOUNT}
COLUMNS |= dict.fromkeys(("mean_deviation_mm", *TICK), MAYBE)
COLUMNS |= {"reported": NOTE, "cause": NOTE, "reason": NOTE}


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figures, a line a controller, knot and level, the failures by cause, and the faults."""
    if _table_of(results, EXPERIMENT) is None:
        return None
    runs = _runs(results)
    false = runs[(runs["reported"] == "yes") & ~runs["tied"]]
    looked = int((runs["reported"] != "").sum())
    runs = runs[runs["fault"] == ""]
    groups = _groups(runs)
    return {
        "figure": pictures.add(_figure(runs)),
        "shown": pictures.stored(results, EXPERIMENT, "execution/execution", SHOWN),
        "table": _table(groups),
        "causes": _causes(groups),
        "ticks": _ticks(runs),
        "reported": len(false),
        "looked": looked,
        "apart": _table_of(results, PARTS) is not None and not _comparable(results),
        "missing": listed([CONTROLLERS[name][0] for name in ("mppi", "mppi_replan")
                           if name not in set(runs["controller"])]),
    }  # fmt: skip


def parts(results: Results, _: Pictures) -> dict[str, Any] | None:
    """Robust plans against others, and what became of executions in which something failed; shares
    where they do not stand in the section before."""
    if _table_of(results, PARTS) is None:
        return None
    runs = _runs(results, PARTS)
    apart = not _comparable(results)
    return {
        "table": _table(_groups(runs[runs["fault"] == ""])) if apart else "",
        "robust": _robust(runs[runs["fault"] == ""]),
        "faults": _faults(runs[runs["fault"] != ""]),
    }


def _runs(results: Results, experiment: str = EXPERIMENT) -> pd.DataFrame:
    """An experiment's executions, and the other's where the same plans are executed alike."""
    both = (EXPERIMENT, PARTS) if _comparable(results) else (experiment,)
    tables = [_table_of(results, one) for one in both]
    return pd.concat([one for one in tables if one is not None], ignore_index=True)


def _comparable(results: Results) -> bool:
    """Whether both experiments were configured alike, but for what they execute."""
    one, other = ((results.setting(name, STAGE) or {}) for name in (EXPERIMENT, PARTS))
    return {**one, "cases": None} == {**other, "cases": None}


def _table_of(results: Results, experiment: str) -> pd.DataFrame | None:
    runs = results.table(experiment, "executions.csv", COLUMNS, key=tuple(KEY))
    if runs is not None:
        unknown = ~runs["controller"].isin(CONTROLLERS)
        refuse(runs, "controller", unknown, f"'{{controller}}' is none of {listed([*CONTROLLERS])}")
        contradicted = runs["tied"] & (runs["cause"] != "")
        refuse(runs, "cause", contradicted, "tied, and failed by {cause}")
    return runs


Group = tuple[str, str, int]
"""Knot, controller, level."""


def _groups(runs: pd.DataFrame) -> dict[Group, pd.DataFrame]:
    """Executions of a kind, twins in order: knots as they stand in the table, levels rising."""
    groups = dict(iter(runs.groupby(["knot", "controller", "level"])))
    return {
        (knot, name, level): groups[knot, name, level].sort_values("twin")
        for knot in runs["knot"].unique()
        for level in sorted(runs["level"].unique())
        for name in CONTROLLERS
        if (knot, name, level) in groups
    }


def _table(groups: dict[Group, pd.DataFrame]) -> str:
    lines = []
    for (knot, name, level), own in groups.items():
        lines.append(
            [
                knot.replace("_", " "),
                str(level),
                CONTROLLERS[name][0],
                f"{percent(wilson(int(own['tied'].sum()), len(own)))}<br>"
                f"{own['tied'].sum()} of {len(own)}",
                _gain(own, groups.get((knot, BASE, level))) if name != BASE else NOTHING,
                _gain(own, groups.get((knot, name + TRUE, level))),
                f"{own['actions_done'].mean():.1f}",
                _mean(own["mean_deviation_mm"], "{:.0f} mm"),
                duration(own["seconds"].median()),
                duration(own["planning_seconds"].median()),
            ]
        )
    header = ["knot", "level", "executed", "tied", "points above open loop"]
    header += ["vision minus truth, points", "actions", "deviation", "time, median"]
    header += ["planning, median"]
    return markdown_table(header, lines, "lrlrrrrrrr")


def _ticks(runs: pd.DataFrame) -> str:
    """What a tick takes, for those that MPPI executes; none where there are none."""
    timed = runs[runs["tick_ms"].notna()]
    lines = [
        [CONTROLLERS[name][0], *(_mean(own[column], "{:.0f} ms") for column in TICK)]
        for name in CONTROLLERS
        if len(own := timed[timed["controller"] == name])
    ]
    header = ["executed", "image, simulated", "track", "MPPI", "track and MPPI"]
    return markdown_table(header, lines, "lrrrr") if lines else ""


def _robust(runs: pd.DataFrame) -> str:
    """What plans cost and bring that an ensemble judged, on the same twins; "" without any."""
    lines = []
    for level, own in runs[runs["controller"] == ROBUST].groupby("level"):
        base = runs[(runs["controller"] == BASE) & (runs["level"] == level)]
        both = own.merge(base, on=["knot", "twin"], suffixes=("", "_base"))
        if both.empty:
            continue
        seconds = [both[f"planning_seconds{end}"] for end in ("_base", "")]
        more = mean_difference(seconds[1].tolist(), seconds[0].tolist(), paired=True)
        lines.append(
            [str(level), *(duration(one.mean()) for one in seconds), estimate(more)]
            + [_gain(own, base)]
        )
    header = ["level", "planning, mean", "with an ensemble", "seconds more", "points more tied"]
    return markdown_table(header, lines, "rrrrr") if lines else ""


def _faults(runs: pd.DataFrame) -> str:
    """What became of executions in which something failed; "" without any."""
    lines = []
    for (fault, name), own in runs.groupby(["fault", "controller"], sort=False):
        reported = own["reported"] == "yes"
        reasons = own[~reported]["cause"].replace("", "tied, not reported").value_counts()
        lines.append(
            [fault, CONTROLLERS[name][0], str(len(own)), str((reported & own["tied"]).sum())]
            + [str((~reported).sum()), str((reported & ~own["tied"]).sum())]
            + [", ".join(f"{reason} {count}" for reason, count in reasons.items()) or NOTHING]
        )
    header = ["fault", "executed", "twins", "recovered", "stopped", "falsely reported tied"]
    return markdown_table(header + ["why stopped"], lines, "llrrrrl") if lines else ""


def _gain(own: pd.DataFrame, base: pd.DataFrame | None) -> str:
    """Percentage points tied above others, on the twins that both were executed on."""
    if base is None:
        return NOTHING
    both = own.merge(base, on="twin", suffixes=("", "_base"))
    if both.empty:
        return NOTHING
    tied = (100.0 * both["tied"]).tolist(), (100.0 * both["tied_base"]).tolist()
    return estimate(mean_difference(*tied, paired=True))


def _mean(values: pd.Series, form: str) -> str:
    return NOTHING if values.isna().all() else form.format(values.mean())


def _causes(groups: dict[Group, pd.DataFrame]) -> str:
    """A line a kind of execution, a column a cause; empty where all were tied."""
    failed = {group: own[~own["tied"]] for group, own in groups.items()}
    causes = sorted({cause for own in failed.values() for cause in own["cause"] if cause})
    if not causes:
        return ""
    lines = [
        [knot.replace("_", " "), str(level), CONTROLLERS[name][0], str(len(own))]
        + [str((own["cause"] == cause).sum() or NOTHING) for cause in causes]
        for (knot, name, level), own in failed.items()
        if len(own)
    ]
    header = ["knot", "level", "executed", "not tied", *causes]
    return markdown_table(header, lines, "lrl" + "r" * (1 + len(causes)))


def _figure(runs: pd.DataFrame) -> Picture:
    """Share tied of the knot that most executions are of, by level, with Wilson's intervals."""
    knot = runs["knot"].mode()[0]
    runs = runs[runs["knot"] == knot]
    names = [name for name in CONTROLLERS if name in set(runs["controller"])]
    levels = sorted(runs["level"].unique())
    step = 0.8 / len(names)
    with styled():
        figure = new_figure(3.2)
        axes = figure.add_subplot()
        for place, name in enumerate(names):
            label, colour = CONTROLLERS[name]
            own = runs[runs["controller"] == name].groupby("level")["tied"].agg(["sum", "size"])
            rates = {
                level: wilson(int(row["sum"]), int(row["size"])) for level, row in own.iterrows()
            }
            at = [levels.index(level) + (place - (len(names) - 1) / 2) * step for level in rates]
            axes.bar(
                at,
                [100 * rate.estimate for rate in rates.values()],
                0.9 * step,
                color=colour,
                label=label,
            )
            for x, rate in zip(at, rates.values(), strict=True):
                assert rate.low is not None and rate.high is not None
                axes.plot([x, x], [100 * rate.low, 100 * rate.high], color=INK, linewidth=1.0)
        axes.set_xticks(range(len(levels)), [f"level {level}" for level in levels])
        axes.set_ylim(0, 100)
        axes.set_ylabel("tied, %")
        bare_axis(axes, grid="y")
        figure.legend(loc="outside upper left", ncols=3, frameon=False, fontsize=8.5)
        alt = f"Share of twins on which the {knot.replace('_', ' ')} was tied, by level"
        return render(figure, "executions", alt)


SECTION = Section(
    EXPERIMENT,
    "Execution in closed loop",
    "Sec. VI and VII-D",
    "Plans executed on simulated ropes that differ from the planner's in friction, stiffness, "
    "damping, density and radius, by a gripper that errs: level 0 not at all, level 1 a little, "
    "level 2 twice as much. All controllers meet the same twins.",
    values,
)
ABLATION = Section(
    PARTS,
    "Execution in closed loop: its parts",
    "beyond the paper",
    "The same twins, with plans that an ensemble of ropes judged, by the rope's true state in "
    "place of vision, without MPPI, and with faults of robot and camera.",
    parts,
)
