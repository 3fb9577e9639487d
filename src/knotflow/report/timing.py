"""Where the time of the experiments went."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from knotflow.report import markdown as md
from knotflow.report.results import Results, StageRun
from knotflow.report.section import COLOURS, Figures, bare_axis
from knotflow.viz.style import INK

DRAWN = 15
"""Stages in the figure."""


def timing(results: Results, figures: Figures) -> str:
    """The time and memory of each experiment, every stage counted once; the longest stages."""
    once: dict[str, StageRun] = {}
    for found in results.experiments.values():
        for stage in found.stages:
            known = once.setdefault(stage.identity, stage)
            if (stage.seconds or 0.0) > (known.seconds or 0.0):  # the others found it there
                once[stage.identity] = stage
    timed = [stage for stage in once.values() if stage.seconds is not None]
    if not timed:
        return "No run has recorded its stages yet."
    rows = []
    for name in dict.fromkeys(stage.experiment for stage in timed):
        own = [stage for stage in timed if stage.experiment == name]
        memory = max(stage.memory_mb or 0.0 for stage in own)
        rows.append(
            {
                "experiment": f"`{name}`",
                "stages": str(len(own)),
                "time": md.duration(_total(own)),
                "most memory": f"{memory:,.0f} MB" if memory else md.NOTHING,
            }
        )
    longest = sorted(timed, key=lambda stage: -(stage.seconds or 0.0))[:DRAWN]
    return md.join(
        f"All experiments took {md.duration(_total(timed))} in {len(timed)} stages. Times are "
        "wall-clock; a stage that several experiments share is counted once. Memory is the most "
        "that a process and its workers held at once.",
        md.table(rows),
        figures.draw(
            "stages",
            f"Wall-clock time of the {len(longest)} longest stages.",
            0.7 + 0.25 * len(longest),
            lambda figure: _plot(figure, longest),
        ),
    )


def _total(stages: Sequence[StageRun]) -> float:
    return sum(stage.seconds or 0.0 for stage in stages)


def _plot(figure: Figure, stages: Sequence[StageRun]) -> None:
    axes = figure.add_subplot()
    labels = [f"{stage.experiment}: {stage.node}".replace("_", " ") for stage in stages]
    minutes = [(stage.seconds or 0.0) / 60 for stage in stages]
    axes.barh(range(len(stages)), minutes, 0.62, color=COLOURS[0])
    for y, stage in enumerate(stages):
        place = (minutes[y], y)
        axes.annotate(
            md.duration(stage.seconds), place, (5, 0), textcoords="offset points", va="center"
        )
    axes.set_yticks(range(len(stages)), labels)
    axes.tick_params(axis="y", labelcolor=INK)
    axes.set_ylim(len(stages) - 0.4, -0.6)
    axes.set_xlim(0, max([*minutes, 1e-9]) * 1.22)
    axes.set_xlabel("minutes")
    bare_axis(axes, "x")
