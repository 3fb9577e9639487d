"""Training of the strand network."""

import numpy as np
import pytest
import torch

from knotflow.perception.networks.training import StrandTrainer, StrandTrainingConfig
from knotflow.perception.networks.windows import find_crossings
from knotflow.topology import TopologicalState

from .shapes import ROPE, loop, s_curve
from .test_network import TINY

SHAPES = np.stack([s_curve(), loop(1), loop(-1)] * 4)
CROSSINGS = np.array([0, 1, 1] * 4)
RADII = ROPE.radius * np.linspace(0.5, 1.5, 12)


def training(seed: int = 0) -> StrandTrainer:
    config = StrandTrainingConfig(network=TINY, validations=3, steps=2, batch=4)
    return StrandTrainer(SHAPES, CROSSINGS, RADII, config, seed)


def test_resumed_training_is_identical(tmp_path):
    whole, broken, resumed = training(), training(), training()
    metrics = list(whole)
    next(iter(broken))
    broken.save(tmp_path / "checkpoint.pt")
    resumed.load(tmp_path / "checkpoint.pt")
    list(resumed)
    assert resumed.history == metrics
    for name, one in whole.model.state_dict().items():
        assert torch.equal(one, resumed.model.state_dict()[name]), name


def test_seed_changes_training():
    assert next(iter(training(0))) != next(iter(training(1)))


def test_one_shape_is_too_few():
    with pytest.raises(ValueError, match="two or more"):
        StrandTrainer(SHAPES[:1], CROSSINGS[:1], RADII[:1], StrandTrainingConfig(network=TINY), 0)


@pytest.mark.parametrize("over", [1, -1])
def test_find_crossings_matches_state(over):
    points = loop(over)
    rope, above, below = find_crossings(torch.as_tensor(points)[None])
    ((first, second, _),) = TopologicalState.from_curve(points).crossings
    assert rope.tolist() == [0]
    assert (above < below).item() == (first < second)


def test_no_crossings():
    assert len(find_crossings(torch.as_tensor(s_curve())[None])[0]) == 0
