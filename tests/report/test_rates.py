"""Success rates: read with care, drawn the same each time, nothing hidden that was not run."""

from __future__ import annotations

import matplotlib
import pytest

from knotflow.report.rates import ICP, IMITATION, RANDOM, REINFORCEMENT, read_rates, with_extras
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Figures
from knotflow.report.single_stage import options, reachable

METHODS = (RANDOM, ICP, IMITATION, REINFORCEMENT)
RATE = ("method", "action", "training_seed", "start", "trials", "successes")
ACTION = "C(0,1,1)"


def read(write):
    return read_rates(Results(write.root), "single_stage")


def rates_of(write, rows):
    write.table("single_stage", "per_start.csv", RATE, rows)
    return read(write)


def test_trainings_and_starts_are_counted(write):
    rows = [
        ("imitation", ACTION, seed, start, 4, hits)
        for seed, each in (("10", (0, 4)), ("11", (0, 2)))
        for start, hits in enumerate(each)
    ]
    rows += [("random", ACTION, "", 0, 4, 1), ("random", ACTION, "", 1, 4, 0)]
    rates = rates_of(write, rows)
    assert rates.interval("imitation", ACTION).estimate == 6 / 16
    assert rates.by_training("imitation", ACTION).to_dict() == {"10": 0.5, "11": 0.25}
    assert rates.solved("imitation", ACTION).tolist() == [False, True]
    assert rates.ratio("imitation", "random", ACTION).estimate == pytest.approx(3)
    text = rates.table((RANDOM, IMITATION))
    assert "<br>1 of 8 |" in text and "<br>6 of 16<br>trainings 50 / 25 |" in text


@pytest.mark.parametrize(
    ("column", "value", "problem"),
    [
        ("successes", 11, "11 successes of 10 trials"),
        ("trials", 0, "3 successes of 0 trials"),
        ("successes", "many", "successes is 'many'"),
        ("start", 0, "is there twice"),
    ],
)
def test_wrong_cell_is_named_with_file_and_line(write, column, value, problem):
    bad = ["random", ACTION, "", 1, 10, 3]
    bad[RATE.index(column)] = value
    with pytest.raises(ResultsError, match=rf"per_start\.csv, line 3: .*{problem}"):
        rates_of(write, [("random", ACTION, "", 0, 10, 3), bad])


def drawn(write, counts):
    write.rates("single_stage", counts)
    figures = Figures(Results(write.root))
    text = read(write).figure(figures, METHODS, "rates", "Fig. 6 reproduced")
    return text, figures.made["rates"]


@pytest.mark.slow
def test_figure_is_the_same_whatever_the_users_style(write, rate_counts):
    text, one = drawn(write, rate_counts(("random", "icp")))
    with matplotlib.rc_context({"font.size": 20, "axes.facecolor": "red"}):
        assert drawn(write, rate_counts(("random", "icp"))) == (text, one)
    assert b"Software" not in one and "400 rollouts a bar" in text


def test_figure_with_an_action_that_a_method_lacks(write, rate_counts):
    counts = rate_counts(("random", "icp"))
    del counts["icp", "C(2,4,1)"]
    assert drawn(write, counts)


def test_extra_methods_have_labels_and_colours():
    methods = with_extras(METHODS, ["reinforcement_arranged", "my_own", "icp"])[4:]
    assert [method.label for method in methods] == ["shipped + arranging", "my own"]
    assert len({method.colour for method in (*METHODS, *methods)}) == 6


def test_mean_needs_every_action(write, rate_counts):
    counts = dict.fromkeys(rate_counts(("random", "icp")), (20, 40))
    counts["random", "C(2,4,1)"] = (36, 40)
    del counts["icp", "C(2,4,1)"]
    write.rates("single_stage", counts)
    (last,) = read(write).table(METHODS[:2]).splitlines()[-1:]
    assert last.startswith("| mean | 55.0 % (") and last.endswith(") | – |")


def test_an_interval_is_wider_where_trainings_differ(write):
    def counted(*shares):
        rows = [
            ("icp", ACTION, str(seed), start, 4, round(4 * share * (start % 5 > 1)))
            for seed, share in enumerate(shares)
            for start in range(50)
        ]
        found = rates_of(write, rows).interval("icp", ACTION)
        return found.high - found.low

    assert counted(0.5, 0.5, 0.5) == counted(0.5)
    assert counted(0.25, 0.5, 0.75) > 1.3 * counted(0.5)


def test_starts_that_no_search_solves_are_beside_the_failures_of_rl(write):
    write.rates("single_stage", {("reinforcement", ACTION): (6, 10)})
    rows = [(ACTION, start, 256 if start > 7 else 3, int(start < 8)) for start in range(10)]
    write.table("single_stage", "reachable.csv", ("action", "start", "splines", "found"), rows)
    text = reachable(Results(write.root), read(write))
    assert f"| `{ACTION}` | 2 of 10 | 3 | 4 of 10 | 2 | 75.0 %" in text
    rows = [(ACTION, start, 256, 0) for start in range(10)]
    write.table("single_stage", "reachable.csv", ("action", "start", "splines", "found"), rows)
    text = reachable(Results(write.root), read(write))
    assert f"| `{ACTION}` | 10 of 10 | – | 4 of 10 | 4 | – |" in text


def test_an_option_has_the_mean_of_each_training_and_primitive(write, rate_counts):
    actions = [action for _, action in rate_counts(("icp",))]
    counts = {(name, one): (5, 10) for name in ("ours", "node_actor") for one in actions}
    counts["node_actor", "R1(0,1,1)"] = (10, 10)
    write.rates("learning_options", counts, trainings=("20", "21"))
    results = Results(write.root)
    ours, other = options(results, Figures(results))["options"].splitlines()[-2:]
    assert ours.startswith("| nothing | 50.0 % (")
    assert ours.endswith(" | 50 / 50 | 50 | 50 | 50 | 50 |")
    assert "a node, then a Gaussian" in other
    assert other.endswith(" | 56 / 56 | 100 | 50 | 50 | 50 |")
