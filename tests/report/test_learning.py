"""Learning curves in the report."""

import pytest

from knotflow.report import ResultsError
from knotflow.report.learning import (
    by_action,
    imitation,
    read_curves,
    reinforcement,
    smoothed,
)
from knotflow.report.page import compose
from knotflow.report.results import Results

COLUMNS = ("primitive", "step", "metric", "value")
IMITATED = [
    (primitive, step, f"{part}{metric}", value + primitive)
    for primitive in (1, 3)
    for metric, values in (
        *(("loss_critic", (0.7, 0.4, 0.5)), ("loss_actor", (6.0, 5.0, 4.0))),
        ("critic_accuracy", (0.5, 0.6, 0.7)),
    )
    for part in ("", "validation_")
    for step, value in enumerate(values)
]
REINFORCED = [
    (3, step, f"policy_success/{action}", value)
    for action in ("C(4,2,1)", "C(0,1,1)")
    for step, value in enumerate((0.2, 0.5, 0.9))
] + [(3, 0, "loss_critic", 0.3)]


def read(write, rows, name="curves_imitation.csv"):
    write.table("single_stage", name, COLUMNS, rows)
    return read_curves(Results(write.root), "single_stage", name)


def test_curves_are_by_primitive_and_metric_from_1_on(write):
    curves = read(write, IMITATED)
    assert curves[3, "validation_loss_critic"].to_dict() == {1: 3.7, 2: 3.4, 3: 3.5}
    assert (2, "validation_loss_critic") not in curves
    assert "imitation of 2 primitives" in imitation(curves, "i").alt


def test_actions_have_curves_of_their_own(write):
    curves = read(write, REINFORCED, "curves_reinforcement.csv")
    found = by_action(curves, 3)
    assert list(found) == ["C(0,1,1)", "C(4,2,1)"]
    assert found["C(0,1,1)"].index.tolist() == [1, 2, 3]
    svg = reinforcement(curves, "r").svg
    assert svg.index(b">C(0,1,1)<") < svg.index(b">C(4,2,1)<")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ((1, 0, "loss_critic", 0.1), "stands in an earlier row already"),
        ((1, 9, "loss_critic", "nan"), "is not a number"),
    ],
)
def test_a_spoilt_table_is_refused(write, row, message):
    with pytest.raises(ResultsError, match=message):
        read(write, [*IMITATED, row])


def test_smoothing_keeps_ends_and_straight_lines():
    assert smoothed([0.3]) == [0.3]
    line = [0.1 * step for step in range(9)]
    assert smoothed(line) == pytest.approx(line)
    assert smoothed([0, 0, 1, 0, 0])[2] == pytest.approx(0.2)


def test_without_an_actor_its_panel_is_empty(write):
    rows = [row for row in IMITATED if "actor" not in row[2]]
    assert b"critic: cross-entropy" in imitation(read(write, rows), "i").svg


@pytest.mark.slow
def test_the_report_shows_both(write, rate_counts):
    write.rates("single_stage", rate_counts(("random",)))
    assert "**Learning.**" not in compose(Results(write.root), "results").markdown
    write.table("single_stage", "curves_imitation.csv", COLUMNS, IMITATED)
    write.table("single_stage", "curves_reinforcement.csv", COLUMNS, REINFORCED)
    text = compose(Results(write.root), "results").markdown
    assert "(figures/imitation.png)" in text and "(figures/reinforcement.png)" in text
