"""The replay buffer of steps that others follow."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from knotflow.samplers.primitives import Primitive, PrimitiveLibrary, encode
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
    follower = torch.tensor([-1, -1, 1, 1, 2, 2])
    made.extend(
        TensorDict(
            {
                "states": states,
                "following": states.flip(0),
                "follower": follower,
                "spline": torch.arange(6.0)[:, None].expand(6, 6),
                "reward": torch.tensor([1.0, 0, 1, 1, 1, 1]),
                "baseline": torch.zeros(6),
                "weight": torch.ones(6),
                "pull": torch.full((6,), 0.5),
                "next_value": torch.where(follower < 0, torch.nan, 0.0),
            },
            batch_size=[6],
        )
    )
    return made


def next_values(batch):
    """In the order in which trials were added."""
    return batch["next_value"][batch["spline"][:, 0].argsort()]


def test_next_values_are_those_of_the_last_refresh(buffer, states):
    assert next_values(buffer.sample(6, 1))[2:].tolist() == [0] * 4
    asked = {}

    def value(primitive, some):
        asked[primitive] = some["streams"]
        return some["streams"][:, 0, 0] * 0 + 0.1 * primitive

    buffer.refresh(value, 6)
    # Primitives are asked about the ropes that they would begin with, not those tried on.
    expected = {one.tobytes() for one in states["streams"][[3, 2]].numpy()}
    assert {one.tobytes() for one in asked[1].numpy()} == expected
    values = next_values(buffer.sample(6, 1))
    torch.testing.assert_close(values[2:], torch.tensor([0.1, 0.1, 0.2, 0.2]))
    assert values[:2].isnan().all()
    assert len(buffer.sample(3, 1)["next_value"]) == 3
    other = TransitionBuffer(10, torch.Generator().manual_seed(0))
    other.load_state_dict(buffer.state_dict())
    torch.testing.assert_close(next_values(other.sample(6, 1)), values, equal_nan=True)


def test_a_refresh_may_be_of_some_trials_only(buffer):
    buffer.refresh(lambda primitive, some: torch.ones(len(some)), 1)
    assert next_values(buffer.sample(6, 1))[2:].sum() <= 1


def test_the_oldest_trials_give_way(buffer):
    again = buffer._replay[:].clone()
    again["spline"] = again["spline"] + 10
    buffer.extend(again)
    kept = buffer.sample(20, 1)["spline"][:, 0].sort().values
    assert kept.tolist() == [2, 3, 4, 5, 10, 11, 12, 13, 14, 15]


def test_of_demonstrations_mixed_in_nobody_knows_what_follows(buffer, states):
    single = TrialBuffer(2, 1, torch.Generator().manual_seed(0))
    single.extend(states[:2], [torch.zeros(1, 6)] * 2, [torch.ones(1), torch.zeros(1)])
    both = mixed([single.sample(2, 1), buffer.sample(6, 1)], [0.5, 0.5])
    assert both["next_value"][:2].isnan().all()
    assert both["next_value"].isnan().sum() == 4
    assert both["pull"].tolist() == [1.0] * 2 + [0.5] * 6
    alone = mixed([single.sample(2, 1)], [1.0])
    assert "next_value" not in alone.keys()  # noqa: SIM118  a TensorDict


def test_values_are_those_of_the_library(primitive_config, curves, states):
    torch.manual_seed(3)
    primitive = Primitive(primitive_config).eval()
    library = PrimitiveLibrary({1: primitive}, {1: [ACTION]}, RopeConfig())
    expected = library.values(curves, [ACTION] * len(curves), np.random.default_rng(1))
    found = best_values(primitive, states, np.random.default_rng(1))
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)
    assert best_values(primitive, states[:0], np.random.default_rng(1)).shape == (0,)


def test_successes_are_counted(buffer):
    assert buffer.successes == 5
    assert TransitionBuffer(3, torch.Generator()).successes == 0
