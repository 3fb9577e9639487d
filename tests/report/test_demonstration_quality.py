"""Methods on plain and refined demonstrations, side by side."""

from __future__ import annotations

from knotflow.report.results import Results
from knotflow.report.single_stage import imitation_not_over_icp

TREES = [(start, seed) for start in ("straight", "arc") for seed in range(4)]


def made(write, rate_counts, experiment, names):
    """Rates of 0.5 for imitation, as the paper has them for ICP, and trees of 3 to 6 splines."""
    counts = {
        (name, action): (50 if name == "imitation" else successes, 100)
        for name in names
        for (_, action), (successes, _) in rate_counts(("icp",)).items()
    }
    write.rates(experiment, counts)
    rows = [(name, start, seed, 3 + seed, True, 1.0) for name in names for start, seed in TREES]
    write.searches(experiment, "method", rows)
    if experiment == "single_stage":
        write.searches("tree_size", "method", rows)


def test_either_kind_of_demonstrations_is_shown(write, rate_counts):
    made(write, rate_counts, "single_stage", ("icp", "imitation"))
    names = ("icp", "icp_authors", "imitation", "icp_authors_refined")
    made(write, rate_counts, "demonstration_quality", names)
    text = write.body("demonstration_quality")
    lines = [line for line in text.splitlines() if line.startswith("| ")][2:]
    firsts = [tuple(cell.strip() for cell in line.split("|")[1:3]) for line in lines]
    methods = ("ICP", "ICP as coded", "imitation")
    assert firsts == [(kind, one) for kind in ("refined", "plain") for one in methods]
    assert lines[0].count("3 to 6 kept, median 4.5 (") == 2
    assert "50.0 %" in lines[2] and "With plain demonstrations imitation is above ICP on" in text


def test_refined_demonstrations_are_needed_beside_the_plain_ones(write, rate_counts):
    made(write, rate_counts, "demonstration_quality", ("icp",))
    assert write.body("demonstration_quality") is None


def test_imitations_claim_says_how_it_is_from_plain_demonstrations(write, rate_counts):
    made(write, rate_counts, "single_stage", ("icp", "imitation"))
    results = Results(write.root)
    alone = imitation_not_over_icp(results)
    assert alone.startswith("not higher on") and "plain" not in alone
    made(write, rate_counts, "demonstration_quality", ("icp", "imitation"))
    higher = sum(hits < 50 for hits, _ in rate_counts(("icp",)).values())
    found = imitation_not_over_icp(Results(write.root))
    assert found.startswith(alone) and found.endswith(f"higher on {higher} of 8")
