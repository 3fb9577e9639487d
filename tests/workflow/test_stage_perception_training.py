"""The stages in which perception learns."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from knotflow.perception.network import Network
from knotflow.perception.training_config import CoarseToFineConfig, TrainingConfig
from knotflow.simulation import RopeConfig, random_curve, state_or_none
from knotflow.training.trainer import CHECKPOINT
from knotflow.workflow import StageContext
from knotflow.workflow.stages.perception_training import (
    FILE,
    PerceptionTrainingConfig,
    train_perception,
)
from knotflow.workflow.stages.ropes import FILE as ROPES
from knotflow.workflow.stages.ropes import RopesConfig, make_ropes

TINY = CoarseToFineConfig(size=32, channels=(8, 16, 16), nodes=(5, 9, 41), width=16, layers=1)
CONFIG = PerceptionTrainingConfig(
    training=TrainingConfig(network=TINY, validations=3, steps=1, batch=2), seed=0
)


@pytest.fixture
def ropes(tmp_path: Path) -> Path:
    rng, folder = np.random.default_rng(0), tmp_path / "ropes"
    folder.mkdir()
    points = np.stack([random_curve(RopeConfig(), rng) for _ in range(4)])
    np.savez(folder / ROPES, points=points, crossings=np.zeros(4, int))
    return folder


def test_an_interrupted_training_ends_the_same(ropes, tmp_path, interrupted_training):
    train_perception(CONFIG, {"ropes": ropes}, StageContext(tmp_path / "whole"))
    with interrupted_training(1):
        train_perception(CONFIG, {"ropes": ropes}, StageContext(tmp_path / "broken"))
    assert (tmp_path / "broken" / CHECKPOINT).exists()
    train_perception(CONFIG, {"ropes": ropes}, StageContext(tmp_path / "broken"))
    whole, broken = (pd.read_csv(tmp_path / name / "curves.csv") for name in ("whole", "broken"))
    pd.testing.assert_frame_equal(whole, broken)
    assert len(whole) == 3 and not (tmp_path / "broken" / CHECKPOINT).exists()
    weights = [
        Network.load(tmp_path / name / FILE).model.state_dict() for name in ("whole", "broken")
    ]
    assert all(torch.equal(one, weights[1][name]) for name, one in weights[0].items())


@pytest.mark.slow
def test_ropes_are_left_behind_by_splines(tmp_path):
    make_ropes(RopesConfig(shards=1, rounds=2, seed=0), {}, StageContext(tmp_path))
    ropes = np.load(tmp_path / ROPES)
    assert 32 < len(ropes["points"]) <= 96
    assert len(ropes["points"]) == len(ropes["crossings"])
    assert (ropes["crossings"][:32] == 0).all() and ropes["crossings"].max() > 0
    for points, crossings in zip(ropes["points"][32::8], ropes["crossings"][32::8], strict=True):
        state = state_or_none(points.astype(float))
        assert state is not None and state.num_crossings == crossings
    assert not list(tmp_path.glob("shard-*"))
