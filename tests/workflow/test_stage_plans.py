"""The stages that plan, called by hand on searches of a second."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from knotflow.planning import KnotPlan, PlannerConfig, SolutionDag
from knotflow.recording import load
from knotflow.samplers.sampler import SamplerConfig
from knotflow.simulation import SimulationConfig
from knotflow.topology import TopologicalState, Undo, segment_intervals
from knotflow.viz import plan_folder
from knotflow.workflow import StageContext
from knotflow.workflow.stages import overhand, plans, plans_checks, plans_tables
from knotflow.workflow.stages.plans import PlanCase, PlansConfig, make_plans, read_searches
from knotflow.workflow.stages.plans_pull import PULL, PlansPullConfig, make_pulled
from knotflow.workflow.stages.plans_shown import (
    PlansDagConfig,
    PlansExemplarConfig,
    picture,
    show,
)

pytestmark = pytest.mark.slow

LOOP = "R1(0,1,1)"  # aimed guesses succeed often
AIMED = SamplerConfig("aimed")
SIMULATION = SimulationConfig(threads=1)
SEARCH = PlannerConfig(batch=8, max_branches=40)
CONFIG = PlansConfig(
    simulation=SIMULATION,
    sampler=AIMED,
    planner=SEARCH,
    cases=[PlanCase(LOOP, "random"), PlanCase(LOOP, "mine")],
    seeds=2,
    seed=20,
)


@pytest.fixture(scope="module")
def start(tmp_path_factory):
    """A stage's output that holds a start: a straight rope along y."""
    folder = tmp_path_factory.mktemp("start")
    points = np.full((41, 3), 0.008)
    points[:, 1] = np.linspace(-0.5, 0.5, 41)
    np.save(folder / "start.npy", points)
    return folder


@pytest.fixture(scope="module")
def planned(start, tmp_path_factory):
    out = tmp_path_factory.mktemp("plans")
    make_plans(CONFIG, {"mine": start}, StageContext(out, "0123456789abcdef"))
    return out


def plan_of(out, name):
    return KnotPlan.from_json((out / "plans" / f"{name}.json").read_text())


def test_every_case_is_searched_with_every_seed(planned, start):
    table = read_searches(planned / "searches.csv")
    assert table["plan"].tolist() == ["00-000", "00-001", "01-000", "01-001"]
    assert table["start"].tolist() == ["random"] * 2 + ["mine"] * 2
    assert table["seed"].tolist() == [0, 1, 0, 1]
    assert table["solved"].any()
    for row in table.itertuples():
        plan = plan_of(planned, row.plan)
        assert (plan.branches, plan.solved) == (row.branches, row.solved)
        if row.solved:
            assert row.path == LOOP
            assert str(TopologicalState.from_curve(plan.shapes[-1])) == "2o1+"
            assert row.confirmed in ("yes", plans.NOT_CHECKED)
        else:
            assert row.confirmed == row.knot_type == row.path == ""
    np.testing.assert_array_equal(plan_of(planned, "01-001").start, np.load(start / "start.npy"))


def test_every_branch_is_recorded(planned):
    table, rollouts = read_searches(planned / "searches.csv"), load(planned / "recordings")
    assert rollouts["number"].is_unique
    counted = pd.Series([extra["plan"] for extra in rollouts["extra"]]).value_counts()
    assert counted.to_dict() == dict(zip(table["plan"], table["branches"], strict=True))
    assert set(rollouts["source"]) == {"aimed"}


def test_a_seed_has_the_same_start_whatever_is_planned(planned, tmp_path):
    config = replace(
        CONFIG, cases=[PlanCase("overhand", "random")], planner=PlannerConfig(max_branches=1)
    )
    make_plans(config, {}, StageContext(tmp_path))
    for seed in (0, 1):
        one, other = plan_of(planned, f"00-{seed:03d}"), plan_of(tmp_path, f"00-{seed:03d}")
        np.testing.assert_array_equal(one.start, other.start)
    table = read_searches(tmp_path / "searches.csv")
    assert table["branches"].tolist() == [1, 1]
    assert not table["solved"].any()
    assert table["reason"].str.contains("1 branches were simulated").all()
    assert not np.array_equal(plan_of(tmp_path, "00-000").start, plan_of(tmp_path, "00-001").start)


def test_a_start_can_be_tied_first(tmp_path):
    """Another rope for each seed, as the search leaves it, in the state at the path's end."""
    config = replace(CONFIG, cases=[PlanCase("R1(0,1,1) C(0,1,1)", LOOP)])
    make_plans(config, {}, StageContext(tmp_path))
    plans = [plan_of(tmp_path, f"00-{seed:03d}") for seed in (0, 1)]
    assert {str(plan.start_state) for plan in plans} == {"2o1+"}
    assert not np.array_equal(plans[0].start, plans[1].start)


def test_interrupted_searches_go_on_and_end_the_same(planned, start, tmp_path):
    for name in ("00-000", "01-001"):
        for path in (f"rows/{name}.csv", f"plans/{name}.json", f"recordings/{name}.mcap"):
            (tmp_path / path).parent.mkdir(exist_ok=True)
            (tmp_path / path).write_bytes((planned / path).read_bytes())
    kept = (tmp_path / "rows" / "00-000.csv").stat().st_mtime_ns
    make_plans(CONFIG, {"mine": start}, StageContext(tmp_path, "0123456789abcdef"))
    assert (tmp_path / "rows" / "00-000.csv").stat().st_mtime_ns == kept
    one, other = (
        read_searches(out / "searches.csv").drop(columns="seconds") for out in (planned, tmp_path)
    )
    pd.testing.assert_frame_equal(one, other)


@pytest.mark.parametrize(
    ("case", "message"),
    [
        (PlanCase("granny", "straight"), "unknown knot 'granny'"),
        (PlanCase(LOOP, "mine"), "one of straight, arc, random, tangled, a path of actions, or an"),
        (PlanCase(LOOP, "R9(0)"), "R9"),
    ],
)
def test_a_senseless_case_is_refused_before_anything_runs(case, message, tmp_path):
    config = replace(CONFIG, cases=[PlanCase(LOOP, "straight"), case])
    with pytest.raises(ValueError, match=message):
        make_plans(config, {}, StageContext(tmp_path))
    assert not list(tmp_path.iterdir())


def rows(folder, *searches):
    """searches.csv of (goal, start, seed, branches, solved, confirmed)."""
    folder.mkdir()
    told = [
        {
            "plan": f"{number:02d}-000", "start": start, "seed": seed, "branches": branches,
            "solved": solved, "seconds": 0.1 * branches, "goal": goal, "nodes": 2, "path": "",
            "knot_type": "", "confirmed": confirmed, "reason": "",
        }
        for number, (goal, start, seed, branches, solved, confirmed) in enumerate(searches)
    ]  # fmt: skip
    pd.DataFrame(told).to_csv(folder / "searches.csv", index=False)
    return folder


def test_searches_of_several_methods_make_one_table(planned, tmp_path):
    config = plans_tables.PlansTableConfig("method")
    inputs = {"icp": planned, "reinforcement": planned}
    plans_tables.tabulate(config, inputs, StageContext(tmp_path))
    table = pd.read_csv(tmp_path / "branches.csv")
    assert list(table.columns[:6]) == [
        *("method", "start", "seed", "branches", "solved", "seconds"),
    ]
    assert table["method"].unique().tolist() == ["icp", "reinforcement"]
    # Where all branches went, by the state they began in and the action they were for.
    tried = pd.read_csv(tmp_path / "tried.csv")
    spent, expected = (one.groupby(["method", "start"])["branches"].sum() for one in (tried, table))
    assert spent.equals(expected)
    assert set(tried["action"]) >= {LOOP}
    assert tried.query(f"action == {LOOP!r}")["successes"].sum() >= table["solved"].sum()


def test_success_counts_what_was_tied_and_confirmed(tmp_path):
    folder = rows(
        tmp_path / "plans",
        ("figure_eight", "random", 0, 10, True, "yes"),
        ("figure_eight", "random", 1, 30, True, "not checked"),
        ("figure_eight", "random", 2, 99, False, ""),
        ("overhand", "random", 0, 99, False, ""),
    )
    config = plans_tables.PlansSuccessConfig()
    plans_tables.count(config, {"plans": folder}, StageContext(tmp_path))
    eight, overhand_ = pd.read_csv(tmp_path / "knots.csv").to_dict("records")
    assert (eight["searches"], eight["tied"], eight["confirmed"]) == (3, 2, 1)
    assert eight["branches_median"] == 20
    assert eight["ci_low"] < 2 / 3 < eight["ci_high"]
    assert overhand_["tied"] == 0
    assert np.isnan(overhand_["branches_median"])


def test_the_exemplar_is_the_plan_of_fewest_branches(planned, tmp_path):
    show(PlansExemplarConfig(SIMULATION, AIMED), {"plans": planned}, StageContext(tmp_path, "ab"))
    table = read_searches(planned / "searches.csv")
    fewest = table[table["solved"]].sort_values("branches", kind="stable").iloc[0]
    shown = KnotPlan.from_json((tmp_path / "plan" / "plan.json").read_text())
    chosen = plan_of(planned, fewest["plan"])
    np.testing.assert_array_equal(shown.splines, chosen.splines)
    # The same physics again: the rope in the animation ends where the search said.
    np.testing.assert_allclose(shown.steps[0].trajectory[-1], chosen.shapes[-1], atol=1e-5)
    assert np.diff(shown.steps[0].times).max() == pytest.approx(0.1)
    (rollout,) = load(tmp_path / "plan", trajectories=True).itertuples()
    assert rollout.outcome == "success"
    assert np.diff(rollout.times).max() == pytest.approx(0.02)
    assert {path.name for path in (tmp_path / "plan").iterdir()} == {
        *("plan.json", "plan.png", "plan.svg", "plan.gif", "plan.mcap"),
        *("waypoints.csv", "dag.png", "dag.svg", "outcome.json"),
    }


def test_a_large_dag_is_drawn_as_one_path(planned, monkeypatch):
    table = read_searches(planned / "searches.csv")
    plan = plan_of(planned, table[table["solved"]]["plan"].iloc[0])
    failed = replace(
        plan, solved=False, steps=(), goal_states=(TopologicalState.parse("1o4+2o3-"),)
    )
    full = plan_folder.drawn_dag(failed)
    assert len(full) == len(SolutionDag.to(*failed.goal_states))
    monkeypatch.setattr(plan_folder, "MAX_DRAWN_STATES", 1)
    assert len(plan_folder.drawn_dag(plan)) == 2
    one = plan_folder.drawn_dag(failed)
    assert len(one) <= len(full)
    assert all(len(one.edges_from(state)) <= 1 for state in one.graph)


def test_of_a_plan_that_takes_crossings_back_its_own_way_is_drawn(planned):
    table = read_searches(planned / "searches.csv")
    plan = plan_of(planned, table[table["solved"]]["plan"].iloc[0])
    (tie,) = plan.steps
    undo = replace(
        tie, action=Undo(tie.action), start_state=tie.end_state, end_state=tie.start_state
    )
    twice = replace(plan, steps=(tie, undo, tie))
    drawn = plan_folder.drawn_dag(twice)
    assert set(drawn.graph) == set(twice.states)
    assert [str(action) for action, _ in drawn.edges_from(tie.end_state)] == [f"undo {LOOP}"]


def test_what_is_drawn_of_a_rope_outside_the_dag(planned):
    table = read_searches(planned / "searches.csv")
    plan = plan_of(planned, table[table["solved"]]["plan"].iloc[0])
    goal, stray = plan.states[-1], TopologicalState.parse("1o4+2o3-")
    failed = replace(plan, solved=False, steps=(), goal_states=(goal,), start_state=stray)
    drawn = plan_folder.drawn_dag(failed)
    assert stray in drawn
    assert drawn.goals == {goal}


def test_the_steps_of_plans_are_simulated_again(planned, tmp_path):
    config = plans_checks.PlansChecksConfig(SIMULATION)
    plans_checks.check(config, {"loops": planned}, StageContext(tmp_path))
    table = pd.read_csv(tmp_path / "checks.csv")
    solved = read_searches(planned / "searches.csv").query("solved")
    assert len(table) == sum(len(plan_of(planned, name).steps) for name in solved["plan"])
    assert table["reproduced"].all()
    assert set(table["searches"]) == {"loops"}


def test_a_head_is_pulled_out_and_the_knot_stays(tmp_path):
    loop = {"path": LOOP, "onward": "C(0,1,1)", "guesses": 4, "knots": 3}
    config = PlansPullConfig(simulation=SIMULATION, head=0.2, pulls=6, rounds=4, **loop)
    make_pulled(config, {}, StageContext(tmp_path, "0123456789abcdef"))
    points = np.load(tmp_path / "start.npy")
    assert str(TopologicalState.from_curve(points)) == "2o1+"
    assert segment_intervals(points)[0, 1] >= 0.2
    np.testing.assert_allclose(pd.read_csv(tmp_path / "start.csv").to_numpy(), points)
    rollouts = load(tmp_path / "recordings")
    assert rollouts["number"].is_unique
    tied = rollouts[rollouts["action"] == LOOP]
    assert (tied["outcome"] == "success").any()
    pulls = rollouts[rollouts["source"] == PULL]
    assert (pulls["goal_state"] == "2o1+").all()
    assert (pulls["action"] == "arrange for C(0,1,1)").all()
    assert (rollouts["action"] == "C(0,1,1)").sum() in {4, 8, 12}


def test_a_head_that_is_longer_than_the_rope_is_not_to_be_had(tmp_path):
    few = {"onward": "C(0,1,1)", "pulls": 1, "rounds": 1, "knots": 1}
    config = PlansPullConfig(simulation=SIMULATION, path=LOOP, head=2.0, **few)
    with pytest.raises(RuntimeError, match="no head could be pulled out to 2 m in 1 knots"):
        make_pulled(config, {}, StageContext(tmp_path))


def test_the_dag_of_a_path_is_drawn(tmp_path):
    picture(PlansDagConfig(), {}, StageContext(tmp_path))
    assert "R1(0,1,1)" in (tmp_path / "dag.svg").read_text()
    assert (tmp_path / "dag.png").read_bytes().startswith(b"\x89PNG")


ONE = overhand.OverhandConfig(
    simulation=SIMULATION, planner=SEARCH, knot=LOOP, rope="straight", seed=0, sampler="aimed"
)


def rope_file(tmp_path, points):
    path = tmp_path / "rope.csv"
    np.savetxt(path, points, delimiter=",")
    return str(path)


def test_a_search_that_gets_nowhere_leaves_what_it_tried(tmp_path):
    config = replace(ONE, knot="overhand", planner=PlannerConfig(max_branches=1), seed=1)
    overhand.plan_one(config, {}, StageContext(tmp_path, "0123456789abcdef"))
    outcome = json.loads((tmp_path / "plan" / "outcome.json").read_text())
    assert not outcome["success"]
    assert "NOT tied (1 branches were simulated without reaching the goal)" in outcome["text"]
    assert pd.read_csv(tmp_path / "branches.csv")["solved"].tolist() == [False]
    (rollout,) = load(tmp_path / "plan").itertuples()
    plan = KnotPlan.from_json((tmp_path / "plan" / "plan.json").read_text())
    assert rollout.action in {str(tried.action) for tried in plan.tried}
    assert rollout.outcome == ("success" if plan.steps else "failure")
    for name in ("plan.png", "plan.gif", "waypoints.csv", "dag.svg"):
        assert (tmp_path / "plan" / name).stat().st_size > 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"knot": "granny"}, "unknown knot 'granny'"),
        ({"rope": "nowhere.csv"}, "no such rope file"),
        ({"rope": "spiral"}, "unknown rope 'spiral'"),
        ({"sampler": "wishes"}, "unknown sampler 'wishes'"),
        ({"sampler": "primitives", "primitives": "nowhere"}, "no library of primitives at nowhere"),
        ({"knot": "unknot"}, "there is nothing to plan"),
        ({"planner": PlannerConfig(max_seconds=1e-9)}, "no spline was simulated"),
    ],
)
def test_what_cannot_be_planned_is_refused(change, message, tmp_path):
    with pytest.raises((ValueError, OSError), match=message):
        overhand.plan_one(replace(ONE, **change), {}, StageContext(tmp_path))
    assert not list(tmp_path.iterdir())


def test_a_measured_rope_is_planned_from_where_it_lies(tmp_path):
    points = np.zeros((30, 3))
    points[:, 1] = np.linspace(0.45, -0.55, 30)
    config = replace(ONE, rope=rope_file(tmp_path, points))
    overhand.plan_one(config, {}, StageContext(tmp_path / "out"))
    plan = KnotPlan.from_json((tmp_path / "out" / "plan" / "plan.json").read_text())
    np.testing.assert_allclose(plan.start[[0, -1], 1], [0.45, -0.55], atol=1e-6)
    assert pd.read_csv(tmp_path / "out" / "branches.csv")["start"].tolist() == ["rope.csv"]
