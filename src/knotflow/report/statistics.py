"""The report's intervals.

Rates and their ratios have their starts resampled where they are known start by start; else Wilson
and MOVER-R. Counts and distances have a bootstrap.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from knotflow.intervals import LEVEL, Interval, wilson

RESAMPLES = 9_999
# One fixed seed: the report has to be the same bytes each time it is made from the same results.
BOOTSTRAP_SEED = 0


def clustered_rate(successes: ArrayLike, trials: ArrayLike, level: float = LEVEL) -> Interval:
    """Success rate with its starts resampled: percentile cluster bootstrap.

    Rollouts of one start are alike, so that the starts (n,) are what was drawn independently.
    Where no start differs from another, resampling says nothing; then it is Wilson's interval with
    one trial a start.

    Args:
        successes: of each start (n,).
        trials: of each start (n,), at least 1.
        level: of confidence.
    """
    hit, tried = np.asarray(successes, float), np.asarray(trials, float)  # (n,) each
    estimate = float(hit.sum() / tried.sum())
    if _all_alike(hit, tried):
        limits = wilson(round(estimate * len(hit)), len(hit), level)
        return Interval(estimate, limits.low, limits.high)
    weights = _resamples(len(hit))
    low, high = np.quantile((weights @ hit) / (weights @ tried), _tails(level))
    return Interval(estimate, float(low), float(high))


def clustered_ratio(
    successes: ArrayLike,
    trials: ArrayLike,
    base_successes: ArrayLike,
    base_trials: ArrayLike,
    level: float = LEVEL,
) -> Interval:
    """Ratio of two success rates on the same starts (n,), which are resampled together.

    The upper limit is `inf` where too many resamples have no success of the base. Where the starts
    of one of them are all alike (none succeeds, say), it is made from the two rates' intervals.
    """
    top = np.asarray(successes, float), np.asarray(trials, float)  # (n,) each
    base = np.asarray(base_successes, float), np.asarray(base_trials, float)
    if _all_alike(*top) or _all_alike(*base):
        return rate_ratio(clustered_rate(*top, level), clustered_rate(*base, level))
    weights = _resamples(len(top[0]))
    p, q = ((weights @ hit) / (weights @ tried) for hit, tried in (top, base))
    some = (p > 0) | (q > 0)  # a resample without any success has no ratio
    ratios = np.divide(p[some], q[some], out=np.full(some.sum(), math.inf), where=q[some] > 0)
    low, high = np.quantile(ratios, _tails(level), method="inverted_cdf")
    estimate = (top[0].sum() / top[1].sum()) / (base[0].sum() / base[1].sum())
    return Interval(float(estimate), float(low), float(high))


def rate_ratio(top: Interval, base: Interval) -> Interval:
    """Ratio of two success rates, with the MOVER-R interval made from theirs (Donner & Zou, 2012).

    A base rate of 0 still has a finite lower limit: "at least so many times better". The estimate
    is `inf` there, and `nan` where both rates are 0.
    """
    p, q = top.estimate, base.estimate
    assert top.low is not None and top.high is not None
    assert base.low is not None and base.high is not None
    # The limits are the roots of r^2 a - 2 r p q + c = 0, for the lower one in the form that
    # also survives a = 0.
    a, c = base.high * (2 * q - base.high), top.low * (2 * p - top.low)
    below = p * q + math.sqrt(max(p * p * q * q - a * c, 0.0))
    low = c / below if below > 0 else 0.0
    b, d = base.low * (2 * q - base.low), top.high * (2 * p - top.high)
    high = (p * q + math.sqrt(max(p * p * q * q - b * d, 0.0))) / b if b > 0 else math.inf
    if q > 0:
        estimate = p / q
    else:
        estimate = math.inf if p > 0 else math.nan
    return Interval(estimate, low, high)


def mean_rate(rates: Sequence[Interval]) -> Interval:
    """Mean of independent success rates, with the MOVER interval made from theirs."""
    estimates, lows, highs = np.array([(r.estimate, r.low, r.high) for r in rates], float).T
    mean = float(estimates.mean())
    below, above = (np.linalg.norm(estimates - side) / len(rates) for side in (lows, highs))
    return Interval(mean, mean - float(below), mean + float(above))


def _all_alike(successes: np.ndarray, trials: np.ndarray) -> bool:
    return bool(np.all(successes * trials[0] == successes[0] * trials))


@cache
def _resamples(n: int) -> np.ndarray:
    """How often each of n starts is drawn in each resample (RESAMPLES, n)."""
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    return rng.multinomial(n, np.full(n, 1 / n), size=RESAMPLES).astype(float)  # for the products


def _tails(level: float) -> tuple[float, float]:
    return (1 - level) / 2, (1 + level) / 2


def bootstrap(
    values: Sequence[float],
    statistic: Callable[..., np.ndarray] = np.mean,
    level: float = LEVEL,
) -> Interval:
    """Percentile bootstrap interval of `statistic` (np.mean or np.median) of a sample (n,).

    A sample of one value, or of equal ones, has an estimate and no limits: resampling it says
    nothing of what was not seen. Raises ValueError on an empty sample.
    """
    sample = np.asarray(values, dtype=float)  # (n,)
    if sample.size == 0:
        raise ValueError("an empty sample has no mean and no interval; needs at least one value")
    estimate = float(statistic(sample))
    if np.all(sample == sample[0]):
        return Interval(estimate, None, None)
    limits = stats.bootstrap(
        (sample,),
        statistic,
        confidence_level=level,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(BOOTSTRAP_SEED),
    ).confidence_interval
    return Interval(estimate, float(limits.low), float(limits.high))


def mean_difference(
    values: Sequence[float],
    base: Sequence[float],
    *,
    paired: bool,
    level: float = LEVEL,
) -> Interval:
    """Mean of `values` less mean of `base`, percentile bootstrap; `paired` resamples pairs."""
    first, second = np.asarray(values, dtype=float), np.asarray(base, dtype=float)
    if paired:
        return bootstrap(first - second, level=level)
    estimate = float(first.mean() - second.mean())
    if min(first.size, second.size) < 2:
        return Interval(estimate, None, None)
    limits = stats.bootstrap(
        (first, second),
        lambda a, b, axis=-1: np.mean(a, axis=axis) - np.mean(b, axis=axis),
        confidence_level=level,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(BOOTSTRAP_SEED),
    ).confidence_interval
    return Interval(estimate, float(limits.low), float(limits.high))
