"""Training of the networks and its losses."""

import numpy as np
import pytest
import torch

from knotflow.perception.networks.network import (
    CoarseToFine,
    CoarseToFineConfig,
    Nodes,
    resample_nodes,
)
from knotflow.perception.networks.patches import (
    ExamplesConfig,
    crop_rope,
    draw_patches,
    find_crossings,
)
from knotflow.perception.networks.strands import StrandNetworkConfig
from knotflow.perception.networks.training import (
    CoarseToFineTrainer,
    StrandTrainer,
    StrandTrainingConfig,
    TrainingConfig,
    count_correct_crossings,
    nodes_loss,
    vertex_error,
)
from knotflow.topology import TopologicalState

from .shapes import ROPE, loop, nodes_in, s_curve, target

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
def test_resumed_training_is_identical(training, tmp_path):
    whole, broken, resumed = training(), training(), training()
    metrics = list(whole)
    next(iter(broken))
    broken.save(tmp_path / "checkpoint.pt")
    resumed.load(tmp_path / "checkpoint.pt")
    list(resumed)
    assert resumed.history == metrics
    for name, one in whole.model.state_dict().items():
        assert torch.equal(one, resumed.model.state_dict()[name]), name


def test_seed_changes_training():
    assert next(iter(training(0))) != next(iter(training(1)))


@pytest.mark.slow
def test_network_overfits_eight_examples():
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
def test_invalid_shapes_raise(shapes):
    with pytest.raises(ValueError, match="41"):
        CoarseToFineTrainer(shapes, CROSSINGS[: len(shapes)], ROPE, TrainingConfig(network=TINY), 0)


def nodes_of(points):
    patch, _ = crop_rope(target(points), 32)
    return torch.as_tensor(nodes_in(patch, points))[None]


def found(places: torch.Tensor) -> list[Nodes]:
    levels = [resample_nodes(places, count) for count in (9, 17, 41)]
    return [Nodes(one, torch.full(one.shape[:2], -3.0)) for one in levels]


@pytest.mark.parametrize("points", [s_curve(), loop(1)], ids=["flat", "crossing"])
def test_loss_is_symmetric_in_direction(points):
    truth = nodes_of(points)
    guess = truth + 0.02 * torch.randn(truth.shape, generator=torch.Generator().manual_seed(0))
    loss = nodes_loss(found(guess), truth)
    assert nodes_loss(found(guess), truth.flip(1)) == pytest.approx(loss.item())
    assert nodes_loss(found(guess.flip(1)), truth).item() == pytest.approx(loss.item())
    assert vertex_error(guess.flip(1), truth) == pytest.approx(vertex_error(guess, truth))


def test_direction_is_chosen_per_rope():
    ropes = torch.cat([nodes_of(s_curve()), nodes_of(loop(1))])
    mixed = torch.cat([ropes[:1], ropes[1:].flip(1)])
    assert torch.allclose(nodes_loss(found(mixed), ropes), nodes_loss(found(ropes), ropes))


def test_the_truth_has_the_least_loss():
    truth = nodes_of(loop(1))
    least = nodes_loss(found(truth), truth)
    for axis in range(3):
        shift = torch.zeros(3)
        shift[axis] = 0.1
        assert nodes_loss(found(truth + shift), truth) > least


@pytest.mark.parametrize("over", [1, -1])
def test_find_crossings_matches_state(over):
    points = loop(over)
    rope, above, below = find_crossings(nodes_of(points))
    ((first, second, _),) = TopologicalState.from_curve(points).crossings
    assert rope.tolist() == [0]
    assert (above < below).item() == (first < second)


def test_wrong_crossing_costs_more_than_centimetres():
    truth, wrong = nodes_of(loop(1)), nodes_of(loop(-1))
    wrong[..., :2] = truth[..., :2]
    shifted = truth + torch.tensor([0.04, 0, 0])  # about a centimetre
    assert nodes_loss(found(wrong), truth) > nodes_loss(found(shifted), truth)
    assert [one.item() for one in count_correct_crossings(truth.flip(1), truth)] == [1, 1]
    assert [one.item() for one in count_correct_crossings(wrong, truth)] == [0, 1]


def test_no_crossings():
    assert len(find_crossings(nodes_of(s_curve()))[0]) == 0
