"""Numbers as the report writes them, and Markdown tables of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from knotflow.intervals import Interval

#: Where nothing was measured.
NOTHING = "–"


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]], align: str = "") -> str:
    """A Markdown table; `align` has one of `l`, `r`, `c` a column, the rest are `l`."""
    marks = {"l": "---", "r": "---:", "c": ":---:"}
    rule = [marks[side] for side in align.ljust(len(header), "l")]
    lines = [header, rule, *([cell.replace("|", r"\|") for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def number(value: float) -> str:
    """Three digits, at most two of them decimals: 0.32, 3.00, 30.0, 300, 3,000."""
    digits = 2 if abs(value) < 9.995 else 1 if abs(value) < 99.95 else 0
    return f"{value:,.{digits}f}".replace("-", "−")


def percent(rate: Interval) -> str:
    """A rate with its limits in per cent: `3.5 % (2.1 to 5.8)`."""
    return f"{100 * rate.estimate:.1f} %{_limits(rate, lambda v: f'{100 * v:.1f}')}"


def times(ratio: Interval) -> str:
    """A ratio with its limits: `12× (8.1 to 19)`; where the base is 0, `at least 8.1×`."""
    if math.isnan(ratio.estimate):
        return "both 0"
    if math.isinf(ratio.estimate):
        return f"at least {number(ratio.low or 0.0)}×"
    if ratio.high is not None and math.isinf(ratio.high):
        return f"{number(ratio.estimate)}× (at least {number(ratio.low or 0.0)})"
    return f"{number(ratio.estimate)}×{_limits(ratio, number)}"


def estimate(interval: Interval) -> str:
    """A mean, median or difference of counts with its limits: `4.3 (3.7 to 5.1)`."""
    return f"{tenths(interval.estimate)}{_limits(interval, tenths)}"


def tenths(value: float) -> str:
    """One decimal, as the paper has them: `4.3`, and none above a hundred: `1,428`."""
    return f"{value:,.{1 if abs(value) < 99.95 else 0}f}".replace("-", "−")


def duration(seconds: float | None) -> str:
    """Seconds as a person says them: `0.8 s`, `42 s`, `3 min 20 s`, `2 h 5 min`."""
    if seconds is None:
        return NOTHING
    if seconds < 59.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    if seconds < 3570:
        return f"{int(seconds + 0.5) // 60} min {int(seconds + 0.5) % 60} s"
    minutes = int(seconds / 60 + 0.5)
    return f"{minutes // 60} h {minutes % 60} min"


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _limits(interval: Interval, written: Callable[[float], str]) -> str:
    if interval.low is None or interval.high is None:
        return ""
    return f" ({written(interval.low)} to {written(interval.high)})"
