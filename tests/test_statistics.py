"""Laws of the intervals: symmetry, scale, reciprocity, and that they cover what they promise."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy import stats

from knotflow import statistics
from knotflow.statistics import (
    bootstrap,
    clustered_gain,
    clustered_mean,
    clustered_rate,
    clustered_ratio,
    hierarchical,
    rate_columns,
    rate_ratio,
    resamples,
    weighted_median,
    wilson,
)


def ratio(successes, trials, base_successes, base_trials):
    return rate_ratio(wilson(successes, trials), wilson(base_successes, base_trials))


@pytest.mark.parametrize("counts", [(30, 100, 10, 100), (399, 400, 3, 400), (5, 20, 7, 300)])
def test_swapping_the_rates_takes_the_reciprocal(counts):
    there, back = ratio(*counts), ratio(*counts[2:], *counts[:2])
    assert there.estimate == pytest.approx(1 / back.estimate)
    assert there.low == pytest.approx(1 / back.high)
    assert there.high == pytest.approx(1 / back.low)
    assert there.low < there.estimate < there.high


def test_a_base_that_never_succeeded_still_gives_a_lower_limit():
    found = ratio(208, 400, 0, 400)
    assert math.isinf(found.estimate) and math.isinf(found.high)
    assert 40 < found.low < 100
    nothing = ratio(0, 400, 0, 400)
    assert math.isnan(nothing.estimate)
    assert (nothing.low, nothing.high) == (0, math.inf)


@pytest.mark.slow
@pytest.mark.parametrize(("p", "q"), [(0.6, 0.3), (0.3, 0.05), (0.9, 0.8)])
def test_ratio_interval_covers_what_it_promises(p, q):
    """Exact coverage: every outcome of two binomials, weighted with its probability."""
    n = 40
    covered = 0.0
    top, base = (stats.binom.pmf(np.arange(n + 1), n, rate) for rate in (p, q))
    for i in np.flatnonzero(top > 1e-4):
        for j in np.flatnonzero(base > 1e-4):
            interval = ratio(int(i), n, int(j), n)
            covered += top[i] * base[j] * (interval.low <= p / q <= interval.high)
    assert 0.93 < covered < 0.99


def test_bootstrap_is_the_same_each_time_and_follows_the_scale():
    sample = np.random.default_rng(3).exponential(5, 40)
    one, again, scaled = bootstrap(sample), bootstrap(sample), bootstrap(10 * sample)
    assert one == again
    assert (scaled.low, scaled.high) == pytest.approx((10 * one.low, 10 * one.high))
    assert one.low < one.estimate < one.high


def test_bootstrap_of_the_mean_is_as_wide_as_theory_says():
    sample = np.random.default_rng(4).normal(size=400)
    interval = bootstrap(sample)
    assert interval.high - interval.low == pytest.approx(2 * 1.96 * sample.std() / 20, rel=0.05)


@pytest.mark.parametrize("sample", [[3], [3, 3, 3]])
def test_equal_values_have_no_limits(sample):
    interval = bootstrap(sample)
    assert interval.estimate == 3 and math.isnan(interval.low) and math.isnan(interval.high)


def test_starts_of_one_trial_are_as_wide_as_wilson_says():
    hit = np.repeat([1, 0], [120, 280])
    clustered, plain = clustered_rate(hit, np.ones(400)), wilson(120, 400)
    assert clustered.estimate == pytest.approx(plain.estimate)
    assert (clustered.low, clustered.high) == pytest.approx((plain.low, plain.high), abs=0.01)


def test_trials_that_are_all_alike_count_as_one_a_start():
    eight, one = (clustered_rate(np.repeat([n, 0], [20, 30]), np.full(50, n)) for n in (8, 1))
    assert eight == one
    assert eight.high - eight.low > 2 * (wilson(160, 400).high - wilson(160, 400).low)


@pytest.mark.parametrize("hit", [0, 8])
def test_starts_without_a_difference_have_wilsons_limits_of_so_many_starts(hit):
    found, plain = clustered_rate(np.full(50, hit), np.full(50, 8)), wilson(50 * (hit > 0), 50)
    assert found == plain


@pytest.mark.slow
def test_clustered_intervals_cover_what_they_promise():
    """Starts of very different difficulty, a truth that is known, many samples of 50 starts."""
    rng, covered = np.random.default_rng(7), {"clustered": 0, "wilson": 0}
    for _ in range(300):
        hit = rng.binomial(8, rng.beta(0.3, 0.3, 50))
        for name, found in (
            ("clustered", clustered_rate(hit, np.full(50, 8))),
            ("wilson", wilson(hit.sum(), 400)),
        ):
            covered[name] += found.low <= 0.5 <= found.high
    assert covered["clustered"] > 0.9 * 300 and covered["wilson"] < 0.75 * 300


def test_a_ratio_on_the_same_starts_is_narrower_than_one_on_others():
    rng = np.random.default_rng(8)
    skill = rng.beta(0.5, 0.5, 50)
    first, second = rng.binomial(8, skill), rng.binomial(8, 0.7 * skill)
    tried = np.full(50, 8)
    paired = clustered_ratio(first, tried, second, tried)
    apart = rate_ratio(clustered_rate(first, tried), clustered_rate(second, tried))
    assert paired.estimate == pytest.approx(apart.estimate) == first.sum() / second.sum()
    assert paired.low < paired.estimate < paired.high
    assert paired.high - paired.low < apart.high - apart.low


def test_a_base_that_hardly_or_never_succeeds_leaves_a_lower_limit_only():
    tried, hit = np.full(50, 8), np.repeat([6, 0], [25, 25])
    hardly = clustered_ratio(hit, tried, np.repeat([1, 0], [2, 48]), tried)
    assert hardly.estimate == pytest.approx(75) and math.isinf(hardly.high) and hardly.low > 10
    never = clustered_ratio(hit, tried, np.zeros(50), tried)
    assert math.isinf(never.estimate) and math.isinf(never.high) and never.low > 1


@pytest.mark.parametrize(("successes", "trials"), [(0, 400), (14, 400), (200, 400), (3, 7), (1, 1)])
def test_wilson_is_mirror_symmetric(successes, trials):
    one, other = wilson(successes, trials), wilson(trials - successes, trials)
    assert one.estimate == pytest.approx(1 - other.estimate)
    assert one.low == pytest.approx(1 - other.high)
    assert 0 <= one.low <= one.estimate <= one.high <= 1


def test_wilson_limits_solve_the_score_equation():
    interval, z = wilson(14, 400), stats.norm.ppf(0.975)
    for limit in (interval.low, interval.high):
        score = (14 / 400 - limit) / math.sqrt(limit * (1 - limit) / 400)
        assert abs(score) == pytest.approx(z)


@pytest.mark.parametrize(("successes", "trials"), [(1, 0), (5, 4), (-1, 4)])
def test_wilson_refuses_what_is_no_rate(successes, trials):
    with pytest.raises(ValueError, match="must"):
        wilson(successes, trials)


def test_a_tables_columns_are_those_intervals():
    columns = rate_columns([0, 14], [1, 400])
    assert columns["success_rate"] == [0, 14 / 400]
    assert columns["ci_high"] == [wilson(0, 1).high, wilson(14, 400).high]
    assert rate_columns([], []) == {"success_rate": [], "ci_low": [], "ci_high": []}


def test_one_training_is_the_plain_bootstrap():
    sample = np.random.default_rng(9).exponential(5, 40)
    one, plain = hierarchical(sample, np.zeros(40)), bootstrap(sample)
    assert one.estimate == pytest.approx(plain.estimate)
    assert (one.low, one.high) == pytest.approx((plain.low, plain.high), rel=0.02)


def test_units_shared_by_all_trainings_are_drawn_once_for_all():
    """Six identical trainings know no more of the starts than one."""
    sample = np.random.default_rng(10).normal(size=30)
    trainings, starts = np.repeat(np.arange(6), 30), np.tile(np.arange(30), 6)
    nested, crossed = (hierarchical(np.tile(sample, 6), trainings, of) for of in (None, starts))
    plain = bootstrap(sample)
    assert (crossed.low, crossed.high) == pytest.approx((plain.low, plain.high), abs=0.03)
    assert nested.high - nested.low < 0.6 * (plain.high - plain.low)


@pytest.mark.parametrize("units", [None, np.tile(np.arange(5), 8)])
def test_resamples_draw_as_many_trainings_as_there_were(units):
    trainings = np.repeat(np.arange(8), 5)
    weights = resamples(trainings, units)
    drawn = weights.reshape(-1, 8, 5).sum(axis=2)
    assert (drawn.sum(axis=1) == 40).all() and (drawn % 5 == 0).all()
    assert weights.mean(axis=0) == pytest.approx(np.ones(40), abs=0.1)


def test_trainings_that_differ_widen_the_interval_to_cover_their_mean(monkeypatch):
    """Nested units, a truth that is known, many samples of ten trainings."""
    monkeypatch.setattr(statistics, "RESAMPLES", 999)
    monkeypatch.setattr(statistics, "_drawn", cache(statistics._drawn.__wrapped__))
    rng, covered = np.random.default_rng(11), {"hierarchical": 0, "plain": 0}
    trainings = np.repeat(np.arange(10), 8)
    for _ in range(60):
        sample = rng.normal(size=10)[trainings] + rng.normal(size=80)
        found = {"hierarchical": hierarchical(sample, trainings), "plain": bootstrap(sample)}
        for name, interval in found.items():
            covered[name] += interval.low <= 0 <= interval.high
    assert covered["hierarchical"] >= 52 > covered["plain"]


def test_a_weighted_median_is_that_of_the_repeated_values():
    rng = np.random.default_rng(12)
    values = np.array([4.0, 1.0, math.inf, 2.0, 7.0])
    weights = rng.integers(0, 4, (50, 5)) + (np.arange(5) == 1)
    expected = [np.median(np.repeat(values, counts)) for counts in weights]
    assert weighted_median(values, weights).tolist() == expected


def test_a_rate_of_several_trainings_is_less_certain_than_its_trials():
    """Four trainings on the same fifty starts, two of them much worse."""
    rng = np.random.default_rng(13)
    share = np.array([0.9, 0.9, 0.4, 0.4])[:, None]
    hit, tried = rng.binomial(8, share, (4, 50)), np.full((4, 50), 8)
    several, pooled = clustered_rate(hit, tried), clustered_rate(hit.sum(0), tried.sum(0))
    assert several.estimate == pooled.estimate
    assert several.high - several.low > 3 * (pooled.high - pooled.low)


def test_a_ratio_resamples_the_trainings_of_both_and_their_starts_together():
    tried = np.full((3, 50), 8)
    of_start = np.tile(np.repeat([8, 4, 0], [10, 20, 20]), (3, 1))
    alike = clustered_ratio(of_start, tried, of_start, tried)
    assert (alike.low, alike.estimate, alike.high) == (1, 1, 1)
    of_training = of_start // np.array([1, 2, 4])[:, None]
    apart = clustered_ratio(of_training, tried, of_training, tried)
    untrained = clustered_ratio(of_training, tried, of_start[0], tried[0])
    assert apart.low < 0.8 and apart.high > 1.25
    assert untrained.estimate == pytest.approx(7 / 12) and untrained.low < 0.5 < untrained.high


def test_the_mean_of_actions_is_surer_than_each_unless_the_trainings_differ():
    rng = np.random.default_rng(14)
    tried = np.full((3, 50), 8)
    like = [(rng.binomial(8, np.tile(rng.beta(1, 1, 50), (3, 1))), tried) for _ in range(8)]
    one, mean = clustered_rate(*like[0]), clustered_mean(like)
    assert mean.high - mean.low < 0.5 * (one.high - one.low)
    unlike = [(hit // np.array([1, 2, 8])[:, None], tried) for hit, _ in like]
    found = clustered_mean(unlike)
    assert found.low < 0.15 and found.high > 0.35


def test_starts_of_each_action_are_drawn_on_their_own():
    hit, tried = np.random.default_rng(15).binomial(8, 0.5, 50), np.full(50, 8)
    one, mean = clustered_rate(hit, tried), clustered_mean([(hit, tried)] * 4)
    assert mean.estimate == pytest.approx(one.estimate)
    assert mean.high - mean.low == pytest.approx((one.high - one.low) / 2, rel=0.1)


def test_a_gain_is_paired_by_start_and_not_by_training():
    rng = np.random.default_rng(16)
    tried, first, second = np.full((2, 50), 8), [], []
    for _ in range(4):
        shown = rng.beta(0.5, 0.5, 50)
        first.append((rng.binomial(8, shown, (2, 50)), tried))
        second.append((rng.binomial(8, 0.9 * shown, (2, 50)), tried))
    gain, means = clustered_gain(first, second), [clustered_mean(one) for one in (first, second)]
    assert gain.estimate == pytest.approx(means[0].estimate - means[1].estimate)
    assert 0 < gain.low < gain.high and gain.high - gain.low < means[0].high - means[0].low
    other = clustered_gain(first, [(hit[::-1], tried) for hit, tried in first])
    assert other.estimate == 0 and other.low < 0 < other.high


def test_starts_without_trials_do_not_count():
    some = statistics.clustered_rate([3, 5], [10, 10])
    assert statistics.clustered_rate([3, 0, 5], [10, 0, 10]) == some


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_rates_of_rare_successes_or_failures_are_covered(share):
    """A start in twenty has successes, in this share of its trials."""
    rng, tried, covered = np.random.default_rng(15), np.full(50, 4), []
    for _ in range(200):
        hit = rng.binomial(4, share * (rng.random(50) < 0.05))
        rare, common = clustered_rate(hit, tried), clustered_rate(tried - hit, tried)
        covered.append(rare.low <= 0.05 * share <= rare.high)
        assert (1 - common.high, 1 - common.low) == pytest.approx((rare.low, rare.high), abs=0.01)
    assert np.mean(covered) > 0.93


def test_a_ratio_is_of_the_starts_that_both_have():
    first, second = [8, 2, 6, 3, 5], [4, 1, 5, 1, 3]
    found = clustered_ratio([*first, 9], [10] * 6, [*second, 0], [10] * 5 + [0])
    assert found == clustered_ratio(first, [10] * 5, second, [10] * 5)
    shifted = clustered_ratio([9, *first], [10] * 6, [0, *second], [0] + [10] * 5)
    assert shifted == found


@pytest.mark.parametrize("data", [([], []), ([0, 0], [0, 0])])
def test_without_trials_there_is_no_rate(data):
    with pytest.raises(ValueError, match="needs trials"):
        statistics.clustered_rate(*data)
    with pytest.raises(ValueError, match="needs values"):
        statistics.bootstrap([])
