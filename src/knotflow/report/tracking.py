"""Sec. VI: ropes followed through whole rollouts."""

from __future__ import annotations

from typing import Any

import pandas as pd

from knotflow.intervals import wilson
from knotflow.report.results import AMOUNT, COUNT, FLAG, SHARE, TEXT, Results
from knotflow.report.section import Pictures, Section
from knotflow.report.statistics import bootstrap, mean_difference
from knotflow.report.style import Picture, bare_axis, new_figure, render, styled
from knotflow.report.tables import NOTHING, estimate, markdown_table, percent

EXPERIMENT = "tracking"
COLUMNS = {"method": TEXT, "level": COUNT, "action": TEXT, "rollout": TEXT, "frame": COUNT}
COLUMNS |= {"mean_error_mm": AMOUNT, "visible_share": SHARE, "seconds": AMOUNT}
COLUMNS |= dict.fromkeys(("state_correct", "lost", "moving"), FLAG)
MISPLACED = "camera_misplaced"
TRACKER, YARDSTICK = "rendering_mujoco", "point_drift"
COLOURS = ("#56b4e9", "#009e73", "#0072b2", "#e69f00", "#cc79a7")


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure, the table, and the difference from the yardstick."""
    key = ("method", "rollout", "frame")
    tracks = results.table(EXPERIMENT, "tracks.csv", COLUMNS, key)
    if tracks is None:
        return None
    lines = [
        [str(method).replace("_", " "), str(level), *_line(of)]
        for (method, level), of in tracks.groupby(["method", "level"], sort=False)
    ]
    header = ["method", "level", "rollouts", "error in motion, mm", "at rest, mm"]
    header += ["median at rest", "end state right", "images lost", "CPU time an image"]
    means = tracks[tracks["moving"]].groupby(["method", "rollout"])["mean_error_mm"].mean()
    both = {TRACKER, YARDSTICK} <= set(means.index.get_level_values(0))
    return {
        "table": markdown_table(header, lines, "llrrrrrrr"),
        "figure": pictures.add(_figure(tracks)),
        "misplaced": (tracks["method"] == MISPLACED).any(),
        "difference": estimate(mean_difference(means[TRACKER], means[YARDSTICK], paired=True))
        if both
        else None,
    }


def _line(of: pd.DataFrame) -> list[str]:
    ends = of.loc[of.groupby("rollout")["frame"].idxmax()]
    moving = of[of["moving"]]
    motion = moving.groupby("rollout")["mean_error_mm"].mean()
    return [
        str(len(ends)),
        estimate(bootstrap(motion)) if len(motion) else NOTHING,
        estimate(bootstrap(ends["mean_error_mm"])),
        f"{ends['mean_error_mm'].median():.1f}",
        percent(wilson(int(ends["state_correct"].sum()), len(ends))),
        f"{100 * of['lost'].mean():.1f} %",
        f"{1000 * of['seconds'].median():.0f} ms" if of["seconds"].any() else NOTHING,
    ]


def _figure(tracks: pd.DataFrame) -> Picture:
    """Mean error from image to image, a panel a level, a line a method."""
    followed = tracks[tracks.groupby("method")["frame"].transform("nunique") > 1]
    levels = sorted(followed["level"].unique())
    with styled():
        figure = new_figure(2.8)
        panels = figure.subplots(1, len(levels), sharey=True, squeeze=False)[0]
        for axes, level in zip(panels, levels, strict=True):
            of_level = followed[followed["level"] == level]
            methods = of_level.groupby("method", sort=False)
            for colour, (method, of) in zip(COLOURS, methods, strict=False):
                error = of.groupby("frame")["mean_error_mm"].mean()
                axes.plot(error, color=colour, label=str(method).replace("_", " "))
            axes.set(title=f"level {level}", xlabel="image")
            bare_axis(axes, grid="y")
        panels[0].set_ylabel("error of a vertex, mm (mean)")
        panels[0].set_ylim(bottom=0)
        lines, labels = panels[0].get_legend_handles_labels()
        figure.legend(lines, labels, loc="outside upper left", ncols=len(labels), frameon=False)
        return render(figure, "tracking", "Error of tracked ropes from image to image, by method")


SECTION = Section(
    EXPERIMENT,
    "Ropes followed in motion",
    "Sec. VI",
    "Ropes tracked from image to image while a gripper drags them, against a classical tracker.",
    values,
)
