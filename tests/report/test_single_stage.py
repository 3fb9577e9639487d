"""The aim of the primitives beside what a search in the simulator finds."""

import pytest

from knotflow.report.page import compose
from knotflow.report.rates import read_rates
from knotflow.report.results import Results
from knotflow.report.single_stage import SECTION, feasible, searches


def read(write):
    results = Results(write.root)
    return results, read_rates(results, "single_stage")


COLUMNS = ("action", "share", "room", "starts_left_out")


def test_starts_that_were_left_out_count_as_searched(write):
    actions = ("C(2,4,1)", "C(2,4,1)", "C(0,1,1)", "R1(0,1,1)")
    rows = [(action, 0.5, 0.1, left) for action, left in zip(actions, (0, 3, 1, 0), strict=True)]
    write.table("demonstrator", "shares.csv", COLUMNS, rows)
    found = searches(Results(write.root))
    assert found["C(2,4,1)"] == (2, 5)
    assert found["C(0,1,1)"] == (1, 2)


def test_the_page_names_the_actions_that_reach_the_aim(write, rate_counts):
    write.rates("single_stage", rate_counts(("random", "reinforcement")))
    rows = [("C(2,4,1)", 0.5, 0.1, 1), ("R1(0,1,1)", 1.0, 0.2, 0)]
    write.table("demonstrator", "shares.csv", COLUMNS, rows)
    told = feasible(*read(write))
    assert told["reached"] == "`R1(0,1,1)`" and told["missed"] == 7
    assert "50.0 %" in told["table"] and "`R1(0,1,1)`" not in told["table"]
    assert (
        "reached on\n`R1(0,1,1)` and missed on the other 7"
        in compose(Results(write.root), "results").markdown
    )


def test_without_reinforcement_there_is_nothing_to_say(write, rate_counts):
    write.rates("single_stage", rate_counts(("random",)))
    assert feasible(*read(write)) is None


@pytest.mark.slow
def test_arranging_is_a_further_method_that_changes_no_claim(write, rate_counts):
    paper = ("random", "icp", "imitation", "reinforcement")
    write.rates("single_stage", rate_counts(paper))
    results = Results(write.root)
    claims = [claim.judgement(results) for claim in SECTION.claims]
    assert "arranging" not in compose(results, "results").markdown.split("## Tree size")[0]
    write.rates("single_stage", rate_counts((*paper, "reinforcement_arranged")))
    text = compose(results, "results").markdown
    assert "| action | random | ICP | imitation | imitation + RL | self-play + arranging |" in text
    assert "self-play + arranging / imitation + RL" in text
    assert "Here the aim of 90\u00a0% is reached on all 8 actions." in text
    assert [claim.judgement(results) for claim in SECTION.claims] == claims
