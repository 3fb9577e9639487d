"""The demonstrations' section: a line an action, and a sheet of all of them."""

import numpy as np
import pytest

from knotflow.report.contact_sheet import COLUMNS, contact_sheet
from knotflow.report.demonstrator import values
from knotflow.report.page import compose
from knotflow.report.proposals.records import Proposed, Rope
from knotflow.report.results import Results
from knotflow.report.section import Pictures

SHARES = ("action", "share", "room", "starts_left_out")
ALPHA = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0.1], [1, -1, 0.1]], float) / 10


def ropes(count, action="C(0,1,1)"):
    spline = Proposed(np.array([[0, 0, 0], [0.1, 0, 0.1], [0.1, 0.1, 0]]), "success")
    return [Rope(action, start, ALPHA, (spline,), ALPHA + 0.1) for start in range(count)]


@pytest.mark.slow
def test_every_demonstration_is_on_the_sheet_with_its_note():
    shown = ropes(COLUMNS + 1) + ropes(2, "C(2,0,1)")
    notes = [f"note {number}" for number in range(len(shown))]
    picture = contact_sheet(shown, notes, "sheet")
    assert "11 demonstrations of 2 topological actions" in picture.alt
    svg = picture.svg.decode()
    assert all(f">{note}<" in svg for note in notes)
    assert svg.count(">C(2,0,1)<") == 2
    assert picture.svg == contact_sheet(shown, notes, "sheet").svg


def test_an_action_has_one_line_with_its_means(write):
    rows = [("C(0,1,1)", 0.5, 0.1, 2), ("C(0,1,1)", 0.9, 0.3, 1), ("R1(0,1,1)", 1.0, 0.25, 0)]
    write.table("demonstrator", "shares.csv", SHARES, rows)
    told = values(Results(write.root), Pictures())
    assert "| `C(0,1,1)` | 2 | 0.70 | 0.50 | 0.20 | 3 |" in told["table"]
    assert told["sheet"] == ""
    assert "| `R1(0,1,1)` | 1 | 1.00" in compose(Results(write.root), "results").markdown


def test_it_was_not_run_where_there_is_no_table(write):
    assert values(Results(write.root), Pictures()) is None
