"""Goals drawn at random: what is said of those tied, and of those not."""

import pytest

from knotflow.report.goals import SECTION, share_tied
from knotflow.report.page import compose
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Pictures

TIED = [("three", f"2o1+{3 + 2 * i}o{4 + 2 * i}+", True, 2.0 + i) for i in range(3)]
MISSED = ("three", "4o3-2o1-", False, 60.1)


def values(write):
    return SECTION.values(Results(write.root), Pictures())


def test_sets_have_their_shares_and_medians_of_what_was_tied(write):
    write.goals([*TIED, MISSED, ("four", "1o2-", True, 0.5)])
    three, four = values(write)["table"].splitlines()[2:]
    assert "75.0 %" in three and "3 of 4" in three
    assert "| 120 | 3.0 s | 3 of 3 |" in three
    assert "100.0 %" in four and "1 of 1" in four


def test_every_goal_that_was_not_tied_is_listed_with_the_reason(write):
    write.goals([*TIED, MISSED])
    text = compose(Results(write.root), "results").markdown
    assert "This goal was not tied." in text
    assert "| three | `4o3-2o1-` | 3 | 2,404 | 60 s passed |" in text
    assert "confirms the knot type of 3 of 3 tied ropes" in text
    write.goals(TIED)
    assert "not tied" not in compose(Results(write.root), "results").markdown


@pytest.mark.parametrize("rows", [TIED[:1], [MISSED]])
def test_a_single_search_is_drawn_whether_it_tied_or_not(write, rows):
    write.goals(rows)
    pictures = Pictures()
    found = SECTION.values(Results(write.root), pictures)
    assert found["missed"] == (rows == [MISSED])
    share = "0 %" if rows == [MISSED] else "100 %"
    assert f">{share}<".encode() in pictures.made[0].svg


def test_the_figures_interval_is_wilsons(write):
    write.goals([*TIED, MISSED])
    table = Results(write.root).table("goals", "goals.csv")
    rate = share_tied(table.assign(solved=table["solved"] == "True"))
    # Wilson's interval of 3 in 4, from the published formula.
    assert (rate.low, rate.high) == (
        pytest.approx(0.3006, abs=1e-4),
        pytest.approx(0.9544, abs=1e-4),
    )


def test_spoilt_tables_are_refused(write):
    path = write.goals([*TIED, MISSED])
    path.write_text(path.read_text().replace("60 s passed", ""))
    with pytest.raises(ResultsError, match="column 'reason', row 4 .*4o3-2o1- was not tied"):
        values(write)
    write.goals([*TIED, TIED[0]])
    with pytest.raises(ResultsError, match="stands in an earlier row already"):
        values(write)


def test_without_a_run_there_is_no_section(write):
    assert values(write) is None
