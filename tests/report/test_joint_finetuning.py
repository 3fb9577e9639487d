"""Joint finetuning in the report: searches, self-play, and single actions afterwards."""

import pytest

from knotflow.report.learning import read_curves
from knotflow.report.page import compose
from knotflow.report.results import Results
from knotflow.report.self_play import self_play, trials

CURVES = ("primitive", "step", "metric", "value")
PLAYED = [
    (number, step, "policy_success", 0.1 * number + 0.001 * step)
    for number in range(1, 7)
    for step in range(150)
]
PLAYED += [
    (1, step, metric, 10 * step)
    for step in range(150)
    for metric in ("pairs_tried", "pairs_solved")
]
RATES = ("method", "action", "trials", "successes", "success_rate", "ci_low", "ci_high")
TRIALS = ("start", "action", "trials", "successes", "recent_rate")
METHODS = ("independent", "joint")


def report(write):
    rows = [(method, seed, 3 + seed, True, 0.5) for method in METHODS for seed in (0, 1)]
    write.searches("joint_finetuning", "primitives", rows, with_start=False)
    return compose(Results(write.root), "results")


def test_self_play_says_what_it_tried(write):
    write.table("joint_finetuning", "curves_joint.csv", CURVES, PLAYED)
    rows = [("trivial", "R1(0,1,1)", 1000, 900, 0.9), ("2o1+", "C(0,1,1)", 500, 20, 0.1)]
    write.table("joint_finetuning", "trials.csv", TRIALS, [*rows, ("2o1+", "C(0,2,1)", 9, 0, 0)])
    text = report(write).markdown
    assert "learned together by\nself-play" in text and "(figures/self_play.png)" in text
    assert "confirms the knot type of 4 of 4 tied ropes" in text
    found = trials(Results(write.root), "joint_finetuning")
    assert found == {"trials": "1,509", "pairs": "3", "solved": "2", "often": "1"}


@pytest.mark.slow
def test_the_training_of_what_ships_goes_on_from_there(write):
    assert "library_training" not in report(write).markdown.split("# Beyond the paper")[0]
    write.table("library_training", "curves.csv", CURVES, PLAYED)
    text = compose(Results(write.root), "results").markdown
    own = text.split("## Training: longer self-play")[1].split("\n## ")[0]
    assert "(figures/library_training.png)" in own and "Self-play spent" not in own
    rows = [("trivial", "R1(0,1,1)", 1000, 900, 0.9)]
    write.table("library_training", "trials.csv", TRIALS, rows)
    text = compose(Results(write.root), "results").markdown
    assert "Self-play spent 1,000 trials on 1 pairs" in text


def test_single_actions_have_their_starts_resampled_where_these_were_kept(write):
    rates = [(method, "C(0,1,1)", 16, 8, 0.5, 0.28, 0.72) for method in METHODS]
    write.table("joint_finetuning", "single_actions.csv", RATES, rates)
    text = report(write).markdown
    assert "Wilson intervals, rollouts taken as independent" in text and "of 2 starts" not in text
    starts = [(*rate[:2], start, 8, 8 * start) for rate in rates for start in (0, 1)]
    columns = (*RATES[:2], "start", *RATES[2:4])
    write.table("joint_finetuning", "single_actions_per_start.csv", columns, starts)
    text = report(write).markdown
    assert "with the starts resampled" in text and "8 of 16<br>1 of 2 starts" in text


def test_primitives_beyond_the_papers_are_named(write):
    write.table("joint_finetuning", "curves_joint.csv", CURVES, PLAYED)
    svg = self_play(
        read_curves(Results(write.root), "joint_finetuning", "curves_joint.csv"), "s"
    ).svg
    for name in (b"1: R1", b"4: other Cross", b"5: arranging, state kept", b"6: undoing"):
        assert b">" + name + b"<" in svg
