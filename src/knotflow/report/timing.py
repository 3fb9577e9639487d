"""Where the time went: every stage once, and what single actions and ablation cost by kind."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from knotflow.report.paper import ACTIONS
from knotflow.report.results import AT_LEAST_ONE, ExperimentResults, Results, StageRun
from knotflow.report.section import Pictures
from knotflow.report.style import (
    INK,
    MUTED,
    PAPER,
    RULE,
    Picture,
    bare_axis,
    new_figure,
    render,
    styled,
)
from knotflow.report.tables import NOTHING, duration, listed, markdown_table

#: Stages in the figure; the table beside it has all.
STAGES_DRAWN = 15

#: What the cost is of, and how the figure calls it.
COSTED = {"single_stage": "single actions", "ablation_actor_critic": "what the ablation adds"}
#: Both experiments from nothing, at the paper's counts on two cores: no longer than that.
AIM_HOURS = 3.0

#: Of a cluster whose time is estimated.
CPUS = (2, 8, 32, 128)

#: The trainings of the weights that come with the package: the experiment, and its stage.
SHIPPED = {
    ("joint_finetuning", "self_play"),
    ("library_training", "self_play"),
    ("perception_training", "perception_training"),
    ("strand_training", "strand_training"),
    ("dynamics_training", "dynamics_training"),
}

UNKNOWN = "unknown"
KINDS = {"simulation": "#0072b2", "training": "#e69f00", "evaluation": "#009e73"}
KINDS |= {"tables": "#8a8f98", UNKNOWN: "#cc79a7"}
STAGES_OF_KIND = {
    "simulation": "benchmark causal_infogan_ends demonstrations demonstrator gradient_steps "
    "motions plans_pull pools roots ropes scaling starts",
    "training": "causal_infogan dynamics_training imitation perception_networks "
    "perception_training reinforcement self_play strand_training",
    "evaluation": "actions arm causal_infogan_plans closed_loop dynamics evaluation goals "
    "overhand path_steps perceived_plans perception plans plans_checks tracking",
    "tables": "exemplars library plans_dag plans_exemplar plans_success plans_table proposals "
    "shipped success_rates",
}
KIND_OF_STAGE = {one: kind for kind, stages in STAGES_OF_KIND.items() for one in stages.split()}
"""Any other is unknown: of an earlier version, or somebody's own."""


def timing(results: Results, pictures: Pictures) -> dict[str, Any]:
    """Every stage once, with its time and memory, and in all by kind; the longest as a figure."""
    once: dict[str, tuple[str, StageRun]] = {}
    for name, found in results.experiments.items():
        for stage in found.stages:
            key = stage.signature or f"{name}/{stage.node}"
            # The experiment that made it knows the time best; the others found it there.
            if key not in once or (once[key][1].shared and not stage.shared):
                once[key] = (name, stage)
    lines = [
        [
            *(name, f"`{stage.node}`", stage.caption or NOTHING),
            *(duration(stage.seconds), _memory(stage.memory_mb)),
        ]
        for name, stage in once.values()
    ]
    named = [(name, stage) for name, stage in once.values() if stage.seconds is not None]
    longest = sorted(named, key=lambda one: -_seconds(one[1]))[:STAGES_DRAWN]
    timed = [stage for _, stage in named]
    total = sum(map(_seconds, timed))
    shipped = sum(_seconds(stage) for name, stage in named if (name, stage.stage) in SHIPPED)
    header = ["experiment", "stage", "what it makes", "time", "memory"]
    return {
        "figure": pictures.add(_longest(longest)) if len(longest) > 1 else "",
        "shown": len(longest),
        "total": duration(total),
        "shipped": duration(shipped) if shipped else "",
        "others": duration(total - shipped),
        "count": len(once),
        "kinds": _kinds(timed),
        "cluster": _cluster(timed),
        "unknown": sum(stage.cpus is None for stage in timed),
        "table": markdown_table(header, lines, "lllrr") if lines else "",
    }


def _kinds(stages: Sequence[StageRun]) -> str:
    """A line a kind of work: how many stages, their time, and what the largest held."""
    lines = []
    for kind in KINDS:
        own = [one for one in stages if _kind(one) == kind]
        memory = [one.memory_mb for one in own if one.memory_mb is not None]
        most = _memory(max(memory, default=None))
        if own:
            lines.append([kind, str(len(own)), duration(sum(map(_seconds, own))), most])
    return markdown_table(["kind of work", "stages", "time", "most memory"], lines, "lrrr")


def _cluster(stages: Sequence[StageRun]) -> str:
    """Expected time by the number of CPUs, from how many shards each stage has; empty where no
    stage noted that. A stage without shards, or that noted nothing, takes the time it took."""
    if not any(stage.cpus for stage in stages):
        return ""
    lines = [[f"{cpus:,}", duration(sum(_expected(one, cpus) for one in stages))] for cpus in CPUS]
    return markdown_table(["CPUs", "expected"], lines, "rr")


def _expected(stage: StageRun, cpus: int) -> float:
    """Seconds of a stage whose shards all take as long as each other, on so many CPUs."""
    seconds = _seconds(stage)
    if not stage.cpus or stage.shards < 2:
        return seconds
    rounds, before = (math.ceil(stage.shards / one) for one in (cpus, stage.cpus))
    return seconds * rounds / before


def _seconds(stage: StageRun) -> float:
    return stage.seconds or 0.0


def _kind(stage: StageRun) -> str:
    return KIND_OF_STAGE.get(stage.stage, UNKNOWN)


def _memory(megabytes: float | None) -> str:
    return NOTHING if megabytes is None else f"{megabytes:,.0f} MB"


def _longest(stages: Sequence[tuple[str, StageRun]]) -> Picture:
    """A bar a stage; its experiment stands before a caption that several have."""
    captions = [stage.caption or stage.node.replace("_", " ") for _, stage in stages]
    count = Counter(captions)
    labels = [
        f"{name}: {caption}" if count[caption] > 1 else caption
        for (name, _), caption in zip(stages, captions, strict=True)
    ]
    return bars(
        [textwrap.fill(label, 48) for label in labels],
        [_seconds(stage) / 60 for _, stage in stages],
        [duration(stage.seconds) for _, stage in stages],
        axis="minutes",
        name="stages",
        alt=f"Wall-clock time of {len(stages)} stages",
        line=0.36,
    )


def bars(
    labels: Sequence[str],
    values: Sequence[float],
    notes: Sequence[str],
    *,
    axis: str,
    name: str,
    alt: str,
    line: float,
) -> Picture:
    """A horizontal bar a value, its note behind it; `line` is the height of one, inches."""
    with styled():
        figure = new_figure(0.7 + line * len(labels))
        axes = figure.add_subplot()
        places = range(len(labels))
        axes.barh(places, values, 0.62, color="#0072b2")
        for y, (value, note) in enumerate(zip(values, notes, strict=True)):
            axes.annotate(note, (value, y), (5, 0), textcoords="offset points", va="center")
        axes.set_yticks(places, labels)
        axes.tick_params(axis="y", labelcolor=INK)
        axes.set_ylim(len(labels) - 0.4, -0.6)
        axes.set_xlim(0, max([*values, 1e-9]) * 1.22)
        axes.set_xlabel(axis)
        bare_axis(axes, grid="x")
        axes.axvline(0, color=RULE, linewidth=1.2)
        return render(figure, name, alt)


def cost(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The split as a figure and a table, and the total beside the aim; None before a run."""
    split = spent(results)
    if not split:
        return None
    total = sum(sum(kinds.values()) for kinds in split.values())
    paper = all(results.paper(name) for name in split)
    attempts, pace = _attempts(results), _pace(results)
    return {
        "figure": pictures.add(_split(split, paper=paper)),
        "table": _table(split),
        "total": duration(total),
        "aim": f"{AIM_HOURS:g} hours",
        "complete": len(split) == len(COSTED),
        "paper": paper,
        "within": total <= 3600 * AIM_HOURS,
        "attempts": attempts if pace else 0,
        "attempts_time": duration(attempts * pace) if pace else "",
    }


def spent(results: Results) -> dict[str, dict[str, float]]:
    """Seconds by kind of each experiment that was run; a stage both need is the first's."""
    stages = _stages(results)
    there = [kind for kind in KINDS if any(_kind(stage) == kind for _, stage in stages)]
    split: dict[str, dict[str, float]] = {}
    for found, stage in stages:
        kinds = split.setdefault(found.name, dict.fromkeys(there, 0.0))
        kinds[_kind(stage)] += _seconds(stage)
    return split


def _stages(results: Results) -> list[tuple[ExperimentResults, StageRun]]:
    """The stages of the costed experiments, each once."""
    once: dict[str, tuple[ExperimentResults, StageRun]] = {}
    for name in COSTED:
        if found := results.experiments.get(name):
            for stage in found.stages:
                once.setdefault(stage.signature or f"{name}/{stage.node}", (found, stage))
    return list(once.values())


def _attempts(results: Results) -> int:
    """How many rollouts reinforcement simulates, 0 where the configuration does not say."""
    attempts = 0
    for found, stage in _stages(results):
        configured = (found.config.get("stages") or {}).get(stage.node) or {}
        effort = (configured.get("config") or {}).get("reinforcement") or {}
        if stage.stage == "reinforcement" and {"rounds", "ropes", "splines"} <= effort.keys():
            attempts += len(ACTIONS) * effort["rounds"] * effort["ropes"] * effort["splines"]
    return attempts


def _pace(results: Results) -> float | None:
    """Seconds a rollout of the demonstrations took; no run has that of attempts by itself."""
    for found, stage in _stages(results):
        table = results.table(found.name, "demonstrations.csv", {"trials": AT_LEAST_ONE})
        if stage.stage == "demonstrations" and stage.seconds and table is not None:
            return float(stage.seconds / table["trials"].sum())
    return None


def _table(split: Mapping[str, Mapping[str, float]]) -> str:
    rows = {f"`{name}`": [*kinds.values()] for name, kinds in split.items()}
    there = [*next(iter(split.values()))]
    if len(split) > 1:
        rows["together"] = [sum(column) for column in zip(*rows.values(), strict=True)]
    lines = [[name, *map(duration, times), duration(sum(times))] for name, times in rows.items()]
    return markdown_table(["experiment", *there, "in all"], lines, "l" + "r" * (1 + len(there)))


def _split(split: Mapping[str, Mapping[str, float]], *, paper: bool) -> Picture:
    """A stacked bar an experiment, one after the other; the aim where counts are the paper's."""
    unit, word = (3600.0, "hours") if paper else (60.0, "minutes")
    with styled():
        figure = new_figure(0.95 + 0.38 * len(split))
        axes = figure.add_subplot()
        left = 0.0
        for y, kinds in enumerate(split.values()):
            begin = left
            for kind, seconds in kinds.items():
                label = kind if y == 0 else None
                axes.barh(y, seconds / unit, 0.6, left, color=KINDS[kind], label=label)
                left += seconds / unit
            axes.annotate(
                duration(sum(kinds.values())),
                (left, y),
                (6, 0),
                textcoords="offset points",
                va="center",
                bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 1.0},  # over the aim's line
            )
            if y:
                axes.plot([begin, begin], [y - 1, y], color=MUTED, linewidth=0.7, zorder=0)
        if paper:
            axes.axvline(AIM_HOURS, color=INK, linewidth=1.0, linestyle=":")
            axes.text(AIM_HOURS, -0.62, "aim ", ha="right", fontsize=8, color=MUTED)
        names = [COSTED[name] for name in split]
        axes.set_yticks(range(len(split)), names)
        axes.tick_params(axis="y", labelcolor=INK)
        axes.set_ylim(len(split) - 0.55, -0.75)
        axes.set_xlim(0, max(left, AIM_HOURS if paper else 0.0) * 1.14)
        axes.set_xlabel(word)
        bare_axis(axes, grid="x")
        figure.legend(loc="outside upper left", ncols=len(KINDS), frameon=False, fontsize=8.5)
        return render(figure, "cost", f"Time of {listed(names)} by kind of work")
