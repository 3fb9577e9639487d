from __future__ import annotations

import numpy as np
import pytest
import torch

from knotflow.samplers.primitives import (
    Critic,
    NetworkConfig,
    Primitive,
    PrimitiveConfig,
    cross_entropy,
    encode,
)
from knotflow.samplers.primitives.distribution import Gaussian
from knotflow.samplers.primitives.encoding import CONTROL_FEATURES, STREAM_POINTS
from knotflow.topology import parse_action


@pytest.fixture
def seen(ropes):
    actions = [parse_action("C(0,1,1)"), parse_action("C(0,2,1)")]
    return encode(np.stack([ropes["loop"]] * 2), actions)


def test_actor_covariance_has_a_lower_bound(library, seen):
    actor = library.primitives[3].actor
    gaussian = actor(seen.states)
    mean, factor = gaussian.mean, gaussian.factor
    assert mean.shape == (2, 6) and factor.shape == (2, 6, 6)
    assert torch.equal(factor, factor.tril())
    assert (factor.diagonal(dim1=1, dim2=2) >= actor.smallest_spread).all()


def test_scores_are_independent_of_the_batch(library, seen):
    critic = library.primitives[3].critic
    splines = torch.randn(7, 6)
    owner = torch.tensor([0, 1, 1, 0, 1, 0, 0])
    together = critic(seen.states, splines, owner)
    alone = [critic(seen.states[o : o + 1], splines[i : i + 1], owner[:1]) for i, o in
             enumerate(owner.tolist())]  # fmt: skip
    torch.testing.assert_close(together, torch.cat(alone), atol=1e-5, rtol=1e-4)
    assert together.std() > 0


def test_streams_share_no_weights_and_all_have_gradients(library, seen):
    trunk = library.primitives[3].critic.trunk
    streams = seen.states["streams"].clone().requires_grad_()
    trunk(streams)[0].sum().backward()
    assert (streams.grad.abs().amax(dim=(0, 2)) > 0).all()
    pointers = [parameter.data_ptr() for parameter in trunk.parameters()]
    assert len(set(pointers)) == len(pointers)


def test_attention_of_splines_to_the_rope_decays_with_distance(library, seen):
    torch.manual_seed(1)
    passage = library.primitives[3].critic.passage
    states = seen.states[:1]
    streams = states["streams"].clone()
    points = streams[0, -STREAM_POINTS[-1] :, :2]
    near = points[5]
    far = (points - near).norm(dim=1).argmax()
    controls = torch.zeros(1, 1, CONTROL_FEATURES)
    for columns in ((7, 8), (1, 2), (4, 5)):  # a spline that stays at one place
        controls[0, 0, list(columns)] = near
    shape = (1, STREAM_POINTS[-1], passage.of_points.out_features)
    of_points = torch.randn(shape).requires_grad_()
    passage(of_points, streams, controls).sum().backward()
    felt = of_points.grad[0, :, -4:].norm(dim=1)
    assert felt[5] > 3 * felt[far] > 0


@pytest.mark.parametrize("full_covariance", [False, True])
def test_cross_entropy_finds_a_known_maximum_by_distinct_searches(full_covariance):
    target = torch.tensor([0.5, -0.3, 0.2, 0.0, 0.1, -0.4])
    noise = torch.randn(10, 3, 256, 6, generator=torch.Generator().manual_seed(0))

    def score(splines):
        return -(splines - target).square().sum(-1)

    wide = Gaussian(torch.zeros(3, 6), torch.eye(6).expand(3, 6, 6))
    found, values = cross_entropy(score, wide, noise, 24, full_covariance)
    torch.testing.assert_close(found, target.expand(3, 6), atol=0.1, rtol=0)
    assert (values > -0.05).all()
    assert len(found.unique(dim=0)) == 3


def test_cross_entropy_of_fewer_splines_than_elites_is_refused():
    first = Gaussian(torch.zeros(1, 6), torch.eye(6)[None])
    with pytest.raises(ValueError, match="keeps 12 elites of a population of 8"):
        cross_entropy(lambda splines: splines.sum(-1), first, torch.zeros(1, 1, 8, 6), elites=12)


@pytest.mark.parametrize("iterations", [1, 3])
def test_cross_entropy_returns_the_value_of_its_spline(iterations):
    """On a ring of good splines the elites' mean is a bad one."""
    noise = torch.randn(iterations, 4, 64, 6, generator=torch.Generator().manual_seed(0))
    first = Gaussian(torch.zeros(4, 6), torch.eye(6).expand(4, 6, 6))

    def score(splines):
        return -(splines.norm(dim=-1) - 2).abs()

    found, values = cross_entropy(score, first, noise, elites=12)
    torch.testing.assert_close(values, score(found))
    best, highest = cross_entropy(score, first, noise, elites=12, returns="best")
    torch.testing.assert_close(highest, score(best))
    assert (values < highest - 0.1).all()


@pytest.mark.parametrize("actor", ["gaussian", "nodes"])
@pytest.mark.parametrize("variant", ["actor_critic", "actor_only", "critic_only"])
def test_every_variant_proposes_distinct_splines(seen, variant, actor):
    torch.manual_seed(0)
    config = PrimitiveConfig(variant, NetworkConfig(actor))
    found = Primitive(config).search(seen, 5, np.random.default_rng(0))
    assert found.shape == (2, 5, 6)
    assert len(found.reshape(-1, 6).unique(dim=0)) == 10


def test_critic_can_read_the_grasp_by_position_alone(seen):
    """Of a rope that is one point the grasp's position says nothing."""
    torch.manual_seed(0)
    states, splines = seen.states.clone(), torch.randn(2, 6)
    states["streams"][..., [0, 1, 2, 4, 5]] = 0.0
    other = splines + torch.tensor([0.3, 0, 0, 0, 0, 0])
    for grasp, differs in (("all", True), ("position", False)):
        critic = Critic(NetworkConfig(critic_grasp=grasp))
        scores = [critic(states, one, torch.arange(2)) for one in (splines, other)]
        assert (not torch.equal(*scores)) is differs


def test_unknown_option_is_refused():
    with pytest.raises(ValueError, match="actor_critic, actor_only, critic_only"):
        PrimitiveConfig("critic")
    with pytest.raises(ValueError, match=r"network\.actor 'node'.* gaussian, nodes"):
        PrimitiveConfig(network=NetworkConfig("node"))
