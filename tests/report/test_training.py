"""Learning curves in the report."""

import pytest

from knotflow.report import training
from knotflow.report.page import SECTIONS
from knotflow.report.results import Results, ResultsError
from knotflow.report.section import Figures

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
PLAYED = [
    (number, step, "policy_success", 0.1 * number + 0.001 * step)
    for number in range(1, 7)
    for step in range(150)
] + [(1, step, name, step) for step in range(150) for name in ("pairs_tried", "pairs_solved")]


@pytest.fixture
def figures(write):
    write.run("single_stage", {})
    return Figures(Results(write.root))


def test_curves_are_by_primitive_and_metric_from_1_on(write, figures):
    write.table("single_stage", "curves_imitation.csv", COLUMNS, IMITATED)
    curves = training.read_curves(figures.results, "single_stage", "curves_imitation.csv")
    assert curves[3, "validation_loss_critic"].to_dict() == {1: 3.7, 2: 3.4, 3: 3.5}
    assert (2, "validation_loss_critic") not in curves


@pytest.mark.parametrize(
    ("row", "message"),
    [((1, 0, "loss_critic", 0.1), "is there twice"), ((1, 9, "loss_critic", "nan"), "value is")],
)
def test_invalid_curves_are_refused(write, figures, row, message):
    write.table("single_stage", "curves_imitation.csv", COLUMNS, [*IMITATED, row])
    with pytest.raises(ResultsError, match=message):
        training.imitation(figures.results, figures, "single_stage")


@pytest.mark.slow
def test_imitation_and_reinforcement_are_drawn_where_they_were_kept(write, figures):
    arguments = figures.results, figures, "single_stage"
    assert training.imitation(*arguments) == training.reinforcement(*arguments) == ""
    without_actor = [row for row in IMITATED if "actor" not in row[2]]
    write.table("single_stage", "curves_imitation.csv", COLUMNS, without_actor)
    write.table("single_stage", "curves_reinforcement.csv", COLUMNS, REINFORCED)
    assert "(figures/imitation.png)" in training.imitation(*arguments)
    assert "(figures/reinforcement.png)" in training.reinforcement(*arguments)


def test_episodes_are_drawn_beside_the_primitives_that_they_train(write, figures):
    assert training.joint(figures.results, figures, "single_stage") == ""
    tied = [(1, step, "tied", 0.02 * step) for step in range(40)]
    write.table("single_stage", "curves_joint.csv", COLUMNS, [*PLAYED, *tied])
    assert "(figures/joint_training.png)" in training.joint(
        figures.results, figures, "single_stage"
    )


def test_self_play_counts_its_trials(write, figures):
    assert SECTIONS["library_training"].body(figures.results, figures) is None
    write.table("library_training", "curves.csv", COLUMNS, PLAYED)
    columns = ("start", "action", "trials", "successes", "recent_rate")
    rows = [("trivial", "R1(0,1,1)", 1000, 900, 0.9), ("2o1+", "C(0,1,1)", 500, 20, 0.1)]
    write.table("library_training", "trials.csv", columns, [*rows, ("2o1+", "C(0,2,1)", 9, 0, 0)])
    text = write.body("library_training")
    assert "knot_finetuning" not in text
    assert "spent 1,509 trials on 3 pairs" in text and "; 2 succeeded at least once, and 1 " in text
    assert "(figures/library_training.png)" in text
    tied = [(1, step, "tied", 0.02 * step) for step in range(40)]
    write.table("library_training", "knot_curves.csv", COLUMNS, [*PLAYED, *tied])
    text = write.body("library_training")
    assert "(figures/knot_finetuning.png)" in text


def test_networks_end_where_the_last_validation_was_whatever_the_order(write):
    columns = ("step", "loss", "validation_loss", "validation_crossings")
    rows = [(400, 6.8, 5.9, 0.849), (200, 9.0, 8.5, 0.55)]
    write.table("strand_training", "curves.csv", columns, rows)
    text = write.body("strand_training")
    assert "| gradient steps | loss, held out | crossings, held out |" in text
    assert "| 400 | 5.90 | 0.85 |" in text and "(figures/strand_training.png)" in text


def test_what_networks_are_judged_by_has_units(write):
    columns = ("step", "error_mm", "validation_10_mm", "validation_ends")
    write.table("dynamics_training", "curves.csv", columns, [(400, 2.5, 12.0, 0.999)])
    text = write.body("dynamics_training")
    titles = ("error, mm, training", "error after 1 s, mm, held out", "ends recognised, held out")
    assert f"| gradient steps | {' | '.join(titles)} |" in text
    assert "| 400 | 2.50 | 12.0 | 99.9 % |" in text
