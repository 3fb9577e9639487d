"""Laws of Wilson's interval."""

import math

import pytest
from scipy import stats

from knotflow.intervals import rate_columns, wilson


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
    with pytest.raises(ValueError, match="is no rate"):
        wilson(successes, trials)


def test_a_tables_columns_are_those_intervals():
    columns = rate_columns([0, 14], [1, 400])
    assert columns["success_rate"] == [0, 14 / 400]
    assert columns["ci_high"] == [wilson(0, 1).high, wilson(14, 400).high]
    assert rate_columns([], []) == {"success_rate": [], "ci_low": [], "ci_high": []}
