"""Numbers as the report writes them, and Markdown made of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from knotflow.statistics import Interval, wilson

NOTHING = "–"
"""Where nothing was measured."""
NUMBER = re.compile(r"(at least |both )?[−–\d]")


def join(*parts: str) -> str:
    """Blocks of Markdown with an empty line between them; empty ones are left out."""
    return "\n\n".join(part.strip() for part in parts if part.strip())


def table(rows: Sequence[Mapping[str, str]], intro: str = "") -> str:
    """A Markdown table of rows with the same columns after its `intro`; '' without rows.

    Columns of numbers are aligned to the right.
    """
    if not rows:
        return ""
    columns = list(rows[0])
    right = [all(NUMBER.match(row[name]) for row in rows) for name in columns]
    lines = [columns, ["---:" if one else "---" for one in right]]
    lines += [[row[name].replace("|", r"\|") for name in columns] for row in rows]
    return join(intro, "\n".join("| " + " | ".join(line) + " |" for line in lines))


def slug(title: str) -> str:
    """The anchor of a heading: `Fig. 6: rates` is `fig-6-rates`."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def number(value: float) -> str:
    """Three digits, at most two of them decimals: 0.32, 3.00, 30.0, 300, 3,000."""
    digits = 2 if abs(value) < 9.995 else 1 if abs(value) < 99.95 else 0
    return f"{value:,.{digits}f}".replace("-", "−")


def tenths(value: float) -> str:
    """One decimal, as the paper has them: `4.3`, and none above a hundred: `1,428`."""
    return f"{value:,.{1 if abs(value) < 99.95 else 0}f}".replace("-", "−")


def whole(value: float) -> str:
    """The nearest whole number, halves rounded up: `95` for 94.5."""
    return f"{math.floor(round(value, 6) + 0.5):d}"


def estimate(interval: Interval, written: Callable[[float], str] = tenths) -> str:
    """A mean, median or difference with its limits: `4.3 (3.7 to 5.1)`."""
    if math.isnan(interval.low):
        return written(interval.estimate)
    limits = f" ({written(interval.low)} to {written(interval.high)})"
    return f"{written(interval.estimate)}{limits}"


def percent(rate: Interval) -> str:
    """A rate with its limits in per cent: `3.5 % (2.1 to 5.8)`."""
    value, _, limits = estimate(rate, lambda value: f"{100 * value:.1f}").partition(" ")
    return f"{value} % {limits}".strip()


def rate(hits: Any) -> str:
    """How many of `hits` are true, with Wilson's limits: `75.0 % (30.1 to 95.4)`."""
    return percent(wilson(int(np.sum(hits)), len(hits)))


def share(hits: Any) -> str:
    """The same with the counts: `75.0 % (30.1 to 95.4)<br>3 of 4`."""
    return f"{rate(hits)}<br>{np.sum(hits)} of {len(hits)}" if len(hits) else NOTHING


def times(ratio: Interval) -> str:
    """A ratio with its limits: `12.0× (8.10 to 19.0)`; where the base is 0, `at least 8.10×`."""
    if math.isnan(ratio.estimate):
        return "both 0"
    if math.isinf(ratio.estimate):
        return f"at least {number(ratio.low)}×"
    if math.isinf(ratio.high):
        return f"{number(ratio.estimate)}× (at least {number(ratio.low)})"
    value, _, limits = estimate(ratio, number).partition(" ")
    return f"{value}× {limits}".strip()


def duration(seconds: float | None) -> str:
    """Seconds as a person says them: `0.8 s`, `42 s`, `3 min 20 s`, `2 h 5 min`."""
    if seconds is None or math.isnan(seconds):
        return NOTHING
    if seconds < 59.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    if seconds < 3570:
        return f"{int(seconds + 0.5) // 60} min {int(seconds + 0.5) % 60} s"
    minutes = int(seconds / 60 + 0.5)
    return f"{minutes // 60} h {minutes % 60} min"
