"""The command that plans one knot, as a newcomer types it."""

import json
from dataclasses import replace
from functools import cache, partial

import knotflow.workflow.stages  # noqa: F401  registers them
import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir
from knotflow.config import SPARING_SEARCH, contents, plan_folder, register

from knotflow.__main__ import HOME
from knotflow.planning import KnotPlan
from knotflow.workflow import Workflow


@pytest.fixture
def plan(command):
    return partial(command, "+experiment=overhand", "sampler=aimed")


@pytest.mark.slow
def test_a_plan_is_told_written_and_told_again(plan, tmp_path):
    points = np.zeros((25, 3))
    points[:, 0] = np.linspace(-0.5, 0.5, 25)
    np.save(tmp_path / "measured.npy", points)
    # Quoted, for Hydra reads brackets.
    asked = ("knot='R1(0,1,1)'", f"rope={tmp_path / 'measured.npy'}", "seed=4")
    done = plan(*asked, results=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "R1(0,1,1)  2o1+" in done.stdout
    assert "tied (the goal was reached)" in done.stdout and " branches, " in done.stdout
    (folder,) = tmp_path.glob("plan-*")
    assert {path.name for path in folder.iterdir()} == {
        *("plan.mcap", "plan.png", "plan.svg", "plan.gif", "plan.json", "waypoints.csv"),
        *("dag.png", "dag.svg", "branches.csv", "outcome.json", "config.yaml", "run.json"),
    }
    found = KnotPlan.from_json((folder / "plan.json").read_text())
    assert found.solved
    waypoints = pd.read_csv(folder / "waypoints.csv")
    assert set(waypoints["closed"]) == {0, 1}
    before = (folder / "run.json").read_bytes()
    again = plan(*asked, results=tmp_path)
    assert again.returncode == 0
    assert "R1(0,1,1)  2o1+" in again.stdout
    assert (folder / "run.json").read_bytes() == before


@pytest.mark.slow
def test_a_failed_search_says_so_and_a_bad_rope_is_named(plan, tmp_path):
    failed = plan("knot=pentagram", "planner.max_branches=2", results=tmp_path)
    assert failed.returncode == 1
    assert "pentagram: NOT tied (2 branches were simulated" in failed.stdout
    (folder,) = tmp_path.glob("plan-pentagram-*")
    assert not json.loads((folder / "outcome.json").read_text())["success"]
    assert (folder / "plan.png").is_file() and (folder / "plan.mcap").is_file()

    points = np.zeros((25, 3))
    points[:, 0] = np.linspace(-0.5, 0.5, 25)
    points[7, 1] = np.nan
    np.save(tmp_path / "nan.npy", points)
    bad = plan(f"rope={tmp_path / 'nan.npy'}", results=tmp_path)
    assert bad.returncode == 1
    assert "point 7 (counted from 0)" in bad.stderr
    assert not list(tmp_path.glob("plan-overhand-nan*"))
    assert "goes on" not in bad.stderr
    assert not list(tmp_path.rglob("*.partial"))


@pytest.mark.slow
def test_what_to_plan_is_refused_where_nothing_is_planned(command, tmp_path):
    done = command("+experiment=benchmark", "seed=3", results=tmp_path)
    assert done.returncode != 0
    assert "'seed=3' says what to plan, but the experiment benchmark takes nothing" in done.stderr
    assert not list(tmp_path.rglob("*.csv"))


def test_the_plan_of_the_report_has_the_experiments_folder_and_others_their_own():
    assert plan_folder("overhand", "random", 0) == "overhand"
    others = [
        plan_folder(*asked)
        for asked in (
            ("overhand", "random", 1),
            ("overhand", "straight", 0),
            ("pentagram", "random", 0),
            ("4o1+2o5+6o3+", "random", 0),
            ("4o1-2o5-6o3-", "random", 0),
            ("R1(0,1,1) C(0,1,1)", "random", 0),
            ("R1(0,1,-1) C(0,1,1)", "random", 0),
            ("overhand", "/some/where/rope.csv", 0),
        )
    ]
    assert len(set(others)) == len(others)
    assert all(name.startswith("plan-") and "/" not in name for name in others)


def test_files_of_one_name_and_other_points_have_folders_of_their_own(tmp_path):
    for name in ("one", "two", "copy"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "measured.csv").write_text("two" if name == "two" else "one")
    names = {
        name: plan_folder("overhand", str(tmp_path / name / "measured.csv"), 0)
        for name in ("one", "two", "copy")
    }
    assert names["one"] == names["copy"] != names["two"]


@pytest.mark.slow
def test_a_plan_of_another_search_takes_no_place(command, tmp_path):
    (tmp_path / "overhand").mkdir()
    (tmp_path / "overhand" / "config.yaml").write_text(
        (HOME / "results" / "overhand" / "config.yaml").read_text("utf-8")
    )
    done = command(
        "+experiment=overhand", "sampler=random", "planner.max_seconds=1", results=tmp_path
    )
    assert done.returncode == 1
    assert "sampler: 'primitives' there, 'random' now" in done.stderr
    assert "overwrite=true" in done.stderr
    assert [path.name for path in (tmp_path / "overhand").iterdir()] == ["config.yaml"]


@pytest.mark.parametrize("name", ["random", "nowhere.npy"])
def test_contents_of_no_file_are_its_name(name):
    assert contents(name) == name


def test_contents_of_a_file_are_what_is_in_it(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).write_text("the same")
    assert contents(str(tmp_path / "one")) == contents(str(tmp_path / "two")) != str(tmp_path)


@pytest.fixture(scope="module")
def workflow_of():
    """The workflow of an experiment, as the command composes it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("KNOTFLOW_HOME", str(HOME))
        register()
        with initialize_config_dir(str(HOME / "conf"), version_base="1.3"):
            yield cache(
                lambda *overrides: Workflow.from_config(
                    compose("config", overrides=list(overrides)).workflow
                )
            )


@pytest.mark.slow
@pytest.mark.parametrize("budget", ["paper", "smoke"])
@pytest.mark.parametrize(
    "experiment", ["overhand", "tree_size", "joint_finetuning", "pentagram", "knots"]
)
def test_every_workflow_that_plans_can_be_run(workflow_of, experiment, budget):
    workflow = workflow_of(f"+experiment={experiment}", f"budget={budget}")
    seeds = {
        name: workflow.config(name).seeds
        for name, node in workflow.stages.items()
        if node.stage == "plans"
    }
    paper = {"knots": 20, "joint_finetuning": 50}.get(experiment, 10)
    smoke = {"joint_finetuning": 2}.get(experiment, 1)
    assert set(seeds.values()) <= {paper if budget == "paper" else smoke}


def test_the_tree_size_is_measured_branch_by_branch_and_by_one_rule_for_all(workflow_of):
    workflow = workflow_of("+experiment=tree_size")
    for name in ("icp", "imitation_search", "reinforcement_search"):
        config = workflow.config(name)
        assert config.planner == SPARING_SEARCH
        assert (config.planner.batch, config.planner.value_bias) == (1, 0.0)
        assert {case.goal for case in config.cases} == {"R1(0,1,1) C(0,1,1) C(2,0,1)"}
        assert [case.start for case in config.cases] == ["straight", "arc"]


def test_joint_finetuning_is_measured_on_any_overhand_before_and_after(workflow_of):
    workflow = workflow_of("+experiment=joint_finetuning")
    searches = [workflow.config(f"{name}_search") for name in ("independent", "joint")]
    assert searches[0] == searches[1]
    assert [(case.goal, case.start) for case in searches[0].cases] == [("overhand", "random")]
    assert searches[0].seeds == 50
    tree_size = workflow_of("+experiment=tree_size").config("reinforcement_search")
    assert searches[0].planner == tree_size.planner
    needs = [workflow.stages[f"{name}_search"].needs for name in ("independent", "joint")]
    assert needs == [{"primitives": "reinforcement"}, {"primitives": "self_play"}]


EXPERIMENTS = (
    *("single_stage", "tree_size", "ablation_actor_critic", "joint_finetuning", "pentagram"),
    *("knots", "goals", "goals_ablation", "actions"),
)


@pytest.mark.parametrize("budget", ["paper", "smoke"])
def test_random_goals_are_searched_for_within_the_limit(workflow_of, budget):
    config = workflow_of("+experiment=goals", f"budget={budget}").config("goals")
    counts = {one.name: (one.crossings, one.count) for one in config.sets}
    many = budget == "paper"
    assert counts == {"three": (3, 60 if many else 1), "four": (4, 40 if many else 1)}
    assert config.planner.max_seconds == 60
    assert (
        config.planner
        == workflow_of("+experiment=knots", f"budget={budget}").config("searches").planner
    )


@pytest.mark.slow
def test_ablations_search_for_the_same_goals_and_lack_one_part(workflow_of):
    workflow = workflow_of("+experiment=goals_ablation")
    complete = workflow.config("complete")
    all_goals = workflow_of("+experiment=goals").config("goals")
    assert (complete.planner, complete.seed) == (all_goals.planner, all_goals.seed)
    lacking = {
        "without_arranging": {"arranging": 0},
        "without_onward": {"use_next_value": False},
        "paper_search": {"rule": "paper", "use_next_value": False},
    }
    for name, changes in lacking.items():
        planner = replace(complete.planner, **changes)
        assert workflow.config(name) == replace(complete, planner=planner)


@pytest.mark.slow
def test_what_is_drawn_to_measure_is_drawn_by_seeds_of_its_own(workflow_of):
    seeds = {}
    for experiment in EXPERIMENTS:
        workflow = workflow_of(f"+experiment={experiment}")
        for name, node in workflow.stages.items():
            if (seed := getattr(workflow.config(name), "seed", None)) is not None:
                seeds.setdefault(seed, set()).add(node.stage)
    for stage in ("goals", "actions", "starts"):
        assert [stages for stages in seeds.values() if stage in stages] == [{stage}]


@pytest.mark.parametrize("experiment", ["tree_size", "joint_finetuning"])
def test_what_single_stage_has_trained_is_not_trained_again(workflow_of, experiment):
    single, own = workflow_of("+experiment=single_stage"), workflow_of(f"+experiment={experiment}")
    for name in ("demonstrations", "imitation", "pools", "reinforcement"):
        assert own.config(name) == single.config(name)
        assert own.stages[name].needs == single.stages[name].needs


@pytest.mark.parametrize("experiment", ["pentagram", "knots", "goals", "actions"])
def test_what_goes_beyond_the_paper_is_measured_with_the_shipped_library(workflow_of, experiment):
    own, single = workflow_of(f"+experiment={experiment}"), workflow_of("+experiment=single_stage")
    assert own.config("library") == single.config("library")
    assert not {"demonstrations", "imitation", "reinforcement", "self_play"} & set(own.stages)


def test_arranging_is_measured_on_the_starts_of_the_papers_methods(workflow_of):
    workflow = workflow_of("+experiment=single_stage")
    paper, arranged = (
        workflow.config("reinforcement_evaluation"),
        workflow.config("reinforcement_arranged"),
    )
    assert (paper.arranging, arranged.arranging) == (0, 3)
    assert (arranged.seed, arranged.trials_per_start) == (paper.seed, paper.trials_per_start)
    assert workflow.stages["reinforcement_arranged"].needs["starts"] == "evaluation_starts"
