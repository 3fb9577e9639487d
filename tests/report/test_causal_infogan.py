"""Causal InfoGAN in the report: its section, its figures, and the verdict on the claim."""

import numpy as np
import pytest

from knotflow.report.causal_infogan import far_projections, near_projections
from knotflow.report.page import SECTIONS
from knotflow.report.results import Results
from knotflow.report.section import Figures, Verdict

EXPERIMENT = "causal_infogan"
GOAL = "C(0,1,1)"
ROLES = ("given start", "projected start", "way point", "projected end", "given end")
PLANS = ("model", "seed", "goal", "shapes", "start", "start_distance", "end_distance")
PLANS += ("start_state", "end_state", "unevenness")
CURVE = ("model", "seed", "step", "spread", "starts_covered", "code_used", "distance_to_data")
CURVE += ("collapsed",)
METHODS = ("method", "action", "training_seed", "start", "trials", "successes")
PANEL = ("model", "seed", "goal", "shapes", "start", "column", "role", "vertex", "x", "y", "z")


def rope(bend):
    heading = bend * np.linspace(0, 1, 12)
    flat = 0.05 * np.stack([np.cos(heading), np.sin(heading)], axis=1).cumsum(axis=0)
    return np.column_stack([flat, np.linspace(0.008, 0.03, 12)])


def plans(distances, state="kept", seed=0, shapes="unseen"):
    return [
        ("single", seed, GOAL, shapes, i, 0.05, distance, "kept", state, 0.4)
        for i, distance in enumerate(distances)
    ]


def fill(write, rows, collapsed=("", "", "")):
    write.table(EXPERIMENT, "plans.csv", PLANS, rows)
    ends = [
        ("single", seed, 900, 0.9, 0.8, 0.9, 0.04, reason) for seed, reason in enumerate(collapsed)
    ]
    write.table(
        EXPERIMENT, "seeds.csv", CURVE, [*ends, ("all", 0, 900, 0.2, 0.9, 0.9, 0.1, "spread")]
    )
    early = [(*row[:2], 450, *row[3:]) for row in ends]
    write.table(EXPERIMENT, "training.csv", CURVE, [*early, *ends])
    panel = [
        ("single", 0, GOAL, shapes, 3, column, role, vertex, *(round(float(x), 4) for x in point))
        for shapes in ("training", "unseen")
        for column, role in enumerate(ROLES)
        for vertex, point in enumerate(rope(1.0 + 2 * column))
    ]
    write.table(EXPERIMENT, "panel.csv", PANEL, panel)
    compared = [
        (method, GOAL, seed, start, 4, 2 * (start < 2))
        for method, seed in (*(("causal_infogan_single", seed) for seed in (0, 1)), ("icp", ""))
        for start in range(4)
    ]
    write.table(EXPERIMENT, "comparison.csv", METHODS, compared)
    write.run(EXPERIMENT, {})


def body(write):
    results = Results(write.root)
    figures = Figures(results)
    return SECTIONS["causal_infogan"].body(results, figures), figures


@pytest.mark.slow
def test_section_has_panel_curves_and_tables(write):
    fill(write, plans([0.04, 0.06]) + plans([0.02], shapes="training"), ("", "", "spread"))
    text, figures = body(write)
    assert set(figures.made) == {"causal_infogan_panel_single", "causal_infogan_curves"}
    assert "2 of 3 trainings on one action and 0 of" in text
    assert "Causal InfoGAN, one action" in text and "<br>8 of 32<br>trainings 25 / 25 |" in text
    assert "| one action | `C(0,1,1)` | unseen | 1 | 2 | 50 | 50 (40 to 60) |" in text


def test_section_needs_all_its_tables(write):
    write.table(EXPERIMENT, "plans.csv", PLANS, plans([0.04]))
    assert body(write)[0] is None


@pytest.mark.parametrize(
    ("distances", "state", "verdict"),
    [
        ([0.04, 0.05, 0.06, 0.05], "another", Verdict.HOLDS),
        ([0.04, 0.05, 0.06, 0.05], "kept", Verdict.PARTLY),
        ([0.04, 0.05, 0.06, 0.05], "unreadable", Verdict.PARTLY),
        ([0.002, 0.003, 0.002, 0.004], "another", Verdict.PARTLY),
        ([0.002, 0.003, 0.002, 0.004], "unreadable", Verdict.FAILS),
    ],
)
def test_the_claim_needs_distance_and_another_topology(write, distances, state, verdict):
    fill(write, plans(distances, state))
    assert far_projections(Results(write.root)).verdict is verdict


def test_models_on_the_same_starts_are_not_more_starts(write):
    distances = [0.0, 0.0, 0.0, 0.06]
    fill(write, plans(distances, "another"))
    one = far_projections(Results(write.root))
    fill(write, [row for seed in range(3) for row in plans(distances, "another", seed)])
    three = far_projections(Results(write.root))
    assert one.verdict is three.verdict is Verdict.PARTLY
    assert "(0 to 45)" in one.ours and "(0 to 45)" in three.ours


def test_ends_of_the_training_data_have_to_be_far_too(write):
    unseen = plans([0.04, 0.05, 0.06], "another")
    fill(write, unseen + plans([0.04, 0.05], shapes="training"))
    assert far_projections(Results(write.root)).verdict is Verdict.HOLDS
    fill(write, unseen + plans([0.004, 0.005], shapes="training"))
    found = far_projections(Results(write.root))
    assert found.verdict is Verdict.PARTLY and "training ends: 4" in found.ours
    assert "training ends are not" in near_projections(Results(write.root))
    fill(write, plans([0.04, 0.05, 0.06]))  # far, and all of the given topology
    assert near_projections(Results(write.root)) == ""


def test_collapsed_trainings_and_training_shapes_raise_no_verdict(write):
    rows = plans([0.001, 0.002]) + plans([0.3, 0.4], "another", seed=1)
    rows += plans([0.5], "another", shapes="training")
    fill(write, rows, ("", "spread", ""))
    found = far_projections(Results(write.root))
    assert found.verdict is Verdict.FAILS and "2 of 3 trainings did not collapse" in found.ours


def test_the_claim_is_open_until_it_was_run(write):
    (claim,) = SECTIONS["causal_infogan"].claims
    assert claim.judgement(Results(write.root)).verdict is Verdict.NOT_RUN
    write.table(EXPERIMENT, "plans.csv", PLANS, plans([0.04]))
    assert "seeds.csv" in claim.judgement(Results(write.root)).ours
