import json
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import hydra
import pytest
import yaml
from tests.experiments.configuration import composed

from knotflow.experiments import run
from knotflow.experiments.config import HOME, experiments, register
from knotflow.experiments.run import check_added, run_experiment, stale, workflow_of
from knotflow.report.page import PAPER
from knotflow.workflow import WorkflowError, dependencies

EXPERIMENTS = [name for name in experiments() if name not in ("everything", "paper")]


@cache
def all_workflows(*overrides):
    """A root configuration, and the workflow of every experiment, by its name."""
    every = (f"+workflows@workflow.{name}={name}" for name in EXPERIMENTS)
    config = composed(*overrides, *every)
    return config, dict(config.workflow.items())


@cache
def bound(experiment, budget, *overrides):
    config, workflows = all_workflows(f"budget={budget}", *overrides)
    config.workflow = workflows[experiment]
    return workflow_of(config)


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_an_experiment_is_the_workflow_of_its_name(experiment):
    text = (HOME / "conf" / "experiment" / f"{experiment}.yaml").read_text()
    assert text.startswith("# @package _global_\n")
    assert yaml.safe_load(text) == {"defaults": [{"/workflows@workflow": experiment}]}


def test_all_workflows_are_composed_as_one_is():
    config = composed("+experiment=goals", "budget=smoke")
    assert workflow_of(config) == bound("goals", "smoke")


@pytest.mark.slow
@pytest.mark.parametrize("budget", ["paper", "smoke"])
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_experiment_binds_and_has_results(experiment, budget):
    workflow = bound(experiment, budget)
    assert workflow.name == experiment and workflow.caption
    assert workflow.results and workflow.keys.keys() == workflow.nodes.keys()


def swept(name):
    text = (HOME / "conf" / "experiment" / f"{name}.yaml").read_text()
    return text.partition(">-")[2].replace("\n", "").replace(" ", "").split(",")


def test_the_sweep_over_all_experiments_names_each():
    assert sorted([*swept("everything"), "learning_options", "real_images"]) == EXPERIMENTS


def test_a_job_of_a_sweep_runs_as_its_experiment_does(monkeypatch):
    made = []
    monkeypatch.setattr(run, "run_workflow", lambda *made_of, **how: made.append((made_of, how)))
    register()
    overrides = ["+workflows@workflow=overhand", "+experiment=paper", "budget=smoke"]
    with hydra.initialize_config_dir(str(HOME / "conf"), version_base="1.3"):
        run_experiment(hydra.compose("config", overrides=overrides), overrides)
    [((workflow, folder), how)] = made
    assert workflow == bound("overhand", "smoke") and folder == Path("results/smoke")
    assert how["name"] == "overhand" and how["overrides"] == []


def test_a_value_that_is_the_default_is_called_so(monkeypatch, caplog):
    monkeypatch.setattr(run, "run_workflow", lambda *_, **how: how["overrides"])
    overrides = ["+experiment=knots", "knots.seed=20", "++workers.jobs=1", "++results_name=mine"]
    with hydra.initialize_config_dir(str(HOME / "conf"), version_base="1.3"):
        kept = run_experiment(hydra.compose("config", overrides=overrides), overrides)
    assert kept == ["knots.seed=20"]
    assert caplog.messages == ["knots.seed=20 changes nothing: it is the default"]


def test_the_paper_is_the_experiments_that_the_report_says_are_its():
    assert sorted(swept("paper")) == sorted(section.experiment for section in PAPER)


def test_experiments_share_what_they_train():
    keys = [
        bound(experiment, "paper").keys
        for experiment in (
            "single_stage",
            "tree_size",
            "joint_finetuning",
            "causal_infogan",
            "pentagram",
        )
    ]
    for shared in ("demonstrations", "imitation", "pools", "reinforcement"):
        assert len({one.get(shared) or one[f"{shared}[10]"] for one in keys}) == 1
    ablation, library = (
        bound(experiment, "paper").keys
        for experiment in ("ablation_actor_critic", "library_training")
    )
    for shared in ("imitation[11]", "reinforcement[11]"):
        assert keys[3][shared] == keys[0][shared]  # of Causal InfoGAN, another training
    for one in (ablation, library):
        assert keys[0]["demonstrations"] == one["demonstrations"]
        assert keys[0]["pools"] == one["pools"]
    assert ablation["imitation[actor_critic.11]"] == keys[0]["imitation[11]"]
    assert ablation["reinforcement[actor_critic.10]"] == library["reinforcement"]
    assert ablation["reinforcement[actor_only.10]"] != library["reinforcement"]


def test_what_is_trained_has_a_node_for_each_seed_and_the_rest_one_folder():
    keys = bound("single_stage", "paper").keys
    for method, count in (("random", 1), ("reinforcement_arranged", 1), ("reinforcement", 3)):
        assert len({keys[f"evaluation[{method}.{seed}]"] for seed in (10, 11, 12)}) == count


def test_groups_and_sections_are_overridden_from_the_command_line():
    nodes = workflow_of(
        composed("+experiment=knots", "planner=paper", "rope.length=0.8", "knots.seeds=3")
    ).nodes
    arguments = nodes["searches"].arguments
    assert (arguments["planner"].rule, arguments["seeds"]) == ("paper", 3)
    assert arguments["simulation"].rope.length == 0.8


def test_an_added_value_is_one_that_a_stage_takes():
    workflow = bound("goals", "paper")
    good = (
        "+experiment=goals",
        "+workers.jobs=2",
        "+tree_size.planner.batch=8",
        "+goals={seed: 3}",
    )
    check_added(workflow, good)
    with pytest.raises(
        WorkflowError, match="'tree'; those of 'goals' take planner, sampler, seed, sets"
    ):
        check_added(workflow, [*good, "+goals.tree=5"])


def test_planner_ablations_lack_one_part_each():
    nodes = bound("goals_ablation", "paper").nodes
    complete = nodes["goals[complete]"].arguments
    lacking = {
        "without_arranging": {"arranging": 0},
        "without_next_value": {"use_next_value": False},
        "paper_search": {"rule": "paper", "use_next_value": False},
    }
    for name, changes in lacking.items():
        planner = replace(complete["planner"], **changes)
        assert nodes[f"goals[{name}]"].arguments == complete | {"planner": planner}


def test_tree_size_is_measured_by_the_papers_rule_one_expansion_at_a_time():
    nodes = bound("tree_size", "paper").nodes
    for method in ("icp", "imitation", "reinforcement"):
        planner = nodes[f"searches[{method}.11]"].arguments["planner"]
        assert (planner.rule, planner.batch, planner.max_branches) == ("paper", 1, 2000)


def test_searches_of_icp_are_the_same_for_every_training():
    keys = bound("tree_size", "paper").keys
    for method, count in (("icp", 1), ("imitation", 3), ("reinforcement", 3)):
        seeds = {keys[f"searches[{method}.{seed}]"] for seed in (10, 11, 12)}
        assert len(seeds) == count


def test_seeds_of_evaluations_are_used_for_nothing_else():
    stages = {}
    for experiment in EXPERIMENTS:
        for node in bound(experiment, "paper").nodes.values():
            if (seed := node.arguments.get("seed")) is not None:
                stages.setdefault(seed, set()).add(node.stage.name)
    for stage in ("goals", "actions", "evaluation_starts", "closed_loop", "arm", "tracking"):
        of_stage = [names for names in stages.values() if stage in names]
        count = 2 if stage == "evaluation_starts" else 1  # those to choose by, and those to report
        assert of_stage == [{stage}] * count


@pytest.mark.slow
def test_an_overhand_is_planned_into_its_folder(command, tmp_path):
    overrides = ["overhand.start=straight", "overhand.planner.max_branches=64", "training=authors"]
    done = command("+experiment=overhand", "budget=smoke", *overrides, results=tmp_path)
    assert done.returncode == 0, done.stderr
    unused = re.findall("(.*) changes nothing: no stage of overhand takes it", done.stdout)
    assert unused == ["training=authors"]
    assert "changes nothing: it is the default" not in done.stdout
    record = json.loads((tmp_path / "overhand" / "run.json").read_text())
    assert record["overrides"] == overrides
    assert not [*stale(tmp_path)]
    made = {path.name for path in (tmp_path / "overhand").iterdir()}
    assert {"plan.png", "plan.json", "plan.mcap", "waypoints.csv", "branches.csv"} <= made


@pytest.fixture
def results(tmp_path):
    """A results folder whose benchmark is of today's code."""
    workflow = bound("benchmark", "paper")
    stages = {
        name: {"key": workflow.keys[name], **workflow.identities[name]} for name in workflow.nodes
    }
    run = {"workflow": "benchmark", "budget": "paper", "stages": stages, "ships": {}}
    (tmp_path / "benchmark").mkdir()
    (tmp_path / "benchmark" / "run.json").write_text(json.dumps(run))
    return tmp_path


SHIPS = {"samplers/primitives/data": {"node": "throughput", "digest": "0" * 16}}
"""Weights that are not those in the package."""


def run_with_keys_of(workflow, file):
    run = json.loads(file.read_text())
    for name, made in run["stages"].items():
        made["key"] = workflow.keys[name]
    return run


def test_todays_results_are_not_stale(results):
    assert not [*stale(results)]


def test_an_upgraded_library_makes_results_stale(results, monkeypatch):
    before = dependencies.minor_version

    def upgraded(name):
        return "99.0" if name == "mujoco" else before(name)

    monkeypatch.setattr(dependencies, "minor_version", upgraded)
    found = {one.where: one.reasons for one in stale(results)}
    assert found.keys() == {"benchmark/throughput", "benchmark/gradient_steps"}
    assert any("mujoco" in reason and "99.0" in reason for reason in found["benchmark/throughput"])


def test_changed_shipped_weights_and_unknown_experiments_are_stale(results):
    shutil.copytree(results / "benchmark", results / "gone")
    file = results / "gone" / "run.json"
    file.write_text(file.read_text().replace('"workflow": "benchmark"', '"workflow": "gone"'))
    file = results / "benchmark" / "run.json"
    run = json.loads(file.read_text())
    run["ships"] = SHIPS
    file.write_text(json.dumps(run))
    assert {one.where for one in stale(results)} == {"gone", "samplers/primitives/data"}
    file.write_text(json.dumps(run | {"ships": {}, "overrides": ["rope.root=head"]}))
    found = {one.where: one.reasons for one in stale(results)}
    assert "do not fit today's: Could not override 'rope.root'" in found["benchmark"][0]
    file.write_text(json.dumps(run | {"ships": {}, "overrides": ["primitives=moved"]}))
    shutil.copytree(results / "benchmark", results / "knots")
    file = results / "knots" / "run.json"
    file.write_text(file.read_text().replace('"workflow": "benchmark"', '"workflow": "knots"'))
    found = {one.where: one.reasons for one in stale(results)}
    assert "primitives=moved: there is no such file" in found["knots"][0]


def test_what_ships_is_not_of_another_budget(results):
    file = results / "benchmark" / "run.json"
    run = run_with_keys_of(bound("benchmark", "afternoon"), file)
    file.write_text(json.dumps(run | {"budget": "afternoon", "ships": SHIPS}))
    assert not [*stale(results)]


def test_results_of_other_values_are_compared_with_these(results):
    file = results / "benchmark" / "run.json"
    workflow = workflow_of(composed("+experiment=benchmark", "benchmark.rollouts=7"))
    run = run_with_keys_of(workflow, file)
    file.write_text(json.dumps(run))
    assert [one.where for one in stale(results)] == ["benchmark/throughput"]
    file.write_text(json.dumps(run | {"overrides": ["benchmark.rollouts=7"]}))
    assert not [*stale(results)]


def test_where_nothing_can_be_compared_nothing_is_called_current(results, tmp_path):
    with pytest.raises(WorkflowError, match="nowhere: there is no .*run.json"):
        [*stale(tmp_path / "nowhere")]
    (results / "benchmark" / "run.json").write_text('{"workflow": "benchmark", "stages": {}}')
    with pytest.raises(WorkflowError, match="benchmark/run.json: has no budget"):
        [*stale(results)]
    (results / "benchmark" / "run.json").write_text("<<<<<<< HEAD")
    with pytest.raises(WorkflowError, match="benchmark/run.json: cannot be read"):
        [*stale(results)]


def test_a_stage_that_is_new_and_a_library_that_is_not_installed_are_called_so(
    results, monkeypatch
):
    file = results / "benchmark" / "run.json"
    run = json.loads(file.read_text())
    del run["stages"]["throughput"]
    file.write_text(json.dumps(run))
    installed = dependencies.minor_version
    monkeypatch.setattr(
        dependencies, "minor_version", lambda name: "" if name == "torch" else installed(name)
    )
    found = {one.where: one.reasons for one in stale(results)}
    assert found["benchmark/throughput"] == ("not made yet",)
    [torch] = found["benchmark/gradient_steps"]
    assert torch.startswith("torch ") and torch.endswith(" -> not installed")


NAMED = (
    "single_stage",
    "tree_size",
    "joint_finetuning",
    "ablation_actor_critic",
    "learning_options",
)


@pytest.mark.parametrize("experiment", NAMED)
def test_rows_of_primitives_are_of_primitives_whatever_the_group(experiment):
    nodes = bound(experiment, "paper", "sampler=random").nodes
    own = [
        one for one in nodes.values() if "sampler" in one.arguments and "primitives" in one.inputs
    ]
    assert own
    for node in own:
        assert node.arguments["sampler"].name == "primitives", node.name


@pytest.mark.parametrize("sampler", ["aimed", "icp", "icp_authors", "random"])
@pytest.mark.parametrize("experiment", ["actions", "goals", "knots", "overhand", "tree_size"])
def test_a_sampler_binds_with_its_inputs_or_is_refused(experiment, sampler):
    if sampler.startswith("icp") and experiment != "tree_size":
        with pytest.raises(WorkflowError, match="demonstrations"):
            bound(experiment, "paper", f"sampler={sampler}")
        return
    for node in bound(experiment, "paper", f"sampler={sampler}").nodes.values():
        if "primitives" in node.stage.inputs and "sampler" in node.arguments:
            assert {*node.arguments["sampler"].inputs()} <= node.inputs.keys(), node.name
