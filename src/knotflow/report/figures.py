"""One function a figure, each from records alone."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator, PercentFormatter

from knotflow.report.paper import OVERHAND_LIMIT, PRIMITIVES, Arm, in_order
from knotflow.report.records import Rates, Search, Searches, Throughput
from knotflow.report.results import Stage
from knotflow.report.statistics import bootstrap
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
from knotflow.report.tables import duration

#: Points across, of a dot that stands for all searches of its line.
LARGEST_DOT = 17.0


def success_rates(rates: Rates, arms: Sequence[Arm], name: str) -> Picture:
    """Fig. 6 and Fig. 7: a group of bars an action, separators between the four primitives.

    Whiskers are 95 % Wilson intervals, the number above each is the rate in per cent. An arm that
    was not run has no bars and says so in the key.
    """
    actions = in_order(rates.actions)
    run = [arm for arm in arms if arm.name in rates.methods]
    width = min(0.8 / len(run), 0.3)
    with styled():
        figure = new_figure(3.7)
        axes = figure.add_subplot()
        for place, arm in enumerate(run):
            offset = (place - (len(run) - 1) / 2) * width
            for group, action in enumerate(actions):
                _bar(axes, rates, arm, action, group + offset, width)
        _separate_primitives(axes, actions)
        axes.set_xticks(range(len(actions)), actions)
        axes.set_xlim(-0.55, len(actions) - 0.45)
        axes.set_ylim(0, 1.13)
        axes.set_yticks(np.linspace(0, 1, 6))
        axes.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
        axes.set_ylabel("success rate")
        bare_axis(axes, grid="y")
        _key(axes, arms, {arm.name for arm in run})
        measured = ", ".join(arm.label for arm in run)
        alt = f"Success rate on {len(actions)} topological actions: {measured}"
        return render(figure, name, alt)


def _bar(axes: Axes, rates: Rates, arm: Arm, action: str, x: float, width: float) -> None:
    rate = rates.get(arm.name, action)
    if rate is None:
        axes.annotate("–", (x, 0), (0, 3), textcoords="offset points", color=MUTED, ha="center")
        return
    value, low, high = rate.interval.estimate, rate.interval.low, rate.interval.high
    assert low is not None and high is not None
    axes.bar(x, value, width * 0.9, color=arm.colour)
    axes.plot([x, x], [low, high], color=INK, linewidth=0.9, solid_capstyle="butt")
    percent = 100 * value
    axes.annotate(
        f"{percent:.1f}" if 0 < percent < 9.95 else f"{percent:.0f}",
        (x, high),
        (0, 2),
        textcoords="offset points",
        ha="center",
        fontsize=6.5,
        color=MUTED,
    )


def _separate_primitives(axes: Axes, actions: list[str]) -> None:
    left = 0
    for primitive in PRIMITIVES:
        count = sum(action in actions for action in primitive.actions)
        if not count:
            continue
        if left:
            axes.axvline(left - 0.5, color=INK, linewidth=0.8)
        # A name is written out where its group is wide enough for it.
        name = primitive.name if count > 1 or len(primitive.name) < 8 else primitive.name[0]
        axes.text(left + (count - 1) / 2, 1.09, name, ha="center", fontsize=8, color=MUTED)
        left += count
    if 0 < left < len(actions):
        axes.axvline(left - 0.5, color=INK, linewidth=0.8)


def _key(axes: Axes, arms: Sequence[Arm], run: set[str]) -> None:
    handles = [
        Patch(
            facecolor=arm.colour if arm.name in run else "none",
            edgecolor=arm.colour if arm.name in run else MUTED,
            linestyle="-" if arm.name in run else ":",
            label=arm.label if arm.name in run else f"{arm.label} (not run yet)",
        )
        for arm in arms
    ]
    key = axes.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=len(arms),
        frameon=False,
        fontsize=8.5,
        handlelength=1.1,
        handleheight=0.9,
        borderaxespad=0.3,
        columnspacing=1.6,
    )
    for text, arm in zip(key.get_texts(), arms, strict=True):
        text.set_color(INK if arm.name in run else MUTED)


def branches(
    searches: Searches,
    arms: Sequence[Arm],
    starts: Sequence[str],
    name: str,
    paper_largest: dict[tuple[str, str], float],
) -> Picture:
    """Branches of each tree search, their mean with its interval, the paper's number.

    `paper_largest` has, by (start, arm), what the paper reports: drawn as a diamond. Open dots
    are searches that gave up.
    """
    lines = [(start, arm) for start in starts for arm in arms]
    longest = max([s.branches for s in searches] + [int(v) for v in paper_largest.values()])
    with styled():
        figure = new_figure(0.85 + 0.5 * len(lines) + 0.3 * (len(starts) - 1))
        axes = figure.add_subplot()
        axes.set_xscale("log")
        right = max(longest, 2 * OVERHAND_LIMIT)
        # Room for the largest dot on the line of the limit.
        left = OVERHAND_LIMIT * (right / OVERHAND_LIMIT) ** -0.035
        axes.set_xlim(left, right * 1.25)
        axes.axvline(OVERHAND_LIMIT, color=MUTED, linewidth=0.8, zorder=1)
        ticks, labels = [], []
        for place, (start, arm) in enumerate(lines):
            y = place + 0.7 * (place // len(arms))
            ticks.append(y)
            labels.append(f"{start}: {arm.label}" if start else arm.label)
            _branch_line(axes, searches.of(arm.name, start), arm, y)
            if (start, arm.name) in paper_largest:
                axes.plot(
                    paper_largest[start, arm.name],
                    y,
                    "D",
                    markersize=6,
                    markerfacecolor="none",
                    markeredgecolor=INK,
                    markeredgewidth=1,
                )
        axes.set_yticks(ticks, labels)
        axes.tick_params(axis="y", labelcolor=INK)
        axes.set_ylim(max(ticks) + 0.6, -0.6)
        _count_axis(axes, right)
        axes.set_xlabel("branches evaluated until the knot is tied")
        bare_axis(axes, grid="x")
        alt = f"Branches of {len(list(searches))} tree searches, by " + (
            "method and start" if len(starts) > 1 else "primitives"
        )
        return render(figure, name, alt)


def _branch_line(axes: Axes, searches: list[Search], arm: Arm, y: float) -> None:
    if not searches:
        axes.text(OVERHAND_LIMIT * 1.05, y, "not run yet", va="center", color=MUTED, fontsize=8.5)
        return
    # Equal counts are one dot, its area their share, with their number above it.
    for (count, solved), times in Counter((s.branches, s.solved) for s in searches).items():
        size = max(4.0, LARGEST_DOT * math.sqrt(times / len(searches)))
        axes.plot(
            count,
            y,
            "o",
            markersize=size,
            markerfacecolor=arm.colour if solved else PAPER,
            markeredgecolor=arm.colour,
            markeredgewidth=0.9,
            alpha=0.85,
        )
        if times > 1:
            axes.annotate(
                f"{times}",
                (count, y),
                (0.35 * size + 1.5, 0.35 * size),
                textcoords="offset points",
                fontsize=6.5,
                color=MUTED,
            )
    mean = bootstrap([search.branches for search in searches])
    if mean.low is not None and mean.high is not None:
        axes.plot([mean.low, mean.high], [y + 0.4] * 2, color=INK, linewidth=1.2)
    axes.plot(mean.estimate, y + 0.4, "|", color=INK, markersize=6, markeredgewidth=1.4)


def _count_axis(axes: Axes, longest: float) -> None:
    marks = [3, 4, 5, 6, 8, 10, 12, 15] if longest <= 16 else [3, 5, 10, 20, 50, 100, 200, 500]
    marks += [m * 10**k for k in range(3, 9) for m in (1, 2, 5)] if longest > 500 else []
    axes.xaxis.set_major_locator(FixedLocator([m for m in marks if m <= longest * 1.2]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))


def throughput(cases: Sequence[Throughput], name: str) -> Picture:
    """Splines executed a second, a bar a measured case."""
    with styled():
        labels = [f"{c.case}\n{c.links} links, {_threads(c.threads)}" for c in cases]
        alt = f"Splines simulated a second in {len(cases)} cases"
        values = [c.splines_per_second for c in cases]
        notes = [f"{c.splines_per_second:.1f} / s" for c in cases]
        return _bars(labels, values, notes, "splines simulated a second", name, alt, 0.46)


def stage_seconds(stages: Sequence[Stage], name: str) -> Picture:
    """Where the time of a set of stages went, a bar a stage."""
    with styled():
        values = [stage.seconds or 0.0 for stage in stages]
        labels = [stage.node for stage in stages]
        notes = [duration(stage.seconds) for stage in stages]
        alt = f"Wall-clock time of {len(stages)} stages"
        return _bars(labels, [v / 60 for v in values], notes, "minutes", name, alt, 0.3)


def _bars(
    labels: list[str],
    values: list[float],
    notes: list[str],
    axis: str,
    name: str,
    alt: str,
    line_height: float,
) -> Picture:
    figure = new_figure(0.7 + line_height * len(labels))
    axes = figure.add_subplot()
    places = range(len(labels))
    axes.barh(places, values, 0.62, color="#0072b2")
    for y, (value, note) in enumerate(zip(values, notes, strict=True)):
        axes.annotate(note, (value, y), (5, 0), textcoords="offset points", va="center")
    axes.set_yticks(places, labels)
    axes.tick_params(axis="y", labelcolor=INK)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.set_xlim(0, max(values + [1e-9]) * 1.16)
    axes.set_xlabel(axis)
    bare_axis(axes, grid="x")
    axes.axvline(0, color=RULE, linewidth=1.2)
    return render(figure, name, alt)


def _threads(count: int) -> str:
    return "1 thread" if count == 1 else f"{count} threads"
