"""How fast the simulator is (not in the paper)."""

from __future__ import annotations

from typing import Any

import pandas as pd

from knotflow.report.results import AMOUNT, AT_LEAST_ONE, TEXT, Results, refuse
from knotflow.report.section import Pictures, Section
from knotflow.report.style import Picture
from knotflow.report.tables import NOTHING, duration, markdown_table, number
from knotflow.report.timing import bars

EXPERIMENT = "benchmark"
#: splines_per_second may be a mean over repeats instead of rollouts / seconds.
TOLERANCE = 0.05
COLUMNS = {"case": TEXT, **dict.fromkeys(("links", "threads", "rollouts"), AT_LEAST_ONE)}
COLUMNS |= dict.fromkeys(("seconds", "splines_per_second", "peak_memory_mb"), AMOUNT)

WORKERS = {"backend": TEXT, "workers": AT_LEAST_ONE, "shards": AT_LEAST_ONE}
WORKERS |= dict.fromkeys(("seconds", "splines_per_second"), AMOUNT)


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure and its table."""
    cases = results.table(EXPERIMENT, "throughput.csv", COLUMNS)
    if cases is None:
        return None
    if "root" in cases:  # tables made before there was a choice have none
        cases = cases.assign(case=cases["case"] + ", rooted at the " + cases["root"].astype(str))
    executed = cases["splines_per_second"] * cases["seconds"]
    wrong = (executed - cases["rollouts"]).abs() > TOLERANCE * cases["rollouts"]
    problem = "{splines_per_second:g} for {seconds:g} s makes no {rollouts} rollouts"
    refuse(cases, "splines_per_second", wrong, problem)
    lines = [
        [
            case.case,
            str(case.links),
            str(case.threads),
            f"{case.rollouts:,}",
            duration(case.seconds),
            f"{case.splines_per_second:.1f}",
            f"{case.peak_memory_mb:,.0f} MB",
        ]
        for case in cases.itertuples()
    ]
    header = ["case", "links", "threads", "rollouts", "time", "splines / s", "peak memory"]
    fastest = cases.loc[cases["splines_per_second"].idxmax()].to_dict()
    return {
        "figure": pictures.add(_figure(cases)),
        "table": markdown_table(header, lines, "lrrrrrr"),
        "fastest": fastest,
        "speed": number(fastest["splines_per_second"]),
        "scaling": _scaling(results),
    }


def _scaling(results: Results) -> str:
    """A line a kind of workers, beside one; empty where none were timed."""
    cases = results.table(EXPERIMENT, "scaling.csv", WORKERS)
    if cases is None:
        return ""
    alone = cases.loc[cases["workers"] == 1, "seconds"]
    lines = [
        [
            case.backend,
            str(case.workers),
            duration(case.seconds),
            f"{case.splines_per_second:.1f}",
            f"{alone.iloc[0] / case.seconds:.2f}×" if len(alone) else NOTHING,
        ]
        for case in cases.itertuples()
    ]
    header = ["workers", "how many", "time", "splines / s", "beside one"]
    return markdown_table(header, lines, "lrrrr")


def _figure(cases: pd.DataFrame) -> Picture:
    """Splines executed per second, a bar a measured case."""
    labels = [
        f"{case.case}\n{case.links} links, {case.threads} thread{'s' if case.threads > 1 else ''}"
        for case in cases.itertuples()
    ]
    speeds = cases["splines_per_second"].tolist()
    return bars(
        labels,
        speeds,
        [f"{speed:.1f} / s" for speed in speeds],
        axis="splines simulated per second",
        name="throughput",
        alt=f"Splines simulated per second in {len(cases)} cases",
        line=0.46,
    )


SECTION = Section(
    EXPERIMENT,
    "Throughput of the simulator",
    "Not in the paper",
    "Splines executed per second, start to finish, and the memory it takes.",
    values,
)
