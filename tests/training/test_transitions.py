"""What transitions teach."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import torch

from knotflow.samplers.primitives import Primitive, PrimitiveLibrary, encode
from knotflow.samplers.primitives.canonical import ARRANGE, canonicalise
from knotflow.simulation import RopeConfig, SimulationConfig, resample, straight
from knotflow.topology import TopologicalState, parse_action
from knotflow.topology.draw import draw
from knotflow.training.transitions import (
    Query,
    Sample,
    Transition,
    TransitionTrainer,
    encode_samples,
)

ROPE = SimulationConfig().rope
TRIVIAL = TopologicalState.trivial()
R1 = parse_action("R1(0,1,1)")


def transition(end, arranging=False, value=0.5):
    rope = straight(ROPE)
    query = Query(rope, TRIVIAL, R1, canonicalise(rope, R1))
    return Transition(query, np.full(6, 0.1), rope, end, arranging=arranging, value=value)


def test_samples_go_to_their_primitives_with_the_best_next_value():
    done = transition(TRIVIAL, value=0.25)  # the end shape is straight, whatever was done
    others = [parse_action("R2(0,0,1,1)"), R1]
    some = [
        Sample(done, 0.0),
        Sample(done, 1.0, next_value=1.0),
        Sample(done, 1.0, others),
        Sample(done, 1.0, (R1,), arranging=True),
    ]

    def value(number, states):
        return torch.full((len(states),), {1: 0.75, 2: 0.5}[number])

    encoded = dict(encode_samples(some, value))
    assert set(encoded) == {1, ARRANGE}
    acting, arranging = encoded[1], encoded[ARRANGE]
    assert acting["reward"].tolist() == [0.0, 1.0, 1.0]
    assert acting["next_value"].isnan().tolist() == [True, False, False]
    assert acting["next_value"][1:].tolist() == [1.0, 0.75]
    assert acting["next_primitive"].tolist() == [-1, -1, 1]
    assert acting["baseline"].tolist() == [0.0] * 3
    assert arranging["next_value"].tolist() == [0.75] and arranging["baseline"].tolist() == [0.25]


def test_grasps_far_from_where_an_action_grasps_teach_nothing():
    rope = resample(draw(TopologicalState.parse("2o1+")), ROPE)
    over = parse_action("C(0,1,1)")  # the head goes over
    query = Query(rope, TopologicalState.parse("2o1+"), over, canonicalise(rope, over))
    taught = [
        Sample(Transition(query, np.array([grasp, *[0.1] * 5]), rope, None), 1.0)
        for grasp in (0.05, 0.9)
    ]
    ((number, trials),) = encode_samples(taught, lambda number, states: torch.zeros(len(states)))
    assert number == 3 and trials.batch_size == (1,)
    assert trials["reward"].tolist() == [1.0] and trials["next_value"].isnan().all()


def test_values_are_those_of_the_library(primitive_config, curves):
    action = parse_action("R1(0,1,1)")
    states = encode(curves, [action] * len(curves)).states
    torch.manual_seed(3)
    primitive = Primitive(primitive_config).eval()
    library = PrimitiveLibrary({1: primitive}, {1: [action]}, RopeConfig())
    expected = library.values(curves, [action] * len(curves), np.random.default_rng(1))
    trainer = SimpleNamespace(library=library, rng=np.random.default_rng(1))
    found = TransitionTrainer.value(trainer, 1, states)
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-6)
    assert TransitionTrainer.value(trainer, 1, states[:0]).shape == (0,)
