"""The stage in which a network learns to follow strands."""

import numpy as np
import pandas as pd
import pytest
import torch

from knotflow.perception import Network, NetworkError, StrandNetworkConfig, StrandTrainingConfig
from knotflow.perception.coarse_to_fine import CoarseToFine
from knotflow.training.trainer import CHECKPOINT
from knotflow.workflow import StageContext
from knotflow.workflow.stages.perception_training import FILE
from knotflow.workflow.stages.strand_training import StrandTrainingStageConfig, train_strands

from .test_stage_perception_training import TINY, ropes

__all__ = ["ropes"]

EFFORT = StrandTrainingConfig(
    network=StrandNetworkConfig(channels=(4, 8, 8), width=16), validations=3, steps=1, batch=2
)


def config(whole: str) -> StrandTrainingStageConfig:
    return StrandTrainingStageConfig(whole=whole, whole_contents="", training=EFFORT, seed=0)


def test_an_interrupted_training_ends_the_same_beside_the_network_it_was_given(
    ropes, tmp_path, interrupted_training
):
    given = Network(CoarseToFine(TINY))
    given.save(tmp_path / "given.safetensors")
    asked, inputs = config(str(tmp_path / "given.safetensors")), {"ropes": ropes}
    train_strands(asked, inputs, StageContext(tmp_path / "whole"))
    with interrupted_training(1):
        train_strands(asked, inputs, StageContext(tmp_path / "broken"))
    assert (tmp_path / "broken" / CHECKPOINT).exists()
    train_strands(asked, inputs, StageContext(tmp_path / "broken"))
    whole, broken = (pd.read_csv(tmp_path / name / "curves.csv") for name in ("whole", "broken"))
    pd.testing.assert_frame_equal(whole, broken)
    assert np.isfinite(whole.to_numpy()).all() and len(whole) == 3
    one, other = (Network.load(tmp_path / name / FILE) for name in ("whole", "broken"))
    for networks in ((one.strands, other.strands), (one.model, other.model)):
        first, second = (network.state_dict() for network in networks)
        assert all(torch.equal(weights, second[name]) for name, weights in first.items())
    before = Network.load(tmp_path / "given.safetensors").model.state_dict()
    assert all(
        torch.equal(weights, before[name]) for name, weights in one.model.state_dict().items()
    )


def test_a_network_is_needed_beside_which_it_learns(ropes, tmp_path):
    with pytest.raises(NetworkError, match=r"none\.safetensors"):
        train_strands(config("none.safetensors"), {"ropes": ropes}, StageContext(tmp_path / "out"))
