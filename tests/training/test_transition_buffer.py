"""The replay buffer of steps that others follow."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from knotflow.primitives import Primitive, PrimitiveLibrary, encode
from knotflow.simulation import RopeConfig
from knotflow.topology import parse_action
from knotflow.training.buffer import TransitionBuffer, TrialBuffer, mixed
from knotflow.training.values import best_values

ACTION = parse_action("R1(0,1,1)")


@pytest.fixture
def states(curves):
    return encode(curves, [ACTION] * len(curves)).states


@pytest.fixture
def buffer(states):
    made = TransitionBuffer(10, torch.Generator().manual_seed(0))
    splines = torch.arange(6.0)[:, None].expand(6, 6)
    rewards = torch.tensor([1.0, 0, 0, 0, 0, 0])
    leads_to = torch.tensor([-1, -1, 1, 1, 2, 2])
    made.add(states, splines, rewards, states.flip(0), leads_to)
    return made


def by_item(batch):
    """Next values and baselines in the order in which items were added."""
    order = batch["spline"][:, 0].argsort()
    return batch["next_value"][order], batch["baseline"][order]


def test_next_values_are_those_of_the_last_refresh(buffer, states):
    assert by_item(buffer.sample(6, 1))[0].tolist() == [0] * 6
    asked = {}

    def value(step, some):
        asked[step] = some["streams"]
        return torch.tensor([0.1, 0.2]) * step

    means = buffer.refresh(value)
    assert means == pytest.approx({1: 0.15, 2: 0.3})
    # Steps are asked about the ropes that they begin with, not those the trials were made on.
    torch.testing.assert_close(asked[1], states["streams"][[3, 2]])
    torch.testing.assert_close(asked[2], states["streams"][[1, 0]])
    values, baselines = by_item(buffer.sample(6, 1))
    torch.testing.assert_close(values, torch.tensor([0, 0, 0.1, 0.2, 0.2, 0.4]))
    torch.testing.assert_close(baselines, torch.tensor([1, 0, 0.1, 0.2, 0.2, 0.4]))
    assert len(buffer.sample(3, 1)["next_value"]) == 3
    other = TransitionBuffer(10, torch.Generator().manual_seed(0))
    other.load_state_dict(buffer.state_dict())
    torch.testing.assert_close(by_item(other.sample(6, 1))[0], values)


def test_single_step_trials_mixed_in_are_followed_by_nothing(buffer, states):
    buffer.refresh(lambda step, some: torch.full((len(some),), 0.5))
    single = TrialBuffer(2, 1, torch.Generator().manual_seed(0))
    single.extend(states[:2], [torch.zeros(1, 6)] * 2, [torch.ones(1), torch.zeros(1)])
    both = mixed([single.sample(2, 1), buffer.sample(6, 1)], [0.5, 0.5])
    assert both["next_value"][:2].tolist() == [0, 0]
    assert both["next_value"].sum() == 2
    alone = mixed([single.sample(2, 1)], [1.0])
    assert "next_value" not in alone.keys()  # noqa: SIM118  a TensorDict


def test_values_are_those_of_the_library(primitive_config, curves, states):
    torch.manual_seed(3)
    primitive = Primitive(primitive_config).eval()
    library = PrimitiveLibrary({1: primitive}, {1: [ACTION]}, RopeConfig())
    expected = library.values(curves, [ACTION] * len(curves), np.random.default_rng(1))
    population = primitive_config.cem.population
    found = best_values(primitive, states, population, np.random.default_rng(1))
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)
    assert best_values(primitive, states[:0], population, np.random.default_rng(1)).shape == (0,)
