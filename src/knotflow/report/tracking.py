"""Ropes in motion: tracked through whole rollouts, and predicted (Sec. VI)."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from knotflow.report import markdown as md
from knotflow.report.results import Results
from knotflow.report.section import COLOURS, Figures, Parts, bare_axis
from knotflow.statistics import bootstrap, mean_difference

COLUMNS = {"method": str, "level": int, "action": str, "rollout": str, "frame": int}
COLUMNS |= {"mean_error_mm": float, "seconds": float}
COLUMNS |= dict.fromkeys(("state_correct", "lost", "moving"), bool)
METHODS = {
    "rendering": "rendering",
    "rendering_lstm": "rendering, LSTM",
    "rendering_mujoco": "rendering, MuJoCo",
    "rendering_mujoco_at_rest": "rendering, MuJoCo, refined at rest",
    "point_drift": "point drift",
    "point_drift_predicted": "point drift, predicted",
    "camera_misplaced": "calibration error alone",
}
"""Methods and what the report calls them."""
TRACKER, BASELINE, CALIBRATION = "rendering_mujoco", "point_drift", "camera_misplaced"
MODELS = {"still": "static", "lstm": "bidirectional LSTM", "mujoco": "MuJoCo, nominal rope"}
"""Models of the rope's dynamics in the order shown, and what they are called."""
STEP = 0.1  # s
ERRORS = {"model": str, "level": int, "steps": int, "motions": int, "mean_error_mm": float}


def tracking(results: Results, figures: Figures) -> Parts | None:
    """The error in motion and at rest by method and level."""
    tracks = results.table("tracking", "tracks.csv", COLUMNS, ("method", "rollout", "frame"))
    if tracks is None:
        return None
    rows = [
        {"method": METHODS.get(method, method), "level": str(level)} | _line(own)
        for (method, level), own in tracks.groupby(["method", "level"], sort=False)
    ]
    return {
        "calibration": " *Calibration error alone* is no tracker: the true rope at rest, moved as "
        "far as the camera is from where it is believed to be."
        if CALIBRATION in set(tracks["method"])
        else "",
        "difference": _against_baseline(tracks),
        "figure": figures.draw(
            "tracking",
            "Mean vertex error from image to image, by method and level.",
            2.8,
            lambda figure: _plot(figure, tracks),
        ),
        "methods": md.table(rows),
    }


def _against_baseline(tracks: pd.DataFrame) -> str:
    """The difference in motion, paired by rollout; '' where one of the two is missing."""
    moving = tracks[tracks["moving"]]
    means = moving.groupby(["method", "rollout"])["mean_error_mm"].mean()
    if not {TRACKER, BASELINE} <= set(moving["method"]):
        return ""
    difference = md.estimate(mean_difference(means[TRACKER], means[BASELINE], paired=True))
    return (
        f"While the rope moves, the mean error of {METHODS[TRACKER]} minus that of "
        f"{METHODS[BASELINE]} is {difference} mm, paired by rollout."
    )


def _line(own: pd.DataFrame) -> dict[str, str]:
    ends = own.loc[own.groupby("rollout")["frame"].idxmax()]
    motion = own[own["moving"]].groupby("rollout")["mean_error_mm"].mean()
    time = f"{1000 * own['seconds'].median():.0f} ms" if own["seconds"].any() else md.NOTHING
    return {
        "rollouts": str(len(ends)),
        "error in motion, mm": md.estimate(bootstrap(motion)) if len(motion) else md.NOTHING,
        "error at rest, mm": md.estimate(bootstrap(ends["mean_error_mm"])),
        "median at rest": f"{ends['mean_error_mm'].median():.1f}",
        "state accuracy at rest": md.rate(ends["state_correct"]),
        "images lost": f"{100 * own['lost'].mean():.1f} %",
        "CPU time an image": time,
    }


def _plot(figure: Figure, tracks: pd.DataFrame) -> None:
    """Mean error from image to image, a panel a level, a line a method."""
    followed = tracks[tracks.groupby("method")["frame"].transform("nunique") > 1]
    levels = sorted(followed["level"].unique())
    panels = figure.subplots(1, len(levels), sharey=True, squeeze=False)[0]
    for axes, level in zip(panels, levels, strict=True):
        methods = followed[followed["level"] == level].groupby("method", sort=False)
        for colour, (method, own) in zip(COLOURS, methods, strict=False):
            error = own.groupby("frame")["mean_error_mm"].mean()
            axes.plot(error, color=colour, label=METHODS.get(method, method))
        axes.set_title(f"level {level}", fontsize=8.5)
        axes.set_xlabel("image")
        bare_axis(axes, "y")
    panels[0].set_ylabel("vertex error, mm (mean)")
    panels[0].set_ylim(bottom=0)
    lines, labels = panels[0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside upper left", ncols=len(labels), frameon=False)


def dynamics(results: Results, _: Figures) -> Parts | None:
    """A line a model and level, a column a number of steps."""
    errors = results.table("dynamics", "errors.csv", ERRORS, ("model", "level", "steps"))
    if errors is None:
        return None
    cells = errors.set_index(["model", "level", "steps"])["mean_error_mm"].map(md.tenths).to_dict()
    steps, levels = sorted(errors["steps"].unique()), sorted(errors["level"].unique())
    rows = [
        {"level": str(level), "model": MODELS.get(name, name)}
        | {f"after {STEP * n:g} s, mm": cells.get((name, level, n), md.NOTHING) for n in steps}
        for level in levels
        for name in [*MODELS, *sorted({*errors["model"]} - MODELS.keys())]
    ]
    motions = errors.groupby("level")["motions"].max().sum()
    return {"models": md.table(rows), "motions": str(motions)}
