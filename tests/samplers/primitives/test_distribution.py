from __future__ import annotations

import math

import pytest
import torch

from knotflow.samplers.primitives.distribution import NODES, Gaussian, NodeGaussian

COUNT = 20_000


@pytest.fixture(params=["gaussian", "nodes"])
def some(request):
    """Distributions of two ropes."""
    generator = torch.Generator().manual_seed(0)

    def normal(*shape):
        return torch.randn(*shape, generator=generator)

    if request.param == "gaussian":
        factor = 0.3 * normal(2, 6, 6).tril()
        factor.diagonal(dim1=1, dim2=2).abs_().add_(0.1)
        return Gaussian(normal(2, 6), factor)
    share = (2 * normal(2, NODES)).log_softmax(-1)
    grasp = torch.tensor([[0.5, 0.3], [0.04, 0.04]])
    return NodeGaussian(share, normal(2, NODES, 5), 0.1 + normal(2, NODES, 5).abs(), grasp)


@pytest.fixture
def drawn(some):
    noise = torch.randn(2, COUNT, 6, generator=torch.Generator().manual_seed(1))
    return some.draw(noise)


def test_density_is_that_of_what_is_drawn(some, drawn):
    owner = torch.arange(2).repeat_interleave(COUNT)
    log_prob = some.log_prob(drawn.reshape(-1, 6), owner).reshape(2, COUNT)
    assert log_prob.isfinite().all()
    error = log_prob.std(1) / math.sqrt(COUNT)
    assert ((-log_prob.mean(1) - some.entropy).abs() < 4 * error).all()


def test_density_integrates_to_one(some, drawn):
    """Importance sampling from a wider distribution."""
    wide = some.widened(1.3, 0.0)
    noise = torch.randn(2, COUNT, 6, generator=torch.Generator().manual_seed(2))
    splines = wide.draw(noise).reshape(-1, 6)
    owner = torch.arange(2).repeat_interleave(COUNT)
    ratio = (some.log_prob(splines, owner) - wide.log_prob(splines, owner)).exp().reshape(2, COUNT)
    assert ((ratio.mean(1) - 1).abs() < 4 * ratio.std(1) / math.sqrt(COUNT)).all()


def test_widening_by_nothing_changes_nothing(some, drawn):
    owner = torch.zeros(COUNT, dtype=torch.int64)
    same = some.widened(1.0, 0.0)
    torch.testing.assert_close(same.spread, some.spread)
    torch.testing.assert_close(same.log_prob(drawn[0], owner), some.log_prob(drawn[0], owner))
    assert (some.widened(1.0, 0.5).spread > some.spread).all()


def test_repeated_distributions_lie_next_to_each_other(some):
    noise = torch.randn(2, 3, 6, generator=torch.Generator().manual_seed(3))
    one_each = some.repeat(3).draw(noise.reshape(6, 1, 6))
    torch.testing.assert_close(one_each.reshape(2, 3, 6), some.draw(noise))


def test_grasps_are_on_the_rope_and_as_often_at_a_node_as_its_share_says():
    share = torch.full((1, NODES), 0.5 / (NODES - 2))
    share[0, 0], share[0, -1] = 0.3, 0.2
    others = torch.zeros(1, NODES, 5)
    grasp = torch.tensor([[0.5, 0.3]])
    noise = torch.randn(1, COUNT, 6, generator=torch.Generator().manual_seed(4))
    drawn = NodeGaussian(share.log(), others, others + 1, grasp).draw(noise)
    position = 0.5 + 0.3 * drawn[0, :, 0]
    assert position.min() >= -1e-6 and position.max() <= 1 + 1e-6
    at_tips = [(position < 0.5 / (NODES - 1)), (position > 1 - 0.5 / (NODES - 1))]
    for at, expected in zip(at_tips, (0.3, 0.2), strict=True):
        assert at.float().mean().item() == pytest.approx(expected, abs=0.02)


def test_actor_learns_from_gradients_of_the_density(some):
    if isinstance(some, Gaussian):
        leaves = [some.mean.requires_grad_(), some.factor.requires_grad_()]
    else:
        leaves = [one.requires_grad_() for one in (some.log_share, some.mean, some.deviation)]
    some.log_prob(torch.zeros(2, 6), torch.arange(2)).sum().backward()
    assert all(leaf.grad.abs().sum() > 0 for leaf in leaves)
