"""Tree searches: their tables and figures, and the sections of every experiment that plans."""

import numpy as np
import pandas as pd
import pytest

from knotflow.report import knots
from knotflow.report.rates import ICP, IMITATION, REINFORCEMENT
from knotflow.report.results import Results, ResultsError
from knotflow.report.searches import (
    branches_figure,
    checks,
    median_size,
    read_searches,
    search_words,
    sizes,
    splines_spent,
)
from knotflow.report.section import Figures, Verdict

METHODS = (ICP, IMITATION, REINFORCEMENT)
TIED = [("three", f"2o1+{3 + 2 * i}o{4 + 2 * i}+", True, 2.0 + i) for i in range(3)]
MISSED = ("three", "4o3-2o1-", False, 60.1)
R1, CROSS = "R1(0,1,1)", "C(0,1,1)"


def read(write, *rows):
    write.searches("tree_size", "method", rows)
    return read_searches(Results(write.root), "tree_size", "method", "training_seed")


def knot_searches(write, experiment, rows):
    """branches.csv by goal from goal, start, seed, splines kept and whether it was tied."""
    cells = [(goal, *own, solved, 0.1 * own[-1]) for goal, *own, solved in rows]
    write.searches(experiment, "goal", cells)


@pytest.mark.parametrize(("cell", "solved"), [("True", True), ("false", False), ("1", True)])
def test_searches_are_read(write, cell, solved):
    (search,) = read(write, ("icp", "arc", 4, 17, cell, 2.5)).itertuples()
    assert (search.method, search.start, search.seed, search.kept) == ("icp", "arc", 4, 17)
    assert search.simulated == 34
    assert search.solved == solved


def test_search_is_there_once(write):
    with pytest.raises(ResultsError, match="line 3: icp, arc, , 4 is there twice"):
        read(write, ("icp", "arc", 4, 17, True, 2.5), ("icp", "arc", 4, 18, True, 2.5))


def test_search_that_gave_up_is_larger_than_any_bound(write):
    found = read(write, ("icp", "arc", 0, 17, True, 1.0), ("icp", "arc", 1, 500, False, 9.0))
    assert sizes(found).tolist() == [17, float("inf")]


def test_median_is_infinite_where_half_gave_up_and_ignores_the_cap(write):
    def median(caps, solved):
        rows = [("icp", "arc", seed, kept, seed < solved, 1.0) for seed, kept in enumerate(caps)]
        return median_size(read(write, *rows)).estimate

    assert median([3, 4, 5, 6, 500], 4) == median([3, 4, 5, 6, 1], 4) == 5
    assert np.isinf(median([3, 4, 5, 6, 7], 2))


def test_trainings_that_differ_widen_the_interval_of_the_median(write):
    rows = [("icp", "arc", seed, 3 + seed, True, 1.0) for seed in range(10)]
    write.searches("tree_size", "method", rows, ("10", "11", "12"))
    path = write.root / "tree_size" / "branches.csv"
    like = median_size(read_searches(Results(write.root), "tree_size", "method", "training_seed"))
    table = pd.read_csv(path)
    table["kept"] += 20 * (table["training_seed"] == 12)
    table.to_csv(path, index=False)
    other = median_size(read_searches(Results(write.root), "tree_size", "method", "training_seed"))
    assert other.high - other.low > 2 * (like.high - like.low)


def test_settings_are_those_of_the_resolved_configuration(write):
    read(write, ("icp", "arc", 0, 17, True, 1.0))
    words = search_words(Results(write.root), "tree_size")
    assert "by the paper's rule, one spline at a time, without arranging splines" in words
    assert "after 2,000 simulated splines" in words
    assert search_words(Results(write.root), "nowhere") == ""


@pytest.mark.parametrize("solved", [True, False])
def test_branches_with_methods_not_run_and_a_single_search(write, solved):
    found = read(write, ("icp", "arc", 0, 40, solved, 1.0))
    figures = Figures(Results(write.root))
    assert "1 tree searches" in branches_figure(
        figures, "b", found, METHODS, ["straight", "arc"], {}
    )


@pytest.mark.parametrize(("passages", "said"), [(0, "none had"), (2, "1 had")])
def test_replayed_steps_are_counted(write, passages, said):
    assert checks(Results(write.root), "tree_size") == ""
    columns = ("searches", "plan", "step", "action", "passages", "reproduced", "steady")
    rows = [
        ("icp", "00-000", 0, R1, passages, True, True),
        ("icp", "00-000", 1, CROSS, 0, True, False),
    ]
    write.table("tree_size", "checks.csv", columns, rows)
    text = checks(Results(write.root), "tree_size")
    assert f"Of the 2 steps of these plans, simulated again, {said} a strand" in text
    assert "50.0 % (" in text


def test_splines_spent_by_method_the_most_first(write):
    columns = ("method", "start", "state", "action", "simulated", "successes")
    rows = [("icp", "arc", "1o2-", f"C({i},0,1)", i, 1) for i in range(2, 9)]
    rows += [("icp", "straight", "1o2-", "C(3,0,1)", 1000, 5)]
    write.table("tree_size", "tried.csv", columns, rows)
    table = splines_spent(Results(write.root), "tree_size", "method").splitlines()[2:]
    assert len(table) == 2 + 4
    assert "`C(3,0,1)`" in table[2] and "1,003" in table[2] and "| 6 |" in table[2]
    assert "`C(8,0,1)`" in table[3]
    labelled = splines_spent(Results(write.root), "tree_size", "method", METHODS)
    assert labelled.splitlines()[4].startswith("| ICP |")


def test_knot_type_columns_are_not_needed(write):
    path = write.searches("tree_size", "method", [("icp", "arc", 0, 17, True, 1.0)])
    assert "knot_type" not in path.read_text() and "confirmed" not in path.read_text()
    assert "| arc | ICP | 1 | 1 | 0 | 17 | 17 |" in write.body("tree_size")


@pytest.mark.slow
def test_joint_finetuning_shows_searches_and_single_actions(write):
    methods = ("independent", "joint")
    rows = [(name, "random", seed, 3 + seed, True, 0.5) for name in methods for seed in (0, 1)]
    write.searches("joint_finetuning", "training", rows)
    starts = [(name, CROSS, 10, start, 8, 8 * start) for name in methods for start in (0, 1)]
    columns = ("method", "action", "training_seed", "start", "trials", "successes")
    write.table("joint_finetuning", "single_actions_per_start.csv", columns, starts)
    text = write.body("joint_finetuning")
    assert "| finetuned jointly | 1 | 2 | 0 | 3 |" in text and "<br>8 of 16 |" in text


def test_plan_is_shown_with_its_own_pictures(write):
    knot_searches(write, "overhand", [("overhand", "random", 0, 5, True)])
    (write.root / "overhand" / "plan.png").touch()
    text = write.body("overhand")
    assert (
        "tied the knot from the start `random` (seed 0) by `C(0,1,1)`, after 10 splines, of which"
        in text
    )
    assert "(../results/overhand/plan.png)" in text and "dag.png" not in text
    knot_searches(write, "overhand", [("overhand", "arc", 2, 9, False)])
    assert "did not tie the knot from the start `arc` (seed 2): gave up." in write.body("overhand")


def pentagrams(write, counts, unsolved=()):
    rows = [
        (method, "pulled", seed, kept, seed not in unsolved, 0.1 * kept)
        for method, every in (("reinforcement", counts), ("shipped", (3, 3)))
        for seed, kept in enumerate(every)
    ]
    write.searches("pentagram", "method", rows)


def test_pentagram_has_a_line_a_library(write):
    pentagrams(write, (2, 5, 13))
    text = write.body("pentagram")
    assert "| of the eight actions, after RL | 1 | 3 | 0 | 2 |" in text
    assert "| shipped | 1 | 2 | 0 | 3 |" in text


@pytest.mark.parametrize(
    ("counts", "unsolved", "verdict"),
    [
        ((2, 12, 40), (), Verdict.HOLDS),
        ((2, 13, 40), (), Verdict.PARTLY),
        ((13, 14, 40), (), Verdict.FAILS),
        ((2, 3, 4), {0, 1}, Verdict.PARTLY),
        ((2,), {0}, Verdict.FAILS),
    ],
)
def test_pentagram_verdict(write, counts, unsolved, verdict):
    pentagrams(write, counts, unsolved)
    outcome = knots.judge_pentagram(Results(write.root))
    assert outcome.verdict is verdict
    assert f"of {len(counts)} searches" in outcome.ours


def test_knots_have_their_rates(write):
    rows = [("4o1+2o5+6o3+", "random", seed, 12, seed > 0) for seed in range(20)]
    rows += [("figure_eight", "random", 0, 900, False)]
    knot_searches(write, "knots", rows)
    text = write.body("knots")
    assert "19 of 20 | 12 | 24 | 1.2 s |" in text and "0 of 1 | – | – | – |" in text


def test_goals_have_shares_and_medians_and_missed_ones_their_reason(write):
    write.goals([*TIED, MISSED, ("four", "1o2-", True, 0.5)])
    text = write.body("goals")
    assert "3 of 4 | 12 | 120 | 3.0 s |" in text and "1 of 1 | 2 | 20 | 0.5 s |" in text
    assert "Goals that were not tied, 1 in all." in text
    assert "| three | `4o3-2o1-` | 3 | 240 | 2,404 | 60 s passed |" in text
    write.goals(TIED)
    assert "not tied" not in write.body("goals")


@pytest.mark.parametrize("rows", [TIED[:1], [MISSED]])
def test_single_search_is_drawn_whether_it_tied_or_not(write, rows):
    write.goals(rows)
    assert "![Share of goals tied" in write.body("goals")


def test_published_goals_stand_beside_what_is_published(write):
    columns = ("set", "start", "seed", "kept", "simulated", "solved", "seconds", "goal", "path")
    rows = [
        (name, "straight", 0, 6, 12, name == "easy" or goal > 2, 0.5, f"{goal}", "", "", "")
        for name in ("easy", "four")
        for goal in range(4)
    ]
    write.table("published_goals", "branches.csv", (*columns, "end_state", "reason"), rows)
    easy, four = [line for line in write.body("published_goals").splitlines() if " of 4 " in line]
    assert "4 of 4" in easy and easy.endswith("| 100 % |")
    assert "1 of 4" in four and four.endswith("| 26 % |")


def test_goals_in_a_longer_rope_are_paired_with_those_in_the_nominal_one(write):
    four = [("four", f"2o1+{i}", i < 2, 2.0) for i in range(4)]
    write.goals([*four, ("four", "2o1-", True, 2.0)])
    assert write.body("goals_long_rope") is None
    write.goals([(*one[:2], True, 1.0) for one in four], "goals_long_rope")
    (line,) = (one for one in write.body("goals_long_rope").splitlines() if "| four |" in one)
    assert "2 of 4" in line and "4 of 4" in line and "50" in line.split("|")[-2]
    write.goals([*four, ("four", "4o3-", True, 1.0)], "goals_long_rope")
    assert "2 of 4" not in (write.body("goals_long_rope") or "")


def test_bowlines_tied_and_their_effort_are_counted(write):
    knot_searches(
        write, "bowline", [("bowline", "random", one, 40 + one, one < 2) for one in (0, 1, 2)]
    )
    body = write.body("bowline")
    assert "| 66.7 % (20.8 to 93.9)<br>2 of 3 | 40.5 |" in body


def write_variant(write, name, tied, order=1):
    rows = [("three", f"2o1+{i}", one, 2.0) for i, one in enumerate(tied)]
    write.goals(rows[::order], "goals_ablation", f"{name}.csv")


def test_planner_ablation_is_paired_by_goal_whatever_the_order(write):
    assert write.body("goals_ablation") is None
    write_variant(write, "complete", [1, 1, 1, 1, 0, 0])
    write_variant(write, "without_arranging", [1, 1, 1, 1, 0, 0], order=-1)
    text = write.body("goals_ablation")
    complete, without = [line for line in text.splitlines() if "4 of 6" in line]
    assert complete.endswith("| – |") and without.endswith("| 0.0 |")


def test_planner_ablation_without_the_complete_planner_has_no_difference(write):
    write_variant(write, "without_arranging", [1, 0, 1, 0])
    (line,) = [line for line in write.body("goals_ablation").splitlines() if "2 of 4" in line]
    assert line.endswith("| – |")


def test_nothing_run_is_nothing_shown(write):
    write.run("tree_size", {})
    sections = ("tree_size", "joint_finetuning", "overhand", "pentagram")
    for section in (*sections, "knots", "goals", "goals_ablation"):
        assert write.body(section) is None
