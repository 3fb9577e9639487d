"""The stage that tries each action of a path from what the one before left."""

from collections import Counter

import numpy as np
import pandas as pd
import pytest

from knotflow.recording import load
from knotflow.samplers.sampler import SamplerConfig
from knotflow.simulation import SimulationConfig
from knotflow.topology import TopologicalState
from knotflow.workflow import StageContext
from knotflow.workflow.stages.path_steps import SHAPES, SHOWN, STEPS, PathStepsConfig, try_steps

pytestmark = pytest.mark.slow

PATH = ["R1(0,1,1)", "C(0,1,1)"]


def config(**changed):
    settings = {"path": " ".join(PATH), "ropes": ["straight", "arc"], "shapes": 4, "splines": 6}
    settings |= {"seed": 3, "sampler": SamplerConfig("aimed")}
    return PathStepsConfig(simulation=SimulationConfig(threads=1), **settings | changed)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("steps")
    try_steps(config(), {}, StageContext(out))
    return out


def test_a_row_a_rope_of_each_action_as_recorded(made):
    steps, rollouts = pd.read_csv(made / STEPS), load(made / "recordings")
    assert (steps["splines"] == 6).all() and len(rollouts) == steps["splines"].sum()
    assert list(steps["start"].unique()) == ["straight", "arc"]
    for _, own in steps.groupby("start"):
        assert list(own["action"].unique()) == PATH
        assert own["action"].value_counts()[PATH[0]] == 4
    hits = Counter(rollouts[rollouts["outcome"] == "success"]["action"])
    counted = steps.groupby("action")["successes"].sum()
    assert {action: hits[action] for action in PATH} == counted.to_dict()


def test_an_action_begins_with_what_the_one_before_left(made):
    shapes = pd.read_csv(made / SHAPES)
    ends = load(made / "recordings", trajectories=True)
    left = [row.points[-1] for row in ends.itertuples() if row.outcome == "success"]
    for (_, action, _), rope in shapes.groupby(["start", "action", "shape"]):
        points = rope[["x", "y", "z"]].to_numpy()
        state = TopologicalState.from_curve(points)
        assert state.num_crossings == PATH.index(action)
        if action == PATH[1]:
            assert min(np.abs(points - one).max() for one in left) < 6e-4
    assert shapes["shape"].max() == SHOWN - 1


def test_it_ends_with_the_action_that_never_succeeds(tmp_path):
    never = config(ropes=["straight"], shapes=1, splines=1, sampler=SamplerConfig("random"), seed=0)
    try_steps(never, {}, StageContext(tmp_path))
    (row,) = pd.read_csv(tmp_path / STEPS).itertuples()
    assert (row.action, row.successes) == (PATH[0], 0)


def test_a_path_that_is_none_is_refused_before_anything_is_simulated(tmp_path):
    with pytest.raises(ValueError, match="C\\(5,0,1\\)"):
        try_steps(config(path="R1(0,1,1) C(5,0,1)"), {}, StageContext(tmp_path))
    assert not list(tmp_path.iterdir())
