"""Small untrained libraries and ropes with known states."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives import (
    CemConfig,
    NetworkConfig,
    Primitive,
    PrimitiveConfig,
    PrimitiveLibrary,
)
from knotflow.simulation import RopeConfig, resample, straight
from knotflow.topology import TopologicalState, parse_action

SMALL = NetworkConfig(lstm=8, attention=4, stream=8, feature=8, head=8)


def small_config(variant: str = "actor_critic") -> PrimitiveConfig:
    return PrimitiveConfig(
        variant, SMALL, CemConfig(population=8, critic_only_population=8, elites=2)
    )


@pytest.fixture
def library() -> PrimitiveLibrary:
    """Untrained, but with actors and critics that tell splines and ropes apart."""
    torch.manual_seed(0)
    primitives = {number: Primitive(small_config()) for number in (1, 2, 3, 4)}
    with torch.no_grad():
        for primitive in primitives.values():
            for parameter in primitive.parameters():
                parameter.add_(0.1 * torch.randn_like(parameter))
    actions = {1: "R1(0,1,1)", 2: "R2(0,0,1,1)", 3: "C(0,1,1)", 4: "C(2,0,1)"}
    trained_on = {number: [parse_action(text)] for number, text in actions.items()}
    return PrimitiveLibrary(primitives, trained_on, RopeConfig())


@pytest.fixture
def ropes() -> dict[str, np.ndarray]:
    """A straight rope, and one with the loop of R1(0,1,1), neither along an axis."""
    rope = RopeConfig()
    line = straight(rope)
    line[:, 1] = 0.1 * np.sin(4 * line[:, 0])
    along = np.linspace(0, 1, 200)
    heading = 0.3 + 2 * np.pi * np.clip((along - 0.3) / 0.4, 0, 1) + 0.4 * np.sin(9 * along)
    curve = np.cumsum(np.stack([np.cos(heading), np.sin(heading), 0 * heading], 1), 0) / 200
    curve[:, 2] = 0.008 + 0.016 * np.exp(-(((along - 0.7) / 0.05) ** 2))
    curve[:, :2] -= curve[:, :2].mean(0)
    loop = resample(curve, rope)
    reached = TopologicalState.trivial().apply(parse_action("R1(0,1,1)"))
    assert TopologicalState.from_curve(loop) == reached
    return {"straight": resample(line, rope), "loop": loop}
