"""Training of Causal InfoGAN."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.samplers.causal_infogan.data import CausalInfoGanConfig
from knotflow.simulation import RopeConfig, arc
from knotflow.threads import one_thread
from knotflow.training.causal_infogan import CausalInfoGanTrainer

ROPE = RopeConfig(links=20)
SMALL = CausalInfoGanConfig(width=16, batch=16, steps=5, check_every=2)
STARTS = np.arange(24) // 6


@pytest.fixture(scope="module", autouse=True)
def single_thread():
    """Networks this small are slower on more."""
    with one_thread():
        yield


@pytest.fixture(scope="module")
def shapes():
    """(24, 4, V, 3): arcs that close slowly; 24 rollouts from four kinds of start."""
    bends = np.repeat(np.linspace(0.5, 3.0, 4), 6) + np.linspace(0, 0.1, 24)
    return np.array([[arc(ROPE, bend + 0.2 * step) for step in range(4)] for bend in bends])


def weights(trainer):
    return torch.cat([one.flatten() for one in trainer.model.parameters()])


def test_equal_seeds_give_equal_models_and_others_do_not(shapes):
    trainers = [CausalInfoGanTrainer(shapes, STARTS, SMALL, seed) for seed in (1, 1, 2)]
    for one in trainers:
        next(iter(one))
    first, again, other = map(weights, trainers)
    assert torch.equal(first, again)
    assert not torch.allclose(first, other)


def test_training_leaves_the_global_generator_alone(shapes):
    torch.manual_seed(5)
    before = torch.random.get_rng_state()
    next(iter(CausalInfoGanTrainer(shapes, STARTS, SMALL, 1)))
    assert torch.equal(torch.random.get_rng_state(), before)


def test_resumed_training_ends_the_same(shapes, tmp_path):
    whole = CausalInfoGanTrainer(shapes, STARTS, SMALL, 4)
    assert [metrics["step"] for metrics in whole] == [2, 4, 5]
    first = CausalInfoGanTrainer(shapes, STARTS, SMALL, 4)
    next(iter(first))
    first.save(tmp_path / "checkpoint.pt")
    second = CausalInfoGanTrainer(shapes, STARTS, SMALL, 4)
    second.load(tmp_path / "checkpoint.pt")
    list(second)
    assert second.history == whole.history
    assert torch.equal(weights(second), weights(whole))


@pytest.mark.slow
def test_training_moves_the_shapes_toward_the_data(shapes):
    trainer = CausalInfoGanTrainer(shapes, STARTS, replace(SMALL, steps=60, check_every=30), 1)
    before = trainer.validate()
    *_, after = trainer
    assert after["distance_to_data"] < before["distance_to_data"]
