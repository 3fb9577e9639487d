"""The stages of Causal InfoGAN, called by hand on a few simulated rollouts."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from knotflow.recording import load
from knotflow.samplers.causal_infogan import CausalInfoGanConfig
from knotflow.samplers.demonstrations import aim, task
from knotflow.simulation import RopeSimulator, SimulationConfig, arc, attempt, straight
from knotflow.topology import TopologicalState
from knotflow.training.trainer import CHECKPOINT
from knotflow.workflow import StageContext
from knotflow.workflow.stages import causal_infogan as training
from knotflow.workflow.stages import causal_infogan_ends as ending
from knotflow.workflow.stages import causal_infogan_plans as planning
from knotflow.workflow.stages.recorder import Recorder

pytestmark = pytest.mark.slow

R2 = "R2(0,0,1,1)"  # aimed guesses succeed often, and its starts need no simulation
NETWORK = CausalInfoGanConfig(
    width=8, batch=8, steps=4, check_every=2, prior_samples=8, restarts=2, projection_steps=2,
    candidates=2, plan_steps=3,
)  # fmt: skip


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory):
    """As a stage `demonstrations` leaves it: one demonstration of each of two ropes."""
    context = StageContext(tmp_path_factory.mktemp("demonstrations"), "0123456789abcdef")
    config, rng = SimulationConfig(threads=2), np.random.default_rng(0)
    simulator, action = RopeSimulator(config), task(R2).action
    for number, points in enumerate((straight(config.rope), arc(config.rope, 1.0))):
        recorder = Recorder(context, "scripted", config.rope, 16 * number)
        recorder.extra = {"start": str(number)}
        splines = aim(points, action, 16, rng)
        attempt(simulator, points, splines, action, TopologicalState.trivial(), recorder)
        recorder.save(f"recordings/{number}.mcap")
    return context.out


@pytest.fixture(scope="module")
def trained(demonstrations, tmp_path_factory):
    out = tmp_path_factory.mktemp("trained")
    config = training.CausalInfoGanStageConfig(NETWORK, [R2], seeds=2)
    training.train(config, {"demonstrations": demonstrations}, StageContext(out))
    return out


@pytest.fixture(scope="module")
def ends(tmp_path_factory):
    """As a stage `causal_infogan_ends` leaves it, for one goal only."""
    starts = tmp_path_factory.mktemp("starts")
    shapes = np.stack([straight(SimulationConfig().rope), arc(SimulationConfig().rope, -1.0)])
    np.savez_compressed(starts / f"{task(R2).name}.npz", points=shapes)
    out = tmp_path_factory.mktemp("ends")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ending, "GOALS", [goal for goal in ending.GOALS if goal.name == R2])
        config = ending.CausalInfoGanEndsConfig(starts_other=2)
        ending.seek(config, {"starts": starts}, StageContext(out, "0123456789abcdef"))
    return out


def goal_of(name):
    return next(goal for goal in ending.GOALS if goal.name == name)


def test_only_successful_rollouts_are_learned_from(demonstrations):
    index = load(demonstrations / "recordings")
    hits = index[index["outcome"] == "success"]
    rollouts = training.load_rollouts(demonstrations, [R2], 5.0)
    assert 0 < len(rollouts.shapes) == len(hits) < len(index)
    assert rollouts.shapes.shape[1:] == (13, 41, 3)
    assert sorted(rollouts.starts) == sorted(int(extra["start"]) for extra in hits["extra"])
    assert len(training.load_rollouts(demonstrations, [R2], 5.0, most=2).shapes) == 2
    with pytest.raises(ValueError, match=r"no rollout of C\(0,1,1\)"):
        training.load_rollouts(demonstrations, ["C(0,1,1)"], 5.0)


def test_training_leaves_models_curves_and_verdicts(trained):
    curves = pd.read_csv(trained / "training.csv", keep_default_na=False)
    assert curves[["seed", "step"]].to_numpy().tolist() == [[0, 2], [0, 4], [1, 2], [1, 4]]
    assert {"discriminator_loss", "spread", "code_used", "collapsed"} <= set(curves.columns)
    seeds = pd.read_csv(trained / "seeds.csv", keep_default_na=False)
    assert seeds["step"].tolist() == [4, 4]
    assert sorted(path.name for path in (trained / "models").iterdir()) == ["0.pt", "1.pt"]
    assert not list(trained.rglob(CHECKPOINT))


def test_interrupted_training_ends_the_same(
    trained, demonstrations, tmp_path, interrupted_training
):
    config = training.CausalInfoGanStageConfig(NETWORK, [R2], seeds=2)
    inputs = {"demonstrations": demonstrations}
    with interrupted_training(1):
        training.train(config, inputs, StageContext(tmp_path))
    assert len([*tmp_path.rglob(CHECKPOINT)]) == 1
    training.train(config, inputs, StageContext(tmp_path))
    for name in ("training.csv", "seeds.csv"):
        assert (tmp_path / name).read_bytes() == (trained / name).read_bytes()
    one, other = (
        torch.load(folder / "models" / "1.pt", weights_only=True)["weights"]
        for folder in (trained, tmp_path)
    )
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_end_shapes_are_in_the_goal_state_and_their_rollouts_recorded(ends):
    number, starts, shapes = ending.load_ends(ends, goal_of(R2))
    assert len(number) == len(starts) == len(shapes) > 0
    goal_state = task(R2).goal_state
    assert {TopologicalState.from_curve(points) for points in shapes} == {goal_state}
    rollouts = load(ends / "recordings", trajectories=True)
    assert rollouts["number"].is_unique
    recorded = [row.points[-1] for row in rollouts.itertuples() if row.outcome == "success"]
    for shape in shapes:
        assert min(np.abs(shape - one).max() for one in recorded) < 1e-6
    assert pd.read_csv(ends / "ends.csv").to_numpy().tolist() == [[R2, 2, len(number)]]


@pytest.fixture(scope="module")
def planned(demonstrations, trained, ends, tmp_path_factory):
    out, icp = tmp_path_factory.mktemp("planned"), tmp_path_factory.mktemp("icp")
    rows = [(R2, 0, 1), (R2, 0, 0), (R2, 7, 1), ("C(0,1,1)", 0, 1)]
    pd.DataFrame(rows, columns=["action", "start", "success"]).to_csv(
        icp / "outcomes.csv", index=False
    )
    inputs = {"demonstrations": demonstrations, "ends": ends, "single": trained, "icp": icp}
    config = planning.CausalInfoGanPlansConfig(models=["single"], training_rows=4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "GOALS", [goal_of(R2)])
        patch.setattr(planning, "FOCUS", R2)
        planning.plan(config, inputs, StageContext(out))
    return out


def test_every_plan_is_measured(planned, ends):
    plans = pd.read_csv(planned / "plans.csv")
    unseen = len(ending.load_ends(ends, goal_of(R2))[0])
    assert list(plans.columns[:3]) == ["model", "seed", "goal"]
    assert plans.groupby(["seed", "shapes"]).size().to_dict() == {
        (seed, shapes): count
        for seed in (0, 1)
        for shapes, count in (("training", 4), ("unseen", unseen))
    }
    assert (plans[["start_distance", "end_distance", "unevenness"]] > 0).all(axis=None)
    assert (plans["largest_stretch"] < 1e-4).all()


def test_methods_are_compared_on_the_starts_that_have_an_end(planned, ends):
    table = pd.read_csv(planned / "comparison.csv").set_index("method")
    assert list(table.index) == ["causal_infogan_single", "icp"]
    unseen = len(ending.load_ends(ends, goal_of(R2))[0])
    assert table.loc["causal_infogan_single", "trials"] == 2 * unseen
    assert table.loc["icp", ["trials", "successes"]].tolist() == [2, 1]
    assert (table["ci_low"] <= table["success_rate"]).all()


def test_the_panel_runs_from_given_to_given(planned, ends):
    panel = pd.read_csv(planned / "panel.csv")
    roles = panel.drop_duplicates("column").sort_values("column")["role"].tolist()
    assert roles[:2] == ["given start", "projected start"] and set(roles[2:-2]) == {"way point"}
    assert roles[-2:] == ["projected end", "given end"]
    row = panel[(panel["shapes"] == "unseen") & (panel["column"] == 0)]
    number, starts, _ = ending.load_ends(ends, goal_of(R2))
    first = row[row["start"] == number[0]]
    assert np.allclose(first[["x", "y", "z"]], starts[0], atol=1e-4)


def test_numbers_of_the_committed_tables_do_not_depend_on_the_folder(planned):
    assert not [path for path in Path(planned).glob("*.csv") if "tmp" in path.read_text()]
