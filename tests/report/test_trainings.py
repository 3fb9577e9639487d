"""Trainings of the networks: their curves, and where they ended."""

import pytest

from knotflow.report.page import compose
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Pictures
from knotflow.report.trainings import DYNAMICS, PERCEPTION

CURVES = {
    DYNAMICS: (
        ("step", "error_mm", "validation_1_mm", "validation_10_mm", "validation_25_mm"),
        [(400, 4.0, 0.8, 14.2, 24.6), (200, 5.0, 1.4, 31.7, 47.8)],
        "0.8 mm after 0.1 s, 14.2 mm after 1 s and 24.6 mm after 2.5 s. The last weights are kept.",
    ),
    PERCEPTION: (
        ("step", "loss", "validation_loss", "validation_error_mm", "validation_median_mm")
        + ("validation_crossings",),
        [(200, 9.0, 8.5, 73.4, 68.3, 0.55), (400, 6.8, 5.9, 21.0, 18.8, 0.849)],
        "off by 21.0 mm on the average (median rope 18.8 mm), and 84.9\u00a0% of crossings",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("section", CURVES)
def test_the_line_is_of_the_last_validation_whatever_the_order(write, section):
    columns, rows, words = CURVES[section]
    write.table(section.experiment, "curves.csv", columns, rows)
    report = compose(Results(write.root), "results")
    assert "After 400 gradient steps" in report.markdown and words in report.markdown
    (picture,) = [one for one in report.pictures if one.name == section.experiment]
    assert b">gradient step<" in picture.svg and "over 400 gradient" in picture.alt


@pytest.mark.parametrize("section", CURVES)
def test_a_curve_that_lacks_a_column_is_refused(write, section):
    columns, rows, _ = CURVES[section]
    write.table(section.experiment, "curves.csv", columns[:-1], [row[:-1] for row in rows])
    with pytest.raises(ResultsError, match=f"column '{columns[-1]}' is missing"):
        section.values(Results(write.root), Pictures())
