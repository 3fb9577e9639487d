"""What single actions and ablation cost: every stage once, by kind, beside the aim."""

import shutil

import pytest
import yaml

import knotflow.workflow.stages  # noqa: F401  registers them
from knotflow.report.page import compose
from knotflow.report.results import Results
from knotflow.report.section import Pictures
from knotflow.report.timing import KIND_OF_STAGE, cost, spent, timing
from knotflow.workflow.stage import STAGES


def stage(name, seconds, signature):
    return {"stage": name, "seconds": seconds, "signature": signature}


SHARED = {
    "demonstrations": stage("demonstrations", 400.0, "d"),
    "imitation": stage("imitation", 900.0, "i"),
    "reinforcement": stage("reinforcement", 3000.0, "r"),
}
SINGLE = SHARED | {
    "pools": stage("pools", 100.0, "p"),
    "random": stage("evaluation", 60.0, "e"),
    "success_rates": stage("success_rates", 1.0, "s"),
}


def ablation(seconds):
    return SHARED | {"actor_only_reinforcement": stage("reinforcement", seconds, "a")}


def told(write, seconds=2000.0, budget="paper"):
    write.run("single_stage", SINGLE, budget)
    write.run("ablation_actor_critic", ablation(seconds), budget)
    return cost(Results(write.root), Pictures())


def test_each_stage_is_counted_once_and_by_its_kind(write):
    told(write)
    split = spent(Results(write.root))
    assert split["single_stage"] == {
        "simulation": 500.0,
        "training": 3900.0,
        "evaluation": 60.0,
        "tables": 1.0,
    }
    assert sum(split["ablation_actor_critic"].values()) == 2000.0


@pytest.mark.slow
@pytest.mark.parametrize(("seconds", "within"), [(2000.0, True), (7000.0, False)])
def test_the_total_stands_beside_the_aim(write, rate_counts, seconds, within):
    found = told(write, seconds)
    assert found["complete"] and found["paper"] and found["within"] is within
    write.rates("single_stage", rate_counts(("random",)))
    text = compose(Results(write.root), "results").markdown
    assert ("it is met." in text) is within and ("**it is missed.**" in text) is not within


@pytest.mark.slow
def test_a_smoke_run_is_not_held_against_the_aim(write, rate_counts):
    assert not told(write, budget="smoke")["paper"]
    write.rates("single_stage", rate_counts(("random",), 12), "smoke")
    text = compose(Results(write.root), "results").markdown
    assert "do not bear on it" in text and "it is met" not in text


def test_half_of_it_is_not_called_the_whole(write):
    write.run("single_stage", SINGLE)
    found = cost(Results(write.root), Pictures())
    assert not found["complete"] and "together" not in found["table"]
    (write.root / "empty").mkdir()
    assert cost(Results(write.root / "empty"), Pictures()) is None


def test_attempts_are_counted_from_the_configuration(write):
    assert told(write)["attempts"] == 0  # nothing says how many
    columns = ("demonstration", "trials")
    write.table("single_stage", "demonstrations.csv", columns, [(0, 300), (1, 100)])
    effort = {"rounds": 2, "ropes": 5, "splines": 3}
    config = {"stages": {"reinforcement": {"config": {"reinforcement": effort}}}}
    (write.root / "single_stage" / "config.yaml").write_text(yaml.safe_dump(config))
    found = cost(Results(write.root), Pictures())
    assert found["attempts"] == 8 * 2 * 5 * 3
    assert found["attempts_time"] == "4 min 0 s"  # at a second each


def test_time_and_memory_are_told_by_stage_and_by_kind(write):
    write.run("goals", {"goals": stage("goals", 90.0, "g") | {"memory_mb": 1234}})
    write.run("single_stage", SHARED)  # made before memory was noted
    found = timing(Results(write.root), Pictures())
    kinds = found["kinds"].splitlines()
    assert "| training | 2 | 1 h 5 min | – |" in kinds
    assert "| evaluation | 1 | 1 min 30 s | 1,234 MB |" in kinds
    assert found["table"].count("MB") == 1


def test_every_stage_that_can_be_run_has_a_kind_and_any_other_is_unknown(write):
    ours = {name for name, one in STAGES.items() if one.function.__module__.startswith("knotflow.")}
    assert ours == KIND_OF_STAGE.keys()
    write.run("goals", {"mine": stage("my_own", 90.0, "g")})
    found = timing(Results(write.root), Pictures())
    assert found["kinds"].splitlines()[2:] == ["| unknown | 1 | 1 min 30 s | – |"]


def test_trainings_of_what_is_shipped_stand_beside_all_else(write):
    write.run("joint_finetuning", {"self_play": stage("self_play", 7200.0, "s")})
    write.run("perception_training", {"learn": stage("perception_training", 3600.0, "p")})
    write.run("self_play_ablation", {"self_play": stage("self_play", 60.0, "a")})  # of its own
    assert "and dynamics) it was\n1 min 0 s; these trainings took 3 h 0 min." in page(write)
    shutil.rmtree(write.root / "joint_finetuning")
    shutil.rmtree(write.root / "perception_training")
    assert "these trainings" not in page(write)


def page(write):
    return compose(Results(write.root), "results").markdown


def test_captions_that_repeat_have_their_experiment_before_them(write):
    for name, caption in (("goals", "Same"), ("knots", "Same"), ("roots", "Another")):
        write.run(name, {"one": stage("roots", 9.0, name) | {"caption": caption}})
    pictures = Pictures()
    timing(Results(write.root), pictures)
    svg = pictures.made[0].svg
    assert all(label in svg for label in (b">goals: Same<", b">knots: Same<", b">Another<"))


def test_a_cluster_is_as_fast_as_the_shards_allow(write):
    assert timing_of(write, {})["cluster"] == ""
    found = timing_of(write, {"shards": 10, "cpus": 2})
    # 100 s on two CPUs are five rounds of shards; eight take two rounds, 32 one.
    assert found["cluster"].splitlines()[2:] == [
        "| 2 | 2 min 30 s |",
        "| 8 | 1 min 30 s |",
        "| 32 | 1 min 10 s |",
        "| 128 | 1 min 10 s |",
    ]
    assert found["unknown"] == 1


def timing_of(write, more):
    alone = stage("self_play", 50.0, "s")
    write.run("goals", {"actions": stage("actions", 100.0, "a") | more, "self_play": alone})
    return timing(Results(write.root), Pictures())
