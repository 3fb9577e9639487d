"""What people type, and what Hydra is given of it."""

import pytest

from knotflow.__main__ import HOME
from knotflow.overrides import OverrideError, checked


def given(*words):
    return checked(list(words), HOME)


@pytest.mark.parametrize("asked", ["+experiment", "++experiment", "experiment"])
def test_an_experiment_is_asked_for_with_any_prefix(asked):
    assert given(f"{asked}=knots") == ["+experiment=knots"]
    assert given(f"{asked}=knots", "--cfg", "job") == ["+experiment=knots", "--cfg", "job"]


@pytest.mark.parametrize("words", [["-sc", "install=bash"], ["--help"], ["--cfg", "job"]])
def test_hydras_own_options_pass(words):
    assert given(*words) == words


@pytest.mark.parametrize(
    ("word", "full"),
    [
        ("knot=overhand", "plan.knot=overhand"),
        ("knot=overhand,pentagram", "plan.knot=overhand,pentagram"),
        ("knot=[(4,1,1),(2,5,1),(6,3,1)]", "plan.knot='[(4,1,1),(2,5,1),(6,3,1)]'"),
        ("knot=R1(0,1,1) C(0,1,1)", "plan.knot='R1(0,1,1) C(0,1,1)'"),
        ('knot="4o1+2o5+6o3+"', 'plan.knot="4o1+2o5+6o3+"'),
        ("plan.knot=4o1+2o5+6o3+", "plan.knot='4o1+2o5+6o3+'"),
        ("rope=ropes/my rope (2).csv", "plan.rope='ropes/my rope (2).csv'"),
        ("seed=3", "plan.seed=3"),
        ("planner.max_seconds=5", "plan.planner.max_seconds=5"),
    ],
)
def test_what_to_plan_is_written_in_full_and_as_text(word, full):
    assert given("+experiment=overhand", word) == ["+experiment=overhand", full]


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("simulation.rope.lenght=2", "mean simulation.rope.length.*simulation.rope has length,"),
        ("radius=0.01", "did you mean simulation.rope.radius"),
        ("plan.sed=1", "did you mean plan.seed"),
        ("sed=1", "did you mean .*seed"),
        ("xyzzy=1", "the configuration has experiment, budget"),
        ("seed=-1", "plan.seed must be 0 or more, got -1"),
        ("training.seed=3,-2", "training.seed must be 0 or more"),
    ],
)
def test_wrong_keys_and_seeds_are_named_with_what_was_meant(word, message):
    with pytest.raises(OverrideError, match=message):
        given("+experiment=overhand", word)


@pytest.mark.parametrize(
    "word",
    ["simulation.rope.length=2", "hydra.sweep.dir=x", "+more=1", "~budget", "budget=smoke",
     "workflow.stages.plan.config.seed=2", "experiments=[knots]", "workflows@workflow=knots"],
)  # fmt: skip
def test_what_is_right_passes(word):
    assert given("+experiment=overhand", word)[1] == word


def test_a_launcher_without_its_extra_names_it(monkeypatch):
    monkeypatch.setattr("knotflow.overrides.find_spec", lambda name: None)
    with pytest.raises(OverrideError, match=r"pip install 'knotflow\[launchers\]'"):
        given("+experiment=knots", "hydra/launcher=submitit_slurm")
    assert given("+experiment=knots", "hydra/launcher=basic")
