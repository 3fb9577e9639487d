"""Each claim's verdict follows from the numbers, and the paper's own numbers hold."""

from __future__ import annotations

import pandas as pd
import pytest

from knotflow.report.page import CLAIMS, compose
from knotflow.report.results import Results
from knotflow.report.section import Figures, Verdict


@pytest.fixture
def report(write, undrawn):
    """The text of the report on what was written."""

    def composed():
        results = Results(write.root)
        return compose(results, Figures(results))

    return composed


def judgement(write, number):
    return CLAIMS[number][1].judgement(Results(write.root))


def trees(write, method, straight, arc, unsolved=()):
    rows = [
        (method, start, seed, kept, (start, seed) not in unsolved, 1.0)
        for start, counts in (("straight", straight), ("arc", arc))
        for seed, kept in enumerate(counts)
    ]
    write.searches("tree_size", "method", rows)


def test_the_papers_numbers_are_all_there():
    told = " ".join(claim.paper for _, claim in CLAIMS)
    for number in (
        *("100×", "1.14× to 2.33×", "3 to 190", "1,428", "up to 43", "9 (arc)", "below 5"),
        *("7 of 8", "4.3 ± 2.6 / 3.4 ± 0.6", "12 branches", "far apart"),
    ):
        assert number in told


def test_nothing_run_judges_nothing(write):
    found = [claim.judgement(Results(write.root)) for _, claim in CLAIMS]
    assert {outcome.verdict for outcome in found} == {Verdict.NOT_RUN}
    assert "needs per_start.csv in single_stage" in found[0].ours


@pytest.mark.parametrize(
    ("imitation", "verdict"), [(0.5, Verdict.HOLDS), (0.1, Verdict.PARTLY), (0.01, Verdict.FAILS)]
)
def test_imitation_against_random(write, rate_counts, imitation, verdict):
    counts = rate_counts(("random", "imitation"))
    for method, action in counts:
        if method == "random":
            counts[method, action] = (4, 400)
        else:
            counts[method, action] = (round(400 * imitation), 400)
    counts["imitation", "C(2,0,1)"] = (round(800 * imitation), 400)
    write.rates("single_stage", counts)
    assert judgement(write, 0).verdict is verdict


@pytest.mark.slow
def test_a_direction_that_holds_without_the_size_says_so(write, rate_counts, report):
    counts = dict.fromkeys(rate_counts(("random", "imitation")), (20, 400))
    counts |= {key: (300, 400) for key in counts if key[0] == "imitation"}
    write.rates("single_stage", counts)
    found = judgement(write, 0)
    assert found.verdict is Verdict.PARTLY and "compatible with 100×" in found.size
    text = report()
    assert "For 1 the direction holds and the size does not." in text
    assert "**holds partly**<br>the direction holds, the size does not: no ratio" in text


def test_an_action_that_is_missing_leaves_the_claim_open(write, rate_counts):
    counts = rate_counts(("random", "imitation"))
    del counts["imitation", "C(2,4,1)"]
    write.rates("single_stage", counts)
    found = judgement(write, 0)
    assert found.verdict is Verdict.NOT_RUN and "C(2,4,1)" in found.ours


def test_rates_that_are_all_zero_decide_nothing(write, rate_counts):
    counts = dict.fromkeys(rate_counts(("random", "imitation")), (0, 400))
    write.rates("single_stage", counts)
    assert judgement(write, 0).verdict is Verdict.NOT_RUN


def test_imitation_against_icp_needs_the_two_named_actions(write, rate_counts):
    counts = rate_counts(("icp", "imitation"))
    write.rates("single_stage", counts)
    assert judgement(write, 1).verdict is Verdict.HOLDS
    counts["imitation", "R1(0,1,1)"] = (4, 400)
    write.rates("single_stage", counts)
    assert judgement(write, 1).verdict is Verdict.PARTLY


def test_reinforcement_against_imitation(write, rate_counts):
    counts = rate_counts(("imitation", "reinforcement"))
    write.rates("single_stage", counts)
    assert judgement(write, 2).verdict is Verdict.HOLDS
    counts["reinforcement", "C(0,1,1)"] = (100, 400)
    write.rates("single_stage", counts)
    found = judgement(write, 2)
    assert found.verdict is Verdict.PARTLY and "better on 7 of 8" in found.ours


def test_the_papers_trees_hold(write):
    for number, method, straight, arc in (
        (3, "icp", [3, 190], [3, 1428]),
        (4, "imitation", [3, 43], [3, 9]),
        (5, "reinforcement", [3, 3, 4], [3, 3, 4]),
    ):
        trees(write, method, straight, arc)
        assert judgement(write, number).verdict is Verdict.HOLDS


@pytest.mark.parametrize(
    ("number", "method", "straight", "arc", "verdict"),
    [
        (3, "icp", [3, 190], [3, 10], Verdict.PARTLY),
        (3, "icp", [3, 5], [3, 10], Verdict.FAILS),
        (4, "imitation", [3, 44], [3, 9], Verdict.PARTLY),
        (4, "imitation", [3, 44], [3, 10], Verdict.FAILS),
        (5, "reinforcement", [3, 3, 5], [3, 3, 3], Verdict.PARTLY),
        (5, "reinforcement", [3, 4, 4], [3, 3, 5], Verdict.FAILS),
    ],
)
def test_other_trees_do_not(write, number, method, straight, arc, verdict):
    trees(write, method, straight, arc)
    assert judgement(write, number).verdict is verdict


def test_a_claim_that_does_not_hold_has_its_reason_and_one_that_holds_none(write, report):
    trees(write, "imitation", [3, 99], [3, 9])
    columns = ("method", "start", "state", "action", "simulated", "successes")
    rows = [("trivial", "R1(0,1,1)", 8, 8), ("2o1+", "C(0,1,1)", 8, 1)]
    tried = [("imitation", "straight", *row) for row in rows]
    write.table("tree_size", "tried.csv", columns, [*tried, ("imitation", "arc", *rows[0])])
    link = "- [Branches kept to the overhand, imitation only](#tree-size) holds partly: "
    (line,) = (one for one in report().splitlines() if one.startswith("- [Branches kept"))
    assert line.startswith(link) and "`C(0,1,1)` from the straight rope, 1 of 8 splines" in line
    assert "from the arc rope" not in line  # no spline failed there
    trees(write, "imitation", [3, 9], [3, 9])
    assert link not in report()


def joint_trees(write, independent, joint, solved=True):
    rows = [
        (training, "random", seed, kept, solved, 1.0)
        for training, counts in (("independent", independent), ("joint", joint))
        for seed, kept in enumerate(counts)
    ]
    write.searches("joint_finetuning", "training", rows, ("10", "11", "12"))


@pytest.mark.parametrize(
    ("number", "method", "kept", "alone"),
    [(4, "imitation", [(3, 9), (3, 9), (3, 99)], 2), (5, "reinforcement", [(3, 3), (3, 4)], 1)],
)
def test_each_training_is_judged_as_the_papers_one_too(write, number, method, kept, alone):
    rows = [
        (method, start, seed, kept[int(training)][seed % 2], True, 1.0, training)
        for training in map(str, range(len(kept)))
        for start in ("straight", "arc")
        for seed in range(10)
    ]
    columns = ("method", "start", "seed", "kept", "solved", "seconds", "training_seed")
    table = pd.DataFrame(rows, columns=[*columns]).assign(simulated=9, path="", reason="", goal="")
    (write.root / "tree_size").mkdir(exist_ok=True)
    table.to_csv(write.root / "tree_size" / "branches.csv", index=False)
    ours = judgement(write, number).ours
    assert ours.endswith(f"each training alone: both are so in {alone} of {len(kept)}")


def test_where_reinforcement_gains_little_both_rates_are_named(write, rate_counts):
    counts = rate_counts(("imitation", "reinforcement"))
    counts["imitation", "R1(0,1,1)"] = counts["reinforcement", "R2(0,0,1,1)"] = (200, 400)
    counts["reinforcement", "R1(0,1,1)"] = (100, 400)
    write.rates("single_stage", counts)
    found = CLAIMS[2][1].reason(Results(write.root))
    assert "less than 1.14× on `R1(0,1,1)` (25 against 50 %)" in found
    assert "no rate is" not in found
    counts["imitation", "C(2,0,1)"] = (380, 400)
    write.rates("single_stage", counts)
    assert "; on `C(2,0,1)` imitation succeeds so often" in CLAIMS[2][1].reason(Results(write.root))


def test_large_trees_are_the_reason_of_joint_finetuning(write):
    joint_trees(write, [5] * 9 + [55], [4] * 9 + [64])
    found = CLAIMS[7][1].reason(Results(write.root))
    assert "the largest tenth of the trees has 55 % / 64 % of all splines kept" in found
    assert "the standard deviation grows in 3 of 3 trainings" in found


def test_a_search_that_gave_up_keeps_within_no_bound(write):
    trees(write, "imitation", [3, 40], [3, 9], unsolved={("straight", 1)})
    found = judgement(write, 4)
    assert found.verdict is Verdict.PARTLY and "1 gave up" in found.ours


def test_actor_and_critic(write, rate_counts):
    counts = rate_counts(("actor_only", "critic_only", "actor_critic"))
    write.rates("ablation_actor_critic", counts)
    found = judgement(write, 6)
    assert found.verdict is Verdict.HOLDS and found.ours.startswith("best on 7 of 8")
    counts["critic_only", "C(2,4,1)"] = (130, 400)
    write.rates("ablation_actor_critic", counts)
    assert judgement(write, 6).verdict is Verdict.PARTLY
    assert CLAIMS[6][1].reason(Results(write.root)) == ""
    rows = [
        (method, seed, step, f"policy_success/{action}", value)
        for action in ("C(2,0,1)", "C(2,4,1)", "R1(0,1,1)")
        for seed in (10, 11)
        for step in range(10)
        for method, value in (("actor_critic", 0.9), ("critic_only", 0.5 + 0.3 * (step > 4)))
    ]
    columns = ("method", "training_seed", "step", "metric", "value")
    write.table("ablation_actor_critic", "curves.csv", columns, rows)
    reason = CLAIMS[6][1].reason(Results(write.root))
    assert "from 40 to 10 points on `C(2,0,1)` and from 40 to 10" in reason
    rows = [row for row in rows if row[0] != "critic_only" or row[3] != "policy_success/C(2,4,1)"]
    write.table("ablation_actor_critic", "curves.csv", columns, rows)
    assert CLAIMS[6][1].reason(Results(write.root)) == ""  # too few rounds for every action


@pytest.mark.parametrize(
    ("joint", "verdict"),
    [([3] * 40 + [4] * 10, Verdict.HOLDS), ([4] * 50, Verdict.FAILS), ([9] * 50, Verdict.FAILS)],
)
def test_joint_finetuning(write, joint, verdict):
    joint_trees(write, [3] * 30 + [4] * 10 + [8] * 10, joint)
    found = judgement(write, 7)
    assert found.verdict is verdict
    assert found.ours.startswith("4.2 ± 1.9 / ") and "by rank p = " in found.ours


def test_joint_finetuning_falls_short_in_size_if_less_is_saved_than_in_the_paper(write):
    joint_trees(write, [8, 9] * 25, [3] * 50)
    assert judgement(write, 7).size.startswith("means of 8.5")  # more than 4.3 without it
    joint_trees(write, [4] * 50, [3] * 25 + [4] * 25)
    assert judgement(write, 7).size.startswith("means of 4")
    joint_trees(write, [3, 5] * 25, [3] * 50)
    assert judgement(write, 7).size == ""


def test_joint_finetuning_has_to_narrow_most_trainings(write):
    joint_trees(write, [5, 6] * 25, [3] * 50)
    assert judgement(write, 7).verdict is Verdict.HOLDS
    path = write.root / "joint_finetuning" / "branches.csv"
    table = pd.read_csv(path)
    others = (table["training"] == "joint") & (table["training_seed"] != 10)
    table.loc[others & (table["seed"] == 0), "kept"] = 20
    table.to_csv(path, index=False)
    assert judgement(write, 7).verdict is Verdict.PARTLY


def test_joint_finetuning_does_not_hold_by_a_few_large_trees(write):
    """The mean falls, and most trees grow."""
    joint_trees(write, [3] * 48 + [200] * 2, [4] * 50)
    assert judgement(write, 7).verdict is Verdict.FAILS


def test_joint_finetuning_holds_at_most_partly_where_searches_gave_up(write):
    joint_trees(write, [8] * 50, [3] * 50)
    assert judgement(write, 7).verdict is Verdict.PARTLY  # no spread that could fall
    joint_trees(write, [8, 9] * 25, [3] * 50)
    assert judgement(write, 7).verdict is Verdict.HOLDS
    joint_trees(write, [8, 9] * 25, [3] * 50, solved=False)
    found = judgement(write, 7)
    assert found.verdict is Verdict.FAILS and found.ours.startswith("300 gave up<br>medians ∞ / ∞")
