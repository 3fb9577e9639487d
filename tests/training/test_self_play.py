"""Self-play with networks so small that they learn little; its laws do not depend on that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives import (
    CemConfig,
    NetworkConfig,
    Primitive,
    PrimitiveConfig,
    PrimitiveLibrary,
    encode,
)
from knotflow.samplers.primitives.canonical import ALL_PRIMITIVES, ARRANGE
from knotflow.simulation import Attempts, Rollouts, RopeConfig, SimulationConfig, straight
from knotflow.topology import TopologicalState, parse_action
from knotflow.training import LearnerConfig, SelfPlay, SelfPlayConfig
from knotflow.training.self_play import best_values

NETWORK = NetworkConfig(lstm=8, attention=4, stream=8, feature=16, head=16)
SMALL = PrimitiveConfig("actor_critic", NETWORK, CemConfig(population=16, valued=8, elites=4))
CONFIG = SelfPlayConfig(
    LearnerConfig(rollout_ropes=16, rollout_trials=1),
    rounds=2, ropes=24, steps=1, new_steps=1, successes_per_step=1, critic_reset_steps=1,
    capacity=200, refreshed=8,
)  # fmt: skip


def library():
    torch.manual_seed(0)
    numbers = (1, 2, 3, 4)
    return PrimitiveLibrary(
        {number: Primitive(SMALL) for number in numbers},
        {number: [] for number in numbers},
        SimulationConfig().rope,
    )


def training(simulator, **changes):
    return SelfPlay(library(), {}, [], simulator, replace(CONFIG, **changes), 7)


class Still:
    """A simulator in which nothing ever moves."""

    config = SimulationConfig()

    def execute(self, points, splines):
        return Rollouts.between(points, points.copy())


def weights(some):
    return {
        f"{number}.{name}": value.clone()
        for number, primitive in some.library.primitives.items()
        for name, value in primitive.state_dict().items()
    }


def test_primitives_that_a_library_lacks_are_added():
    found = training(Still())
    assert set(found.library.primitives) == set(ALL_PRIMITIVES)
    given = library().primitives[3].state_dict()
    torch.testing.assert_close(found.library.primitives[3].state_dict(), given)


@pytest.mark.slow
def test_a_rope_that_never_moves_teaches_that_nothing_succeeds_and_its_state_is_kept():
    some = training(Still())
    rounds = list(some)
    assert [one["step"] for one in rounds] == [0, 1]
    pairs = some.curriculum.stats.values()
    assert sum(pair.trials for pair in pairs) > 0
    assert sum(pair.successes for pair in pairs) == 0
    acting, arranging = some.buffers[1], some.buffers[ARRANGE]
    assert acting.sample(1000, 1)["reward"].sum() == 0
    kept = arranging.sample(1000, 1)
    assert (kept["reward"] == 1).all()
    assert not kept["next_value"].isnan().any()  # the wanted action is valued after arranging


@pytest.mark.slow
def test_shapes_are_remembered_in_the_states_they_read_as(simulator):
    some = training(simulator, guess_fraction=1.0, guess_below_value=1.0, ropes=48)
    list(some)
    assert TopologicalState.trivial() in set(some.shapes)
    rng = np.random.default_rng(0)
    for state in some.shapes:
        assert TopologicalState.from_curve(some.shapes.draw(state, rng)) == state


@pytest.mark.slow
def test_interrupted_training_ends_the_same(simulator, tmp_path):
    whole = training(simulator)
    list(whole)
    begun = training(simulator)
    next(iter(begun))
    begun.save(tmp_path / "checkpoint")
    going_on = training(simulator)
    going_on.load(tmp_path / "checkpoint")
    assert len(going_on.history) == 1
    list(going_on)
    torch.testing.assert_close(weights(going_on), weights(whole), atol=0, rtol=0)
    assert going_on.curriculum.stats == whole.curriculum.stats


def test_what_independent_training_collected_is_remembered():
    trivial, rope = TopologicalState.trivial(), straight(SimulationConfig().rope)
    action = parse_action("R1(0,1,1)")
    points, splines = np.stack([rope] * 3), np.full((3, 6), 0.1)
    earlier = Attempts.of(action, trivial, points, splines, Still().execute(points, splines))
    some = SelfPlay(library(), {}, [earlier], Still(), CONFIG, 7)
    assert len(some.buffers[1]) == 3
    assert sum(pair.trials for pair in some.curriculum.stats.values()) == 3


def test_primitives_without_actor_or_critic_are_refused():
    torch.manual_seed(0)
    lacking = PrimitiveLibrary(
        {1: Primitive(replace(SMALL, variant="critic_only"))}, {1: []}, SimulationConfig().rope
    )
    with pytest.raises(ValueError, match="primitive 1 is critic_only"):
        SelfPlay(lacking, {}, [], Still(), CONFIG, 7)


def test_values_are_those_of_the_library(primitive_config, curves):
    action = parse_action("R1(0,1,1)")
    states = encode(curves, [action] * len(curves)).states
    torch.manual_seed(3)
    primitive = Primitive(primitive_config).eval()
    library = PrimitiveLibrary({1: primitive}, {1: [action]}, RopeConfig())
    expected = library.values(curves, [action] * len(curves), np.random.default_rng(1))
    found = best_values(primitive, states, np.random.default_rng(1))
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)
    assert best_values(primitive, states[:0], np.random.default_rng(1)).shape == (0,)
