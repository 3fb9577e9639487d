"""What the single actions and the ablation cost in time, by kind of work."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from knotflow.report import tables
from knotflow.report.paper import ACTIONS
from knotflow.report.results import Results
from knotflow.report.style import INK, MUTED, PAPER, Picture, bare_axis, new_figure, render, styled

EXPERIMENTS = ("single_stage", "ablation_actor_critic")
#: Both experiments from nothing, at the paper's counts on two cores: no longer than that.
AIM_HOURS = 3.0

SIMULATION, TRAINING, EVALUATION, OTHER = "simulation", "training", "evaluation", "tables"
KINDS = {
    SIMULATION: "#0072b2",
    TRAINING: "#e69f00",
    EVALUATION: "#009e73",
    OTHER: "#8a8f98",
}
#: Kinds of the stages; any other makes tables and recordings from what is there.
KIND_OF_STAGE = {
    "demonstrations": SIMULATION,
    "starts": SIMULATION,
    "pools": SIMULATION,
    "imitation": TRAINING,
    "reinforcement": TRAINING,
    "evaluation": EVALUATION,
}


def cost(results: Results, add: Callable[[Picture], str]) -> dict[str, Any] | None:
    """The split as a figure and a table, and the total beside the aim; None before a run.

    `add` keeps a figure and gives the Markdown that shows it.
    """
    split = spent(results)
    if not split:
        return None
    total = sum(sum(kinds.values()) for kinds in split.values())
    budgets = {results.experiments[name].budget for name in split}
    return {
        "figure": add(_bars(split, "cost", paper=budgets == {"paper"})),
        "table": _table(split),
        "total": tables.duration(total),
        "aim": f"{AIM_HOURS:g} hours",
        "complete": len(split) == len(EXPERIMENTS),
        "paper": budgets == {"paper"},
        "within": total <= 3600 * AIM_HOURS,
        **_attempts(results),
    }


def spent(results: Results) -> dict[str, dict[str, float]]:
    """Seconds by kind of each experiment that was run; a stage both need is the first's."""
    split: dict[str, dict[str, float]] = {}
    seen: set[str] = set()
    for name in EXPERIMENTS:
        found = results.experiments.get(name)
        if found is None or not found.stages:
            continue
        kinds = dict.fromkeys(KINDS, 0.0)
        for stage in found.stages:
            key = stage.signature or f"{name}/{stage.node}"
            if key not in seen:
                kinds[KIND_OF_STAGE.get(stage.stage, OTHER)] += stage.seconds or 0.0
            seen.add(key)
        split[name] = kinds
    return split


def _attempts(results: Results) -> dict[str, Any]:
    """How many attempts reinforcement simulates, and for how long at the demonstrations' speed.

    No run tells this time apart; it is 0 attempts where tables or configuration do not say.
    """
    attempts, seen, pace = 0, set(), None
    for name in EXPERIMENTS:
        found = results.experiments.get(name)
        for stage in found.stages if found else []:
            if stage.signature in seen:
                continue
            seen.add(stage.signature)
            configured = (found.config.get("stages") or {}).get(stage.node) or {} if found else {}
            effort = (configured.get("config") or {}).get("reinforcement") or {}
            if stage.stage == "reinforcement" and {"rounds", "ropes", "splines"} <= effort.keys():
                attempts += len(ACTIONS) * effort["rounds"] * effort["ropes"] * effort["splines"]
            rows = results.table(name, "demonstrations.csv")
            if stage.stage == "demonstrations" and stage.seconds and rows:
                pace = stage.seconds / sum(row.count("trials", 1) for row in rows)
    if not attempts or pace is None:
        return {"attempts": 0, "attempts_time": ""}
    return {"attempts": attempts, "attempts_time": tables.duration(attempts * pace)}


def _table(split: Mapping[str, Mapping[str, float]]) -> str:
    lines = [
        [f"`{name}`", *(tables.duration(kinds[kind]) for kind in KINDS), _sum(kinds.values())]
        for name, kinds in split.items()
    ]
    if len(split) > 1:
        sums = [sum(kinds[kind] for kinds in split.values()) for kind in KINDS]
        lines.append(["together", *map(tables.duration, sums), _sum(sums)])
    return tables.markdown_table(["experiment", *KINDS, "in all"], lines, "lrrrrr")


def _sum(seconds: Iterable[float]) -> str:
    return tables.duration(sum(seconds))


def _bars(split: Mapping[str, Mapping[str, float]], name: str, *, paper: bool) -> Picture:
    """A stacked bar an experiment, one after the other; the aim where counts are the paper's."""
    unit, word = (3600.0, "hours") if paper else (60.0, "minutes")
    with styled():
        figure = new_figure(0.95 + 0.38 * len(split))
        axes = figure.add_subplot()
        left = 0.0
        for y, kinds in enumerate(split.values()):
            begin = left
            for kind, colour in KINDS.items():
                width = kinds[kind] / unit
                axes.barh(y, width, 0.6, left, color=colour, label=kind if y == 0 else None)
                left += width
            axes.annotate(
                _sum(kinds.values()),
                (left, y),
                (6, 0),
                textcoords="offset points",
                va="center",
                bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 1.0},  # over the aim's line
            )
            if y:
                axes.plot([begin, begin], [y - 1, y], color=MUTED, linewidth=0.7, zorder=0)
        right = max(left, AIM_HOURS if paper else 0.0)
        if paper:
            axes.axvline(AIM_HOURS, color=INK, linewidth=1.0, linestyle=":")
            axes.text(AIM_HOURS, -0.62, "aim ", ha="right", fontsize=8, color=MUTED)
        axes.set_yticks(range(len(split)), _names(list(split)))
        axes.tick_params(axis="y", labelcolor=INK)
        axes.set_ylim(len(split) - 0.55, -0.75)
        axes.set_xlim(0, right * 1.14)
        axes.set_xlabel(word)
        bare_axis(axes, grid="x")
        figure.legend(loc="outside upper left", ncols=len(KINDS), frameon=False, fontsize=8.5)
        alt = f"Time of {tables.listed(_names(list(split)))} by kind of work"
        return render(figure, name, alt)


def _names(experiments: Sequence[str]) -> list[str]:
    told = {"single_stage": "single actions", "ablation_actor_critic": "what the ablation adds"}
    return [told[name] for name in experiments]
