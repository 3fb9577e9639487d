from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives import encode
from knotflow.training import Imitation, ImitationConfig, LearnerConfig
from knotflow.training.config import AugmentationConfig

CONFIG = ImitationConfig(
    LearnerConfig(learning_rate=5e-3, augmentation=AugmentationConfig(0.0, 0.0)),
    steps=10,
    validations=6,
)


def weights(training):
    return torch.cat([value.flatten() for value in training.primitive.state_dict().values()])


@pytest.mark.slow
def test_imitation_learns_what_makes_trials_succeed(primitive_config, trials, curves):
    training = Imitation([trials], primitive_config, replace(CONFIG, validations=12), 0)
    metrics = list(training)
    assert metrics[-1]["loss_critic"] < 0.6 * metrics[0]["loss_critic"]
    seen = encode(curves, [one.action for one in trials])
    found, _ = training.primitive.search(seen, 8, np.random.default_rng(1))
    rate = (found[..., 5] > 0.2).float().mean()
    assert rate > 0.8 > np.mean([one.success for one in trials]) + 0.2


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["actor_only", "critic_only"])
def test_a_variant_trains_the_network_it_has(primitive_config, trials, variant):
    training = Imitation([trials], replace(primitive_config, variant=variant), CONFIG, 0)
    name = variant.removesuffix("_only")
    metrics = list(training)
    assert metrics[-1][f"validation_loss_{name}"] < metrics[0][f"validation_loss_{name}"]


@pytest.mark.slow
def test_an_interrupted_training_ends_with_the_same_weights(primitive_config, trials, tmp_path):
    through = Imitation([trials], primitive_config, CONFIG, 3)
    list(through)
    first = Imitation([trials], primitive_config, CONFIG, 3)
    for number, _ in enumerate(first):
        if number == 1:
            first.save(tmp_path / "checkpoint")
            break
    second = Imitation([trials], primitive_config, CONFIG, 3)
    second.load(tmp_path / "checkpoint")
    assert len(list(second)) == CONFIG.validations - 2
    torch.testing.assert_close(weights(second), weights(through), atol=0, rtol=0)
