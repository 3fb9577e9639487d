"""A small primitive and made-up trials on real ropes, in which success has a known cause."""

from __future__ import annotations

import numpy as np
import pytest

from knotflow.samplers.primitives import CemConfig, NetworkConfig, PrimitiveConfig, encode
from knotflow.simulation import RopeConfig, Trials, arc, straight
from knotflow.topology import TopologicalState, parse_action

SMALL = NetworkConfig(lstm=8, attention=4, stream=8, feature=16, head=32)
R1_ACTION = parse_action("R1(0,1,1)")


@pytest.fixture
def primitive_config() -> PrimitiveConfig:
    return PrimitiveConfig("actor_critic", SMALL, CemConfig(population=32, elites=4))


@pytest.fixture
def curves() -> np.ndarray:
    """(6, V, 3) ropes without crossings."""
    rope = RopeConfig()
    return np.stack([straight(rope), *(arc(rope, angle) for angle in (-2, -1, 0.5, 1, 2))])


@pytest.fixture
def trials(curves) -> list[Trials]:
    """A trial succeeds where, as the network sees it, the spline ends to the left of the rope."""
    rng = np.random.default_rng(0)
    frames = encode(curves, [R1_ACTION] * len(curves)).frames
    network = rng.normal(0, 0.6, (len(curves), 40, 6))
    splines = frames.to_world(network)
    success = frames.to_network(splines)[..., 5] > 0.2
    return [
        Trials(R1_ACTION, TopologicalState.trivial(), np.repeat(curve[None], 40, axis=0), *tried)
        for curve, *tried in zip(curves, splines, success, strict=True)
    ]
