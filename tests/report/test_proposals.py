"""Proposals to look at: read with care, and counted in the figure."""

import numpy as np
import pytest

from knotflow.report import ResultsError
from knotflow.report.page import compose
from knotflow.report.proposals.figure import proposals
from knotflow.report.proposals.records import read_proposals
from knotflow.report.results import Results

COLUMNS = ("action", "start", "what", "proposal", "outcome", "point", "x", "y", "z")
# An alpha: the last link passes over the first one.
ALPHA = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0.1], [1, -1, 0.1]], float) / 10


def item(action, start, what, proposal, outcome, points):
    return [
        (action, start, what, proposal, outcome, place, *point)
        for place, point in enumerate(np.asarray(points).tolist())
    ]


def rows(outcomes=("success", "failure"), after=True, action="C(0,1,1)", start=0):
    made = item(action, start, "before", "", "", ALPHA)
    for number, outcome in enumerate(outcomes):
        made += item(action, start, "spline", number, outcome, [[0, 0, 0], [1, 0, 1], [1, 1, 0]])
    if after:
        made += item(action, start, "after", 0, outcomes[0], ALPHA + 0.1)
    return made


def read(write, made):
    write.table("single_stage", "proposals.csv", COLUMNS, made)
    return read_proposals(Results(write.root), "single_stage")


def test_ropes_and_splines_are_read_back(write):
    (rope,) = read(write, rows())
    np.testing.assert_allclose(rope.before, ALPHA)
    np.testing.assert_allclose(rope.after, ALPHA + 0.1)
    assert [spline.succeeded for spline in rope.splines] == [True, False]
    np.testing.assert_allclose(rope.splines[0].controls, [[0, 0, 0], [1, 0, 1], [1, 1, 0]])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda made: made[:2] + made[3:], "3 does not follow the row before"),
        (lambda made: made[:5], "needs a rope before and a spline"),
        (lambda made: made[:7], "a spline has 3 control points"),
        (lambda made: [row[:4] + ("maybe",) + row[5:] for row in made], "'maybe' is none of"),
        (lambda made: [row[:2] + ("rope",) + row[3:] for row in made], "'rope' is none of"),
    ],
)
def test_a_spoilt_table_is_refused_with_the_reason(write, spoil, message):
    with pytest.raises(ResultsError, match=message):
        read(write, spoil(rows()))


@pytest.mark.slow
def test_the_figure_tells_counts_and_is_the_same_each_time(write):
    made = rows() + rows(("diverged",), after=False, start=1) + rows(action="C(2,0,1)")
    ropes = read(write, made)
    picture = proposals(ropes, "p")
    assert "3 unseen ropes of 2 topological actions with 5 proposed splines" in picture.alt
    assert b">1 of 3<" in picture.svg and b"blew up" in picture.svg
    assert picture.svg == proposals(ropes, "p").svg


@pytest.mark.slow
def test_the_report_shows_it_beside_the_rates(write, rate_counts):
    write.rates("single_stage", rate_counts(("random",)))
    assert "To look at" not in compose(Results(write.root), "results").markdown
    write.table("single_stage", "proposals.csv", COLUMNS, rows())
    report = compose(Results(write.root), "results")
    assert "(figures/proposals.png)" in report.markdown
    assert "proposals" in [picture.name for picture in report.pictures]
