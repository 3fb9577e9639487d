"""Ropes with splines: read with care, drawn the same each time; the demonstrations' section."""

import numpy as np
import pytest

from knotflow.report.results import Results, ResultsError
from knotflow.report.ropes import read_ropes, sheet
from knotflow.report.section import Figures

COLUMNS = ("action", "start", "what", "proposal", "outcome", "point", "x", "y", "z")
SHARES = ("action", "share", "room", "starts_left_out")
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


def read(write, made, experiment="single_stage", name="proposals.csv"):
    write.table(experiment, name, COLUMNS, made)
    return read_ropes(Results(write.root), experiment, name)


def test_ropes_and_splines_are_read_back(write):
    (rope,) = read(write, rows())
    np.testing.assert_allclose(rope.before, ALPHA)
    np.testing.assert_allclose(rope.after, ALPHA + 0.1)
    assert [succeeded for _, succeeded in rope.splines] == [True, False]
    np.testing.assert_allclose(rope.splines[0][0], [[0, 0, 0], [1, 0, 1], [1, 1, 0]])


@pytest.mark.parametrize("kept", [slice(None, 5), slice(None, 7), slice(5, None)])
def test_incomplete_rope_is_refused(write, kept):
    with pytest.raises(ResultsError, match="needs a rope before and splines"):
        read(write, rows()[kept])


@pytest.mark.slow
def test_sheet_is_the_same_each_time(write):
    made = rows() + rows(("diverged",), after=False, start=1) + rows(action="C(2,0,1)")
    ropes = read(write, made)
    first, second = (Figures(Results(write.root)) for _ in range(2))
    for figures in (first, second):
        shown = sheet(figures, "ropes", "Three ropes. Drawn.", ropes, ["a", "b", "c"], 2)
    assert shown == "![Three ropes](figures/ropes.png)\n\n*Figure 1. Three ropes. Drawn.*"
    assert first.made == second.made


def test_demonstrations_have_one_line_an_action(write, undrawn):
    shares = [("C(0,1,1)", 0.5, 0.1, 2), ("C(0,1,1)", 0.9, 0.3, 1), ("R1(0,1,1)", 1.0, 0.25, 0)]
    write.table("demonstrator", "shares.csv", SHARES, shares)
    shapes = [*rows(), *rows(start=1), *rows(action="R1(0,1,1)")]
    write.table("demonstrator", "shapes.csv", COLUMNS, shapes)
    text = write.body("demonstrator")
    assert "| `C(0,1,1)` | 2 | 0.70 | 0.50 | 0.20 | 3 |" in text
    assert "| `R1(0,1,1)` | 1 | 1.00" in text and "![All demonstrations" in text
