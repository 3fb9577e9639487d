"""The stages in which dynamics are learned and judged, on a few motions."""

import numpy as np
import pandas as pd
import pytest
import torch

from knotflow.execution import (
    DynamicsTrainingConfig,
    LstmConfig,
    LstmDynamics,
    Motions,
)
from knotflow.execution.control.dynamics import SHIPPED_DYNAMICS
from knotflow.simulation import SimulationConfig
from knotflow.training.trainer import CHECKPOINT
from knotflow.workflow import StageContext
from knotflow.workflow.stages.dynamics import DynamicsConfig, measure
from knotflow.workflow.stages.dynamics_training import (
    FILE,
    DynamicsTrainingStageConfig,
    train_dynamics,
)
from knotflow.workflow.stages.motions import FILE as MOTIONS
from knotflow.workflow.stages.motions import MotionsConfig, make_motions

SIMULATION = SimulationConfig(threads=1)
TRAINING = DynamicsTrainingStageConfig(
    training=DynamicsTrainingConfig(
        network=LstmConfig(hidden=8), validations=3, steps=2, batch=2, horizon=2
    ),
    seed=0,
)


@pytest.fixture(scope="module")
def motions(tmp_path_factory):
    """A folder with motions of three ropes, one of each level."""
    folder = tmp_path_factory.mktemp("motions")
    config = MotionsConfig(simulation=SIMULATION, digest="shipped", ropes=3, per_rope=2, seed=0)
    make_motions(config, {}, StageContext(folder))
    return folder


def test_ropes_of_every_level_are_moved(motions):
    made = Motions.load(motions / MOTIONS)
    assert made.level.tolist() == [0, 0, 1, 1, 2, 2]
    assert made.points.shape == (6, 26, 41, 3) and np.isfinite(made.points).all()
    assert [path.name for path in motions.iterdir()] == [MOTIONS]


def test_errors_of_every_model_and_level(motions, tmp_path):
    config = DynamicsConfig(
        simulation=SIMULATION, weights=str(SHIPPED_DYNAMICS), weights_contents="shipped"
    )
    measure(config, {"motions": motions}, StageContext(tmp_path))
    table = pd.read_csv(tmp_path / "errors.csv")
    assert len(table) == 3 * 3 * 3
    assert not table.duplicated(["model", "level", "steps"]).any()
    assert (table["motions"] == 2).all() and (table["mean_error_mm"] > 0).all()


def test_an_interrupted_training_ends_the_same(motions, tmp_path, interrupted_training):
    inputs = {"motions": motions}
    train_dynamics(TRAINING, inputs, StageContext(tmp_path / "whole"))
    with interrupted_training(1):
        train_dynamics(TRAINING, inputs, StageContext(tmp_path / "broken"))
    assert (tmp_path / "broken" / CHECKPOINT).exists()
    train_dynamics(TRAINING, inputs, StageContext(tmp_path / "broken"))
    whole, broken = (pd.read_csv(tmp_path / name / "curves.csv") for name in ("whole", "broken"))
    pd.testing.assert_frame_equal(whole, broken)
    assert whole["step"].tolist() == [2, 4, 6]
    assert not (tmp_path / "broken" / CHECKPOINT).exists()
    one, other = (
        LstmDynamics.load(tmp_path / name / FILE).state_dict() for name in ("whole", "broken")
    )
    assert all(torch.equal(weights, other[name]) for name, weights in one.items())
