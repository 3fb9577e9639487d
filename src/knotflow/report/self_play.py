"""Self-play on all actions: how its trials went, and what was tried (Sec. V-B c, and beyond)."""

from __future__ import annotations

from typing import Any

from knotflow.report.learning import COLOURS, SHORT, Curves, panel, read_curves, smoothed
from knotflow.report.paper import PRIMITIVES
from knotflow.report.results import AT_LEAST_ONE, COUNT, SHARE, TEXT, Results, refuse
from knotflow.report.section import Pictures, Section
from knotflow.report.style import INK, MUTED, Picture, new_figure, render, styled

EXPERIMENT = "library_training"
#: The primitives by number: the paper's four, and those beyond it.
NAMES = {number: SHORT.get(one.name, one.name) for number, one in enumerate(PRIMITIVES, 1)}
NAMES |= {5: "5: arranging, state kept", 6: "6: undoing"}
SUCCESS = "policy_success"
#: Pairs of state and action, which primitive 1's curves count.
PAIRS = {"pairs_tried": "tried", "pairs_solved": "done at least once"}
KEY = ("start", "action")
COLUMNS = {"start": TEXT, "action": TEXT, "trials": AT_LEAST_ONE, "successes": COUNT}


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The learning curves, and what was tried."""
    curves = read_curves(results, EXPERIMENT, "curves.csv")
    if curves is None:
        return None
    return {
        "self_play": pictures.add(self_play(curves, EXPERIMENT)),
        "trials": trials(results, EXPERIMENT),
    }


def trials(results: Results, experiment: str) -> dict[str, Any] | None:
    """How much was tried, and how much of it was done; None without trials.csv."""
    columns = COLUMNS | {"recent_rate": SHARE}
    table = results.table(experiment, "trials.csv", columns, key=KEY)
    if table is None:
        return None
    impossible = table["successes"] > table["trials"]
    refuse(table, "successes", impossible, "{successes} of only {trials} trials")
    return {
        "trials": f"{table['trials'].sum():,}",
        "pairs": f"{len(table):,}",
        "solved": f"{(table['successes'] > 0).sum():,}",
        "often": f"{(table['recent_rate'] > 0.5).sum():,}",
    }


def self_play(curves: Curves, name: str) -> Picture:
    """The policy's own success by primitive, and the pairs of state and action that are known."""
    played = {number: curves[number, SUCCESS] for number in NAMES if (number, SUCCESS) in curves}
    colours = (*COLOURS, INK, MUTED)
    with styled():
        figure = new_figure(2.6)
        rates, pairs = figure.subplots(1, 2, width_ratios=[3, 2])
        for number, curve in played.items():
            # Hundreds of rounds: the mean of equal stretches is what can be seen.
            stretch = max(1, len(curve) // 60)
            mean = curve.rolling(stretch).mean().dropna()[::stretch]
            rates.plot(
                mean.index, smoothed(mean.tolist()),
                color=colours[number - 1], linewidth=1.5, label=NAMES[number],
            )  # fmt: skip
        rates.set_ylim(0, 1.04)
        panel(rates, "the policy's own splines that succeed", rate=True)
        for colour, (metric, label) in zip((MUTED, COLOURS[0]), PAIRS.items(), strict=True):
            if (1, metric) in curves:
                pairs.plot(curves[1, metric], color=colour, linewidth=1.5, label=label)
        pairs.set_ylim(0, None)
        panel(pairs, "pairs of state and action")
        pairs.yaxis.set_major_formatter("{x:,.0f}")
        pairs.legend(loc="upper left", frameon=False, fontsize=7.5)
        handles, labels = rates.get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside upper left", ncols=3, frameon=False, fontsize=7.5
        )
        return render(figure, name, f"Self-play of {len(played)} primitives by round")


SECTION = Section(
    EXPERIMENT,
    "Training: longer self-play",
    "Sec. V-B c",
    "The primitives go on learning all actions from ropes that they made themselves.",
    values,
)
