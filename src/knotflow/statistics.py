"""Confidence intervals of rates, ratios, means and medians, the same in every table and report.

Rates and their ratios have their starts resampled where they are known start by start, otherwise
Wilson's and the MOVER-R interval. Counts and distances have a percentile bootstrap. Where a method
was trained several times, the trainings are resampled too (`resamples`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

Floats = NDArray[np.float64]

LEVEL = 0.95
TAILS = ((1 - LEVEL) / 2, (1 + LEVEL) / 2)
RESAMPLES = 9_999
SEED = 0
"""Of every bootstrap: the same results have to give the same report."""
FEW = 5
"""Fewer starts that succeed, or fail, are too few to resample."""


@dataclass(frozen=True)
class Interval:
    """An estimate and its 95 % limits, which are NaN where the data allow none."""

    estimate: float
    low: float = math.nan
    high: float = math.nan

    def lies_above(self, value: float) -> bool:
        """Whether the whole interval lies above `value`."""
        return self.low > value

    def reaches(self, value: float) -> bool:
        """Whether `value` or more is compatible with the data."""
        return (self.estimate if math.isnan(self.high) else self.high) >= value


def wilson(successes: int, trials: int) -> Interval:
    """Wilson score interval of a success rate; ValueError for more successes than trials."""
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} of {trials}: successes must be 0 to trials, and trials > 0")
    limits = stats.binomtest(int(successes), int(trials)).proportion_ci(LEVEL, method="wilson")
    return Interval(float(successes / trials), float(limits.low), float(limits.high))


def rate_columns(successes: Iterable[int], trials: Iterable[int]) -> dict[str, list[float]]:
    """The columns success_rate, ci_low and ci_high of a table, with Wilson's limits."""
    rates = [wilson(hits, count) for hits, count in zip(successes, trials, strict=True)]
    return {
        "success_rate": [rate.estimate for rate in rates],
        "ci_low": [rate.low for rate in rates],
        "ci_high": [rate.high for rate in rates],
    }


def clustered_rate(successes: ArrayLike, trials: ArrayLike) -> Interval:
    """Success rate with its starts (n,) resampled, percentile cluster bootstrap; with those of T
    trainings on the same starts (T, n), the trainings are resampled too.

    Rollouts of one start are alike, so that the starts are what was drawn independently. Where no
    start differs from another, it is Wilson's interval with one trial a start; where fewer than
    `FEW` have a success, Wilson's interval of their number, times the rate on these; where fewer
    have a failure, likewise.
    """
    (counts,) = _on_same_starts((successes, trials))
    hit, tried = counts
    estimate = float(hit.sum() / tried.sum())
    if _all_alike(*counts):
        return replace(wilson(round(estimate * hit.shape[1]), hit.shape[1]), estimate=estimate)
    if _is_few(hit):
        low, high = _of_few(hit, tried)
        return Interval(estimate, low, high)
    if _is_few(tried - hit):
        low, high = _of_few(tried - hit, tried)
        return Interval(estimate, 1 - high, 1 - low)
    low, high = np.quantile(_resampled(counts), TAILS)
    return Interval(estimate, float(low), float(high))


def clustered_mean(counts: Sequence[tuple[ArrayLike, ArrayLike]]) -> Interval:
    """Mean of the success rates of several actions by the same trainings, from successes and trials
    as in `clustered_rate`; each action has starts of its own."""
    every = [_on_same_starts(one)[0] for one in counts]
    estimate = np.mean([hit.sum() / tried.sum() for hit, tried in every])
    drawn = np.mean([_resampled(one, starts=number) for number, one in enumerate(every)], axis=0)
    low, high = np.quantile(drawn, TAILS) if np.ptp(drawn) else (math.nan, math.nan)
    return Interval(float(estimate), float(low), float(high))


def clustered_gain(
    counts: Sequence[tuple[ArrayLike, ArrayLike]], base: Sequence[tuple[ArrayLike, ArrayLike]]
) -> Interval:
    """By how much one mean of `clustered_mean` is above another on the same starts, which are
    resampled for both together; trainings are resampled for each."""
    every = [_on_same_starts(*pair) for pair in zip(counts, base, strict=True)]
    estimate = np.mean([p[0].sum() / p[1].sum() - q[0].sum() / q[1].sum() for p, q in every])
    gains = [
        _resampled(p, starts=number) - _resampled(q, starts=number, trainings=2)
        for number, (p, q) in enumerate(every)
    ]
    drawn = np.mean(gains, axis=0)
    low, high = np.quantile(drawn, TAILS) if np.ptp(drawn) else (math.nan, math.nan)
    return Interval(float(estimate), float(low), float(high))


def clustered_ratio(
    successes: ArrayLike, trials: ArrayLike, base_successes: ArrayLike, base_trials: ArrayLike
) -> Interval:
    """Ratio of two success rates on the same starts (n,), see `clustered_rate`: starts are
    resampled for both together, trainings for each. Starts count on which both have trials.

    The upper limit is `inf` where too many resamples have no success of the base, or fewer than
    `FEW` starts have one. There, and where the starts of one of them are all alike (none succeeds,
    say), it is made from the two rates' intervals.
    """
    top, base = _on_same_starts((successes, trials), (base_successes, base_trials))
    if _all_alike(*top) or _all_alike(*base):
        return rate_ratio(clustered_rate(*top), clustered_rate(*base))
    if _is_few(base[0]):
        return replace(rate_ratio(clustered_rate(*top), clustered_rate(*base)), high=math.inf)
    p, q = _resampled(top), _resampled(base, trainings=2)
    some = (p > 0) | (q > 0)  # a resample without any success has no ratio
    ratios = np.divide(p[some], q[some], out=np.full(some.sum(), math.inf), where=q[some] > 0)
    low, high = np.quantile(ratios, TAILS, method="inverted_cdf")
    estimate = (top[0].sum() / top[1].sum()) / (base[0].sum() / base[1].sum())
    return Interval(float(estimate), float(low), float(high))


def rate_ratio(top: Interval, base: Interval) -> Interval:
    """Ratio of two success rates, with the MOVER-R interval made from theirs (Donner & Zou, 2012).

    A base rate of 0 still has a finite lower limit. The estimate is `inf` there, and `nan` where
    both rates are 0.
    """
    p, q = top.estimate, base.estimate
    # The limits are the roots of r^2 a - 2 r p q + c = 0, for the lower one in the form that
    # also survives a = 0.
    a, c = base.high * (2 * q - base.high), top.low * (2 * p - top.low)
    below = p * q + math.sqrt(max(p * p * q * q - a * c, 0.0))
    low = c / below if below > 0 else 0.0
    b, d = base.low * (2 * q - base.low), top.high * (2 * p - top.high)
    high = (p * q + math.sqrt(max(p * p * q * q - b * d, 0.0))) / b if b > 0 else math.inf
    estimate = p / q if q > 0 else math.inf if p > 0 else math.nan
    return Interval(estimate, low, high)


def bootstrap(values: ArrayLike) -> Interval:
    """Mean of a sample (n,), such as differences of pairs, with its percentile bootstrap interval.

    A sample of one value, or of equal ones, has an estimate and no limits.
    """
    sample = np.asarray(values, dtype=float)  # (n,)
    if not sample.size:
        raise ValueError("a mean needs values, got none")
    estimate = float(sample.mean())
    if np.all(sample == sample[0]):
        return Interval(estimate)
    limits = stats.bootstrap(
        (sample,),
        np.mean,
        confidence_level=LEVEL,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(SEED),
    ).confidence_interval
    return Interval(estimate, float(limits.low), float(limits.high))


def resamples(trainings: ArrayLike, units: ArrayLike | None = None) -> Floats:
    """How often each of n observations is drawn in each resample, (RESAMPLES, n).

    Trainings are resampled, then what was observed after each of them. Few trainings vary less
    among themselves than all possible ones: three have two thirds of that variance.

    Args:
        trainings: (n,) labels of the trainings; one label for what needs none.
        units: (n,) labels of what all trainings share, such as start shapes, which is then drawn
            once for all (crossed). By default each training has units of its own (nested).
    """
    training = np.unique(np.asarray(trainings), return_inverse=True)[1]
    drawn = _drawn(training.max() + 1, 1)
    if units is not None:
        unit = np.unique(np.asarray(units), return_inverse=True)[1]
        return np.asarray(drawn[:, training] * _drawn(unit.max() + 1)[:, unit])
    rng = np.random.default_rng(SEED)
    weights = np.empty((RESAMPLES, len(training)))
    for number in range(drawn.shape[1]):
        own = np.flatnonzero(training == number)
        times = len(own) * drawn[:, number].astype(int)
        weights[:, own] = rng.multinomial(times, np.full(len(own), 1 / len(own)))
    return weights


def weighted_mean(values: Floats, weights: Floats) -> Floats:
    """Mean (R,) of values (n,) that were drawn as often as weights (R, n) say."""
    return np.asarray(weights @ values / weights.sum(axis=1))


def weighted_median(values: Floats, weights: Floats) -> Floats:
    """Median (R,) of values (n,), which may be infinite, drawn as often as weights (R, n) say."""
    order = np.argsort(values)
    counted = np.cumsum(weights[:, order], axis=1)
    half = counted[:, -1:] / 2
    lower, upper = (
        values[order][side.argmax(axis=1)] for side in (counted >= half, counted > half)
    )
    return np.asarray((lower + upper) / 2)


def hierarchical(
    values: ArrayLike,
    trainings: ArrayLike,
    units: ArrayLike | None = None,
    statistic: Callable[[Floats, Floats], Floats] = weighted_mean,
) -> Interval:
    """Mean or median of values (n,) with trainings and units resampled, see `resamples`.

    Equal values have an estimate and no limits.
    """
    sample = np.asarray(values, float)
    estimate = float(statistic(sample, np.ones((1, len(sample))))[0])
    if np.all(sample == sample[0]):
        return Interval(estimate)
    found = statistic(sample, resamples(trainings, units))
    low, high = np.quantile(found, TAILS, method="inverted_cdf")  # some may be infinite
    return Interval(estimate, float(low), float(high))


def _on_same_starts(*counts: tuple[ArrayLike, ArrayLike]) -> list[tuple[Floats, Floats]]:
    """Successes and trials (T, n) of each, of the n starts on which all have trials."""
    found = [
        (np.atleast_2d(np.asarray(hit, float)), np.atleast_2d(np.asarray(tried, float)))
        for hit, tried in counts
    ]
    some = np.all([tried.any(axis=0) for _, tried in found], axis=0)
    if not some.any():
        raise ValueError("a success rate needs trials, got none")
    return [(hit[:, some], tried[:, some]) for hit, tried in found]


def _all_alike(hit: Floats, tried: Floats) -> bool:
    return bool(np.all(hit * tried[0, 0] == hit[0, 0] * tried))


def _is_few(counts: Floats) -> bool:
    """Whether fewer than `FEW` of more starts have any of what is counted (T, n)."""
    some = np.count_nonzero(counts.any(axis=0))
    return bool(some < FEW and 2 * some <= counts.shape[1])


def _of_few(counts: Floats, tried: Floats) -> tuple[float, float]:
    """Limits of the share of trials (T, n) in which something happens that few starts have."""
    own = np.asarray(counts.any(axis=0))
    limits, share = wilson(own.sum(), len(own)), counts.sum() / tried[:, own].sum()
    return float(share * limits.low), float(share * limits.high)


def _resampled(counts: tuple[Floats, Floats], starts: int = 0, trainings: int = 1) -> Floats:
    """Rates (R,) with starts and trainings drawn anew, by generators of these numbers."""
    hit, tried = counts
    of_start, of_training = _drawn(hit.shape[1], 3 * starts), _drawn(hit.shape[0], trainings)
    hits, trials = (((of_start @ one.T) * of_training).sum(axis=1) for one in (hit, tried))
    return np.asarray(hits / trials)


@cache
def _drawn(n: int, number: int = 0) -> Floats:
    """How often each of n starts or trainings is drawn in each resample (RESAMPLES, n), by the
    generator of this number."""
    rng = np.random.default_rng(SEED + number)
    return rng.multinomial(n, np.full(n, 1 / n), size=RESAMPLES).astype(float)  # for the products
