"""Joint finetuning in the report: self-play, and the results of earlier versions."""

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
TRIALS = ("start", "action", "trials", "successes", "recent_rate")
SEARCH = ("primitives", "seed", "branches", "solved", "seconds", "goal")
PATH = "R1(0,1,1) C(0,1,1) C(2,0,1)"


def write_searches(write, goal):
    rows = [
        (method, seed, 3 + seed, True, 0.5, goal)
        for method in ("independent", "joint")
        for seed in (0, 1)
    ]
    write.table("joint_finetuning", "branches.csv", SEARCH, rows)


def report(write):
    return compose(Results(write.root), "results")


def test_self_play_says_what_it_tried(write):
    write_searches(write, "overhand")
    write.table("joint_finetuning", "curves_joint.csv", CURVES, PLAYED)
    rows = [("trivial", "R1(0,1,1)", 1000, 900, 0.9), ("2o1+", "C(0,1,1)", 500, 20, 0.1)]
    write.table("joint_finetuning", "trials.csv", TRIALS, [*rows, ("2o1+", "C(0,2,1)", 9, 0, 0)])
    text = report(write).markdown
    assert "learned together by\nself-play" in text and "along any path" in text
    assert "(figures/self_play.png)" in text and "(figures/joint.png)" not in text
    found = trials(Results(write.root), "joint_finetuning")
    assert found == {"trials": "1,509", "pairs": "3", "solved": "2", "often": "1"}


def test_what_was_trained_along_one_path_is_still_read_and_says_so(write):
    write_searches(write, PATH)
    rows = [(1, step, "policy_success/R1(0,1,1)", 0.5) for step in range(3)]
    rows += [(4, step, "episode_success", 0.1 * step) for step in range(3)]
    write.table("joint_finetuning", "curves_joint.csv", CURVES, rows)
    text = report(write).markdown
    assert "keep to one path" in text and "self-play:" not in text
    assert "(figures/joint.png)" in text and "(figures/self_play.png)" not in text


def test_primitives_beyond_the_papers_are_named(write):
    write.table("joint_finetuning", "curves_joint.csv", CURVES, PLAYED)
    svg = self_play(
        read_curves(Results(write.root), "joint_finetuning", "curves_joint.csv"), "s"
    ).svg
    for name in (b"1: R1", b"4: other Cross", b"5: arranging, state kept", b"6: undoing"):
        assert b">" + name + b"<" in svg
