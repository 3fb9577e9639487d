"""Laws of the loss by which the network learns."""

import pytest
import torch

from knotflow.perception.networks.examples import find_crossings
from knotflow.perception.networks.models import Nodes, resample_nodes
from knotflow.perception.networks.training import count_correct_crossings, nodes_loss, vertex_error
from knotflow.topology import TopologicalState

from .shapes import CAMERA, ROPE, loop, s_curve
from .test_patch import crop_rope, exact


def nodes_of(points):
    patch, _ = crop_rope(*exact(points), CAMERA, ROPE, 32)
    return torch.as_tensor(patch.from_world(points, CAMERA))[None]


def found(places: torch.Tensor) -> list[Nodes]:
    levels = [resample_nodes(places, count) for count in (9, 17, 41)]
    return [Nodes(one, torch.full(one.shape[:2], -3.0)) for one in levels]


@pytest.mark.parametrize("points", [s_curve(), loop(1)], ids=["flat", "crossing"])
def test_the_loss_does_not_know_head_from_tail(points):
    truth = nodes_of(points)
    guess = truth + 0.02 * torch.randn(truth.shape, generator=torch.Generator().manual_seed(0))
    loss = nodes_loss(found(guess), truth)
    assert nodes_loss(found(guess), truth.flip(1)) == pytest.approx(loss.item())
    assert nodes_loss(found(guess.flip(1)), truth).item() == pytest.approx(loss.item())
    assert vertex_error(guess.flip(1), truth) == pytest.approx(vertex_error(guess, truth))


def test_each_rope_has_an_order_of_its_own():
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
def test_crossings_are_those_of_the_topological_state(over):
    points = loop(over)
    rope, above, below = find_crossings(nodes_of(points))
    ((first, second, _),) = TopologicalState.from_curve(points).crossings
    assert rope.tolist() == [0]
    assert (above < below).item() == (first < second)


def test_a_crossing_the_wrong_way_round_costs_more_than_centimetres():
    truth, wrong = nodes_of(loop(1)), nodes_of(loop(-1))
    wrong[..., :2] = truth[..., :2]
    shifted = truth + torch.tensor([0.04, 0, 0])  # about a centimetre
    assert nodes_loss(found(wrong), truth) > nodes_loss(found(shifted), truth)
    assert [one.item() for one in count_correct_crossings(truth.flip(1), truth)] == [1, 1]
    assert [one.item() for one in count_correct_crossings(wrong, truth)] == [0, 1]


def test_ropes_without_crossings_have_none():
    assert len(find_crossings(nodes_of(s_curve()))[0]) == 0
