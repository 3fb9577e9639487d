"""Plans in other worlds, and ropes of other sizes."""

import pytest

from knotflow.report.results import ResultsError
from knotflow.report.robustness import COLUMNS, DISTURBANCES, LAB_ROPES, METHODS


def table(write, tied):
    rows = [
        (method, disturbance, rope, 10, tied(method, rope), 100 * (rope + 1), 2.5)
        for method in METHODS
        for disturbance in DISTURBANCES
        for rope in range(3)
    ]
    write.table("robustness", "robustness.csv", [*COLUMNS], rows)


@pytest.mark.usefixtures("undrawn")
def test_rates_are_over_worlds_and_ropes(write):
    table(write, lambda method, rope: 9 if method == "shipped" else 3 * rope)
    text = write.body("robustness")
    (shipped,) = (line for line in text.splitlines() if line.startswith("| chosen in 16"))
    assert shipped.count("90.0 % ") == len(DISTURBANCES) and shipped.endswith("| 200 |")
    (first,) = (line for line in text.splitlines() if line.startswith("| first plan"))
    assert first.count("30.0 % (0.0 to 60.0)") == len(DISTURBANCES)
    (chosen,) = (line for line in text.splitlines() if line.startswith("| plan chosen in 16"))
    assert chosen.count("| 60.0 (30.0 to 90.0) ") == 3  # 90 % less 0, 30 and 60
    (trained,) = (line for line in text.splitlines() if line.startswith("| primitives trained"))
    assert trained.count("| 0.0 ") == 3
    assert "| plan | none | pace |" in text and "Whiskers are 95 % intervals" in text


def test_more_worlds_tied_than_there_are_is_refused(write):
    table(write, lambda *_: 11)
    with pytest.raises(ResultsError, match="more worlds tied than there are"):
        write.body("robustness")


def test_ropes_have_a_row_a_knot(write):
    rows = [
        ("cord", 0.5, 0.004, 0.02, knot, disturbance, seed, seed < most, 40)
        for knot, most in (("overhand", 3), ("figure_eight", 0))
        for disturbance in ("exact", "level_1")
        for seed in range(4)
    ]
    write.table("ropes", "ropes.csv", [*LAB_ROPES], rows)
    lines = write.body("ropes").splitlines()
    assert lines[-2].startswith("| cord | 0.5 m by 4 mm, 2 cm | overhand | 75.0 % ")
    assert "<br>3 of 4 | 40 | 75.0 %" in lines[-2]
    assert "| figure eight | 0.0 % " in lines[-1] and "<br>0 of 4 | – |" in lines[-1]
