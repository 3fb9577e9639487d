"""Rates and their confidence intervals, the same in every table and in the report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from scipy import stats

LEVEL = 0.95


@dataclass(frozen=True)
class Interval:
    """An estimate and its confidence limits, which are None where the data allow none."""

    estimate: float
    low: float | None
    high: float | None

    def lies_above(self, value: float) -> bool:
        """Whether the whole interval lies above `value`."""
        return self.low is not None and self.low > value

    def reaches(self, value: float) -> bool:
        """Whether `value` or more is compatible with the data."""
        return (self.estimate if self.high is None else self.high) >= value


def wilson(successes: int, trials: int, level: float = LEVEL) -> Interval:
    """Wilson score interval of a success rate.

    Raises:
        ValueError: no trials, or successes outside 0..trials.
    """
    if trials < 1 or not 0 <= successes <= trials:
        raise ValueError(
            f"{successes} successes in {trials} trials is no rate; "
            "needs trials >= 1 and 0 <= successes <= trials"
        )
    limits = stats.binomtest(successes, trials).proportion_ci(level, method="wilson")
    return Interval(successes / trials, float(limits.low), float(limits.high))


def rate_columns(successes: Iterable[int], trials: Iterable[int]) -> dict[str, list[float | None]]:
    """The columns success_rate, ci_low and ci_high of a table, with 95 % Wilson limits."""
    rates = [wilson(int(hits), int(count)) for hits, count in zip(successes, trials, strict=True)]
    return {
        "success_rate": [one.estimate for one in rates],
        "ci_low": [one.low for one in rates],
        "ci_high": [one.high for one in rates],
    }
