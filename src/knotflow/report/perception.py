"""Ropes estimated from one RGB-D image at rest, tracked through rollouts, predicted (Sec. VI)."""

from __future__ import annotations

import itertools

import pandas as pd

from knotflow.report import markdown as md
from knotflow.report.results import Results
from knotflow.report.section import COLOURS, Figures, Parts, optional
from knotflow.report.training import Line, draw_curves
from knotflow.statistics import bootstrap

EXPERIMENT = "perception"
COLUMNS = {"method": str, "noise": float, "crossings": int, "rope": int, "seconds": float}
COLUMNS |= dict.fromkeys(("mean_error_mm", "off_curve_error_mm", "diameter_mm"), float)
COLUMNS |= dict.fromkeys(("state_correct", "head_correct", "doubtful"), bool)
KEY = ("method", "noise", "crossings", "rope")
PLANS = {"rope": str, "planned_from": str, "planned": bool, "tied": bool}
GROUPS = ((0, 3), (4, 5))
"""Ropes are grouped by their number of crossings, from and to."""
DIAMETERS = (4, 8, 14, 25)  # mm, ends of the groups that are told apart
FULL = "full"
METHODS = {
    "network_rendering": "network + rendering",
    FULL: "complete",
    "full_without_colour": "complete, without the guess by colour",
    "full_without_network": "complete, without the network",
    "full_without_depth": "complete, without depth",
}
"""Methods and what the report calls them; others, of older results, are not shown."""
ABLATIONS = [name for name in METHODS if name.startswith("full_")]

TRACKS = {"method": str, "level": int, "action": str, "rollout": str, "frame": int}
TRACKS |= {"mean_error_mm": float, "seconds": float}
TRACKS |= dict.fromkeys(("state_correct", "lost", "moving"), bool)
TRACKERS = {
    "rendering_lstm": "LSTM",
    "rendering_mujoco": "MuJoCo",
    "rendering_mujoco_at_rest": "MuJoCo, refined at rest",
    "camera_misplaced": "calibration error alone",
}
"""Methods and what the report calls them; others, of older results, are not shown."""
MODELS = {"still": "static", "lstm": "bidirectional LSTM", "mujoco": "MuJoCo, nominal rope"}
"""Models of the rope's dynamics in the order shown, and what they are called."""
STEP = 0.1  # s
ERRORS = {"model": str, "level": int, "steps": int, "motions": int, "mean_error_mm": float}


def perception(results: Results, figures: Figures) -> Parts:
    """Accuracy by crossings, the table of methods, ambiguity, and plans from estimates."""
    table = results.table(EXPERIMENT, "estimates.csv", COLUMNS, KEY)
    table = table[table["method"].isin(METHODS)]
    own = table[table["method"] == FULL]
    kinds = [(METHODS[str(name)], some) for name, some in table.groupby("method", sort=False)]
    ablations = table[table["method"].isin(ABLATIONS)][[*KEY[1:]]].drop_duplicates()
    if 0 < len(shared := own.merge(ablations)) < len(own):
        kinds.append(("complete, on these ropes", shared))
    lines = [
        _line(name, noise, some, own)
        for name, of_kind in kinds
        for noise, every in of_kind.groupby("noise", sort=False)
        for low, high in GROUPS
        if len(some := every[every["crossings"].between(low, high)])
    ]
    return {
        "figure": _by_crossings(figures, own),
        "methods": md.table(lines),
        "unambiguous": _unambiguous(own),
        "diameters": _diameters(own),
        "example": figures.own(
            EXPERIMENT,
            "estimates.png",
            "The complete method at noise 1, on the first rope of each number of crossings: the "
            "image, and the estimate on a detail of it. Vertices that it does not show are ringed.",
        ),
        "plans": _plans(results),
    }


def _mean(errors: pd.Series) -> str:
    errors = errors.dropna()
    return md.estimate(bootstrap(errors)) if len(errors) else md.NOTHING


def _line(name: str, noise: float, some: pd.DataFrame, full: pd.DataFrame) -> dict[str, str]:
    """Estimates `some` at one level of noise, beside those of the complete method."""
    wrong = some[~some["state_correct"]]
    same = some.merge(full, on=["noise", "crossings", "rope"], suffixes=("", "_full"))
    return {
        "method": name,
        "noise": f"{noise:g}",
        "crossings": f"{some['crossings'].min()} to {some['crossings'].max()}",
        "ropes": str(len(some)),
        "vertex error, mm": _mean(some["mean_error_mm"]),
        "curve error, mm": _mean(some["off_curve_error_mm"]),
        "state accuracy": md.rate(some["state_correct"]),
        "complete": f"{same['state_correct_full'].sum()} of {len(same)}",
        "flagged": f"{wrong['doubtful'].sum()} of {len(wrong)}",
        "head accuracy": md.rate(some["head_correct"]),
        "CPU time": f"{some['seconds'].median():.1f} s",
    }


def _unambiguous(shown: pd.DataFrame) -> str:
    """For each level of noise, how many estimates are unambiguous, and how many of these right."""
    parts = [
        f"{md.rate(sure['state_correct'])} at noise {noise:g} ({len(sure)} of {len(own)} ropes)"
        for noise, own in shown.groupby("noise")
        if len(sure := own[~own["doubtful"]])
    ]
    about = (
        "An estimate reports whether it is ambiguous. The state accuracy of unambiguous estimates "
        f"by the complete method is {md.listed(parts)}."
    )
    return about if parts else ""


def _diameters(shown: pd.DataFrame) -> str:
    """State accuracy by diameter at all levels of noise."""
    names = [f"{low} to {high} mm" for low, high in itertools.pairwise(DIAMETERS)]
    groups = pd.cut(shown["diameter_mm"], DIAMETERS, labels=names, include_lowest=True)
    parts = [
        f"{md.rate(own['state_correct'])} for {name}"
        for name, own in shown.groupby(groups, observed=True)
    ]
    return (
        "Over all levels of noise, the state accuracy of the complete method by diameter is "
        f"{md.listed(parts)}."
    )


@optional
def _plans(results: Results) -> str:
    """Shares of ropes with a plan, and of plans that tie the true rope; '' without plans."""
    plans = results.table(EXPERIMENT, "plans.csv", PLANS, ("rope", "planned_from"))
    parts = [
        f"from {planned_from} shapes, {md.rate(own['planned'])} of {len(own)} random ropes had a "
        f"plan and {md.rate(own['tied'])} were tied"
        for planned_from, own in plans.groupby("planned_from")
    ]
    return f"Plans for the overhand, executed in simulation on the true rope: {'; '.join(parts)}."


def _by_crossings(figures: Figures, shown: pd.DataFrame) -> str:
    """State accuracy and median vertex error, a line a level of noise."""
    ropes = sorted(set(shown.groupby(["noise", "crossings"]).size()))
    caption = (
        "State accuracy and median vertex error of the complete method by number of crossings, "
        f"{md.listed([*map(str, ropes)])} ropes a point."
    )
    panels: dict[str, list[Line]] = {"state accuracy": [], "vertex error, mm (median rope)": []}
    for colour, (noise, own) in zip(COLOURS, shown.groupby("noise"), strict=False):
        by = own.groupby("crossings")
        curves = by["state_correct"].mean(), by["mean_error_mm"].median()
        for lines, curve in zip(panels.values(), curves, strict=True):
            lines.append(Line(curve, colour, f"noise {noise:g}", {"marker": "o", "markersize": 4}))
    rates = ["state accuracy"]
    return draw_curves(figures, EXPERIMENT, caption, panels, "crossings", rates, legend=True)


def tracking(results: Results, figures: Figures) -> Parts:
    """The error in motion and at rest by method and level."""
    tracks = results.table("tracking", "tracks.csv", TRACKS, ("method", "rollout", "frame"))
    tracks = tracks[tracks["method"].isin(TRACKERS)]
    rows = [
        {"method": TRACKERS[str(method)], "level": str(level)} | _track_line(own)
        for (method, level), own in tracks.groupby(["method", "level"], sort=False)
    ]
    return {
        "figure": _over_time(figures, tracks),
        "methods": md.table(rows),
    }


def _track_line(own: pd.DataFrame) -> dict[str, str]:
    ends = own.loc[own.groupby("rollout")["frame"].idxmax()]
    motion = own[own["moving"]].groupby("rollout")["mean_error_mm"].mean()
    time = f"{1000 * own['seconds'].median():.0f} ms" if own["seconds"].any() else md.NOTHING
    return {
        "rollouts": str(len(ends)),
        "error in motion, mm": _mean(motion),
        "error at rest, mm": _mean(ends["mean_error_mm"]),
        "median at rest, mm": f"{ends['mean_error_mm'].median():.1f}",
        "state accuracy at rest": md.rate(ends["state_correct"]),
        "images lost": f"{100 * own['lost'].mean():.1f} %",
        "CPU time an image": time,
    }


def _over_time(figures: Figures, tracks: pd.DataFrame) -> str:
    """Error over time while half of the rollouts last: a panel a level, a line a method, its
    median, and a thinner one, its mean."""
    images = tracks.groupby(["method", "rollout"])["frame"].transform("size")
    styles = {"median": {}, "mean": {"linewidth": 1.0, "linestyle": "--"}}
    panels = {
        f"level {level}: vertex error, mm": [
            Line(
                _while_half_last(own, measure),
                COLOURS[place],
                f"{TRACKERS[method]}, {measure}",
                style,
            )
            for place, (method, own) in enumerate(of_level.groupby("method", sort=False))
            for measure, style in styles.items()
        ]
        for level, of_level in tracks[images > 1].groupby("level")
    }
    caption = (
        "Vertex error over time, by method and level, as long as half of the rollouts run: the "
        "median, and the mean (dashed), which a few rollouts raise."
    )
    return draw_curves(
        figures, "tracking", caption, panels, "seconds", legend=True, same_scale=True
    )


def _while_half_last(own: pd.DataFrame, measure: str) -> pd.Series:
    """Mean or median error by time, seconds."""
    errors = own.groupby("frame")["mean_error_mm"].agg([measure, "size"])
    shown = errors.loc[2 * errors["size"] >= own["rollout"].nunique(), measure]
    return shown.set_axis(STEP * shown.index)


def dynamics(results: Results, _: Figures) -> Parts:
    """A line a model and level, a column a number of steps."""
    errors = results.table("dynamics", "errors.csv", ERRORS, ("model", "level", "steps"))
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


PHOTOGRAPHS = {"image": str, "crossings": int, "crossings_correct": bool, "state_correct": bool}
PHOTOGRAPHS |= {"doubtful": bool, "share_within_half_width": float, "seconds": float}


def real_images(results: Results, _: Figures) -> Parts:
    """How many photographs are read correctly, by their number of crossings."""
    table = results.table("real_images", "real_images.csv", PHOTOGRAPHS, ("image",))
    rows = []
    for name, own in [*table.groupby("crossings"), ("all", table)]:
        sure = own[~own["doubtful"]]["state_correct"]
        rows.append(
            {
                "crossings": f"{name}",
                "number correct": md.share(own["crossings_correct"]),
                "state correct": md.share(own["state_correct"]),
                "of those without doubt": md.share(sure) if len(sure) else md.NOTHING,
                "centre line": md.share(own["share_within_half_width"] >= 0.95),
                "seconds, median": f"{own['seconds'].median():.1f}",
            }
        )
    return {"counts": md.table(rows)}
