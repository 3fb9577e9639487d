"""Tree searches: what a table of them has to hold, and their figure."""

import pytest

from knotflow.report.paper import TREE_SIZE
from knotflow.report.results import Results, ResultsError
from knotflow.report.searches import branches, confirmation, read_searches, sizes, spent


def read(write, *rows):
    write.searches("tree_size", "method", rows)
    return read_searches(Results(write.root), "tree_size", "method")


@pytest.mark.parametrize(("cell", "solved"), [("True", True), ("false", False), ("1", True)])
def test_searches_are_read(write, cell, solved):
    (search,) = read(write, ("icp", "arc", 4, 17, cell, 2.5)).itertuples()
    assert (search.method, search.start, search.seed, search.branches) == ("icp", "arc", 4, 17)
    assert search.solved == solved


def test_solved_is_a_truth_value(write):
    with pytest.raises(ResultsError, match="column 'solved', row 1 .*neither true nor false"):
        read(write, ("icp", "arc", 4, 17, "maybe", 2.5))


def test_a_search_stands_there_once(write):
    with pytest.raises(ResultsError, match="row 2 .*icp, arc, 4 stands in an earlier row"):
        read(write, ("icp", "arc", 4, 17, True, 2.5), ("icp", "arc", 4, 18, True, 2.5))


def test_a_search_that_gave_up_is_larger_than_any_bound(write):
    found = read(write, ("icp", "arc", 0, 17, True, 1.0), ("icp", "arc", 1, 500, False, 9.0))
    assert sizes(found) == [17, float("inf")]


@pytest.mark.parametrize("solved", [True, False])
def test_branches_with_a_method_not_run_and_one_single_search(write, solved):
    found = read(write, ("icp", "arc", 0, 40, solved, 1.0))
    picture = branches(found, TREE_SIZE, ["straight", "arc"], "b", {})
    assert picture.svg.count(b">not run yet<") == 5


CHECKS = ("searches", "plan", "step", "action", "passages", "reproduced", "steady")


@pytest.mark.parametrize(("passages", "said"), [(0, "none had"), (2, "1 had")])
def test_steps_that_were_simulated_again_are_counted(write, passages, said):
    found = read(write, ("icp", "arc", 0, 17, True, 1.0))
    results = Results(write.root)
    assert "simulated again" not in confirmation(results, "tree_size", found)
    rows = [
        ("icp", "00-000", 0, "R1(0,1,1)", passages, True, True),
        ("icp", "00-000", 1, "C(0,1,1)", 0, True, False),
    ]
    write.table("tree_size", "checks.csv", CHECKS, rows)
    text = confirmation(Results(write.root), "tree_size", found)
    assert f"Of the 2 steps of these plans, simulated again, {said} a strand" in text
    assert "50.0 % (" in text


def test_where_branches_went_is_told_by_method_the_most_first(write):
    assert spent(Results(write.root), "tree_size", "method") == ""
    columns = ("method", "start", "state", "action", "branches", "successes")
    rows = [("icp", "arc", "1o2-", f"C({i},0,1)", i, 1) for i in range(2, 9)]
    rows += [("icp", "straight", "1o2-", "C(3,0,1)", 1000, 5)]
    write.table("tree_size", "tried.csv", columns, rows)
    table = spent(Results(write.root), "tree_size", "method").splitlines()
    assert len(table) == 2 + 4
    assert "`C(3,0,1)`" in table[2] and "1,003" in table[2] and "| 6 |" in table[2]
    assert "`C(8,0,1)`" in table[3]
