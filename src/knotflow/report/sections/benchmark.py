"""How fast the simulator is (not in the paper)."""

from __future__ import annotations

from typing import Any

from knotflow.report import figures, tables
from knotflow.report.results import Results
from knotflow.report.sections.section import Pictures, Section

EXPERIMENT = "benchmark"


def values(results: Results, pictures: Pictures) -> dict[str, Any] | None:
    """The figure and its table."""
    cases = results.throughput
    if cases is None:
        return None
    fastest = max(cases, key=lambda case: case.splines_per_second)
    lines = [
        [
            case.case,
            str(case.links),
            str(case.threads),
            f"{case.rollouts:,}",
            tables.duration(case.seconds),
            f"{case.splines_per_second:.1f}",
            f"{case.peak_memory_mb:,.0f} MB",
        ]
        for case in cases
    ]
    header = ["case", "links", "threads", "rollouts", "time", "splines / s", "peak memory"]
    return {
        "figure": pictures.add(figures.throughput(cases, "throughput")),
        "table": tables.markdown_table(header, lines, "lrrrrrr"),
        "fastest": fastest,
        "speed": tables.number(fastest.splines_per_second),
    }


SECTION = Section(
    EXPERIMENT,
    "Throughput of the simulator",
    "Not in the paper",
    "Splines executed a second, start to finish, and the memory it takes.",
    values,
)
