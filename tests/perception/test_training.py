"""Training: it can be interrupted, and it learns."""

import numpy as np
import pytest
import torch

from knotflow.perception.networks.examples import ExamplesConfig, draw_patches
from knotflow.perception.networks.models import (
    CoarseToFine,
    CoarseToFineConfig,
    StrandNetworkConfig,
)
from knotflow.perception.networks.training import (
    CoarseToFineTrainer,
    StrandTrainer,
    StrandTrainingConfig,
    TrainingConfig,
    nodes_loss,
    vertex_error,
)

from .shapes import ROPE, loop, s_curve

TINY = CoarseToFineConfig(size=32, channels=(8, 16, 16), nodes=(5, 9, 41), width=16, layers=1)
SHAPES = np.stack([s_curve(), loop(1), loop(-1)] * 4)
CROSSINGS = np.array([0, 1, 1] * 4)


def training(seed: int = 0) -> CoarseToFineTrainer:
    config = TrainingConfig(network=TINY, validations=3, steps=2, batch=4)
    return CoarseToFineTrainer(SHAPES, CROSSINGS, ROPE, config, seed)


def strand_training() -> StrandTrainer:
    network = StrandNetworkConfig(channels=(4, 8, 8), width=16)
    config = StrandTrainingConfig(network=network, validations=3, steps=2, batch=4)
    return StrandTrainer(SHAPES, CROSSINGS, ROPE, config, 0)


@pytest.mark.parametrize("training", [training, strand_training])
def test_a_resumed_training_is_the_uninterrupted_one(training, tmp_path):
    whole, broken, resumed = training(), training(), training()
    metrics = list(whole)
    next(iter(broken))
    broken.save(tmp_path / "checkpoint.pt")
    resumed.load(tmp_path / "checkpoint.pt")
    list(resumed)
    assert resumed.history == metrics
    for name, one in whole.model.state_dict().items():
        assert torch.equal(one, resumed.model.state_dict()[name]), name


def test_another_seed_is_another_training():
    assert next(iter(training(0))) != next(iter(training(1)))


@pytest.mark.slow
def test_the_network_learns_eight_examples_by_heart():
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = CoarseToFine(TINY)
    shapes = torch.as_tensor(SHAPES[:8], dtype=torch.float32)
    generator = torch.Generator().manual_seed(0)
    patches, nodes, _ = draw_patches(shapes, ROPE.radius, TINY.size, ExamplesConfig(), generator)
    optimizer = torch.optim.Adam(model.parameters(), 3e-3)
    before = vertex_error(model(patches)[-1].places, nodes).mean().item()
    for _ in range(200):
        loss = nodes_loss(model(patches), nodes).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert vertex_error(model(patches)[-1].places, nodes).mean().item() < 0.15 * before


@pytest.mark.parametrize("shapes", [SHAPES[:1], SHAPES[:, ::2]], ids=["one", "fewer vertices"])
def test_shapes_that_cannot_be_learned_are_refused(shapes):
    with pytest.raises(ValueError, match="41"):
        CoarseToFineTrainer(shapes, CROSSINGS[: len(shapes)], ROPE, TrainingConfig(network=TINY), 0)
