"""A small primitive and made-up trials on real ropes, in which success has a known cause."""

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
from knotflow.simulation import Rollouts, RopeConfig, SimulationConfig, Trials, arc, straight
from knotflow.topology import TopologicalState, parse_action
from knotflow.training import completed

SMALL = NetworkConfig(lstm=8, attention=4, stream=8, feature=16, head=32)
R1_ACTION = parse_action("R1(0,1,1)")


@pytest.fixture
def primitive_config() -> PrimitiveConfig:
    return PrimitiveConfig(
        "actor_critic", SMALL, CemConfig(population=32, critic_only_population=32, elites=4)
    )


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


@pytest.fixture
def make_library():
    """Makes the four primitives, always with the same weights, as networks that learn little."""
    network = NetworkConfig(lstm=8, attention=4, stream=8, feature=16, head=16)

    def make(variant: str = "actor_critic") -> PrimitiveLibrary:
        cem = CemConfig(population=16, critic_only_population=16, valued=8, elites=4)
        torch.manual_seed(0)
        primitives = {n: Primitive(PrimitiveConfig(variant, network, cem)) for n in (1, 2, 3, 4)}
        return PrimitiveLibrary(primitives, {n: [] for n in primitives}, RopeConfig())

    return make


class Laid:
    """A simulator that lays every rope as it is told, or leaves it where it is."""

    config = SimulationConfig()

    def __init__(self, shape: np.ndarray | None = None) -> None:
        self.shape = shape

    def execute(self, points: np.ndarray, splines: np.ndarray, *how) -> Rollouts:
        ends = points if self.shape is None else np.broadcast_to(self.shape, points.shape)
        return Rollouts.between(points, ends.copy())


@pytest.fixture
def laid() -> type[Laid]:
    return Laid


@pytest.fixture
def whole_and_resumed(training, simulator, tmp_path):
    """A finished `training`, and one that was saved after its first round and loaded again."""
    whole, begun, resumed = (training(simulator) for _ in range(3))
    list(whole)
    next(iter(begun))
    begun.save(tmp_path / "checkpoint")
    resumed.load(tmp_path / "checkpoint")
    assert len(resumed.history) == 1
    list(resumed)
    return whole, resumed


@pytest.fixture
def completed_training(make_library, laid):
    """Trainers of a kind, with changes of its configuration, that train a completed library."""

    def of(kind, config):
        def make(simulator=None, earlier=(), **changes):
            library, own = completed(make_library(), 7), replace(config, **changes)
            return kind(library, {}, earlier, simulator or laid(), own, 7)

        return make

    return of


@pytest.fixture
def weights():
    """All weights of a trainer's library."""

    def weights(trainer) -> dict[str, torch.Tensor]:
        return {
            f"{number}.{name}": value.clone()
            for number, primitive in trainer.library.primitives.items()
            for name, value in primitive.state_dict().items()
        }

    return weights
